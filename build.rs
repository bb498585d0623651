//! Has cargo look again for the operator's page, which may be built before or after the daemon, and for what tests need.

#[path = "tests/common/needs.rs"]
mod needs;

use needs::Need;
use std::path::Path;
use std::time::SystemTime;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=tests/common/needs.rs");
    needs::tell(&[Need::Shared, Need::Python, Need::Program { name: "systemd-analyze", cfg: "has_systemd_analyze" }, Need::Root]);
    // A path that does not exist would make every build start anew, so each is watched only where it stands. Until the
    // page is built its sources' folder tells when it is.
    let built = Path::new("web/dist");
    let sources = Path::new("web");
    if let Some(watched) = [built, sources].into_iter().find(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", watched.display());
    }
    // A page of another day than its sources would be served without a word.
    if built.exists() {
        println!("cargo::rerun-if-changed=web/src");
        if newest(&sources.join("src")) > newest(built) {
            println!(
                "cargo::warning=web/dist is older than web/src: the page of an earlier day goes into the program; `make web` builds it"
            );
        }
    }
}

/// When the newest file of a folder was written; nothing of one that cannot be read.
fn newest(folder: &Path) -> Option<SystemTime> {
    let files = std::fs::read_dir(folder).ok()?.flatten();
    files.filter_map(|file| file.metadata().ok()?.modified().ok()).max()
}
