//! States the commit of the sources, for the build scripts of what writes it into files: the program, and the Python module.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Tells the compiler the commit of the sources and whether they differ from it (`CARVED_BUILD_COMMIT`, `CARVED_BUILD_DIRTY`): by git where
/// `root` is the root of a checkout, by `CARVED_COMMIT` elsewhere. `root` is relative to the folder of the build script's package; `sources`
/// are the files and folders below it that the result is made of.
pub fn tell(root: &Path, sources: &[&str]) {
    println!("cargo::rerun-if-env-changed=CARVED_COMMIT");
    for path in sources.iter().map(|source| root.join(source)).filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    let (commit, dirty) = checkout(root, sources).unwrap_or_else(|| {
        let named = env::var("CARVED_COMMIT").ok().filter(|commit| !commit.trim().is_empty());
        (named.map_or_else(|| "unknown".to_owned(), |commit| commit.trim().to_owned()), "")
    });
    println!("cargo::rustc-env=CARVED_BUILD_COMMIT={commit}");
    println!("cargo::rustc-env=CARVED_BUILD_DIRTY={dirty}");
}

/// The commit of this folder, and whether its sources differ from it. `None` where the folder is not the root of a checkout: a parent
/// folder may be one of another project.
fn checkout(root: &Path, sources: &[&str]) -> Option<(String, &'static str)> {
    let own = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR")?).join(root).canonicalize().ok()?;
    let git = |args: &[&str]| git(&own, args);
    let root = PathBuf::from(git(&["rev-parse", "--show-toplevel"])?).canonicalize().ok()?;
    let commit = git(&["rev-parse", "HEAD"]).filter(|_| root == own)?;
    let changes = git(&[&["status", "--porcelain", "--"], sources].concat())?;
    // A development build keeps the commit of its last change of the sources, so that a commit alone does not compile everything again.
    if env::var("PROFILE").is_ok_and(|profile| profile == "release") {
        let log = own.join(git(&["rev-parse", "--git-path", "logs/HEAD"])?);
        println!("cargo::rerun-if-changed={}", log.display());
    }
    Some((commit, if changes.is_empty() { "false" } else { "true" }))
}

/// What git says in a folder. `None` where it fails or is not installed.
fn git(folder: &Path, args: &[&str]) -> Option<String> {
    let git = Command::new("git").arg("--no-optional-locks").args(args).current_dir(folder).output();
    let output = git.ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
