//! Data that are not part of the project: skipped where they are not there.

use std::path::{Path, PathBuf};

/// What `inside` the folder of shared data is: the one that `CARVED_SHARED` names, or `shared` beside the project.
pub fn shared(inside: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().skip(1).map(|folder| folder.join("shared")).find(|s| s.is_dir());
    let folder = std::env::var_os("CARVED_SHARED").map(PathBuf::from).or_else(beside);
    let found = folder.map(|folder| folder.join(inside)).filter(|found| found.exists());
    if found.is_none() {
        println!("skipped: no {inside} in a folder `shared` beside the project, nor in one that CARVED_SHARED names");
    }
    found
}
