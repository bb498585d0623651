//! Data that are not part of the project. Tests that need them are ignored if `has_shared` is not set (`needs.rs`).

use std::path::{Path, PathBuf};

/// The path `inside` the folder of shared data, which is `CARVED_SHARED` or else `shared` beside the project.
pub fn shared(inside: &str) -> PathBuf {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().skip(1).map(|folder| folder.join("shared")).find(|s| s.is_dir());
    let folder = std::env::var_os("CARVED_SHARED").map(PathBuf::from).or_else(beside);
    let found = folder.map(|folder| folder.join(inside)).filter(|found| found.exists());
    found.unwrap_or_else(|| panic!("no {inside} in a folder `shared` beside the project, nor in one that CARVED_SHARED names"))
}
