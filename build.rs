//! States the commit of the sources, and makes cargo run this script again when they change, when the operator's page changes, which may be
//! built before or after the daemon, and when the needs of tests change.

#[path = "scripts/commit.rs"]
mod commit;
#[path = "tests/common/needs.rs"]
mod needs;

use needs::Need;
use std::env;
use std::path::Path;
use std::time::SystemTime;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=tests/common/needs.rs");
    let program = |name, cfg| Need::Program { name, cfg };
    let (systemd, r) = (program("systemd-analyze", "has_systemd_analyze"), program("Rscript", "has_rscript"));
    let promtool = program("promtool", "has_promtool");
    needs::tell(&[Need::Shared, Need::Python, systemd, r, promtool, Need::Root]);
    commit::tell(Path::new(""), &SOURCES);
    pack_relocations();
    // Cargo reruns the script in every build if a watched path does not exist, so each path is watched only if it exists. Before the page
    // is built, a change in the folder of its sources shows that it was.
    let built = Path::new("web/dist");
    let sources = Path::new("web");
    if let Some(watched) = [built, sources].into_iter().find(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", watched.display());
    }
    // Without this warning an outdated page would be served silently.
    if built.exists() {
        println!("cargo::rerun-if-changed=web/src");
        if newest(&sources.join("src")) > newest(built) {
            println!(
                "cargo::warning=web/dist is older than web/src: the page of an earlier day goes into the program; `make web` builds it"
            );
        }
    }
}

/// Stores the relative relocations in the compact form that glibc reads since 2.36: a release program is 1.5 MB smaller. The static program
/// relocates itself.
fn pack_relocations() {
    let target = |key: &str| env::var(format!("CARGO_CFG_TARGET_{key}")).unwrap_or_default();
    let is_static = target("FEATURE").split(',').any(|feature| feature == "crt-static");
    if target("OS") == "linux" && target("ENV") == "gnu" && !is_static {
        println!("cargo::rustc-link-arg-bins=-Wl,-z,pack-relative-relocs");
    }
}

/// What the program is made of. A change beside it does not make another program.
const SOURCES: [&str; 9] =
    ["src", "crates", "hardware-sim", "config", "web/src", "Cargo.toml", "Cargo.lock", "build.rs", "scripts/commit.rs"];

/// The time of the newest file below a folder. `None` if it cannot be read.
fn newest(folder: &Path) -> Option<SystemTime> {
    let files = std::fs::read_dir(folder).ok()?.flatten();
    let time = |file: std::fs::DirEntry| match file.metadata().ok()? {
        found if found.is_dir() => newest(&file.path()),
        found => found.modified().ok(),
    };
    files.filter_map(time).max()
}
