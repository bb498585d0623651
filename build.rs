//! States the commit of the sources, and makes cargo run this script again when they change, when the operator's page changes, which may be
//! built before or after the daemon, and when the needs of tests change.

#[path = "tests/common/needs.rs"]
mod needs;

use needs::Need;
use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=tests/common/needs.rs");
    let program = |name, cfg| Need::Program { name, cfg };
    let (systemd, r) = (program("systemd-analyze", "has_systemd_analyze"), program("Rscript", "has_rscript"));
    let promtool = program("promtool", "has_promtool");
    needs::tell(&[Need::Shared, Need::Python, systemd, r, promtool, Need::Root]);
    commit();
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
const SOURCES: [&str; 8] = ["src", "crates", "hardware-sim", "config", "web/src", "Cargo.toml", "Cargo.lock", "build.rs"];

/// Tells the compiler the commit of the sources and whether they differ from it: by git where this is a checkout, by `CARVED_COMMIT`
/// elsewhere.
fn commit() {
    println!("cargo::rerun-if-env-changed=CARVED_COMMIT");
    for path in SOURCES.map(Path::new).into_iter().filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    let (commit, dirty) = checkout().unwrap_or_else(|| {
        let named = env::var("CARVED_COMMIT").ok().filter(|commit| !commit.trim().is_empty());
        (named.map_or_else(|| "unknown".to_owned(), |commit| commit.trim().to_owned()), "")
    });
    println!("cargo::rustc-env=CARVED_BUILD_COMMIT={commit}");
    println!("cargo::rustc-env=CARVED_BUILD_DIRTY={dirty}");
}

/// The commit of this folder, and whether its sources differ from it. `None` where the folder is not the root of a checkout: a parent
/// folder may be one of another project.
fn checkout() -> Option<(String, &'static str)> {
    let own = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR")?).canonicalize().ok()?;
    let root = PathBuf::from(git(&["rev-parse", "--show-toplevel"])?).canonicalize().ok()?;
    let commit = git(&["rev-parse", "HEAD"]).filter(|_| root == own)?;
    let changes = git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat())?;
    // A development build keeps the commit of its last change of the sources, so that a commit alone does not compile everything again.
    if env::var("PROFILE").is_ok_and(|profile| profile == "release") {
        let log = git(&["rev-parse", "--git-path", "logs/HEAD"])?;
        println!("cargo::rerun-if-changed={log}");
    }
    Some((commit, if changes.is_empty() { "false" } else { "true" }))
}

/// What git says. `None` where it fails or is not installed.
fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("--no-optional-locks").args(args).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}

/// The time of the newest file below a folder. `None` if it cannot be read.
fn newest(folder: &Path) -> Option<SystemTime> {
    let files = std::fs::read_dir(folder).ok()?.flatten();
    let time = |file: std::fs::DirEntry| match file.metadata().ok()? {
        found if found.is_dir() => newest(&file.path()),
        found => found.modified().ok(),
    };
    files.filter_map(time).max()
}
