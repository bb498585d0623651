//! States the commit of the sources.

// A link to that of the project, so that the source distribution has it.
#[path = "commit.rs"]
mod commit;

use std::path::Path;

/// What the module is made of.
const SOURCES: [&str; 7] =
    ["crates", "python/native", "python/src", "python/Cargo.toml", "python/build.rs", "Cargo.lock", "scripts/commit.rs"];

fn main() {
    commit::tell(Path::new(".."), &SOURCES);
}
