//! Has cargo look again for the operator's page, which may be built before or after the daemon.

use std::path::Path;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // A path that does not exist would make every build start anew, so each is watched only where it stands. Until the
    // page is built its sources' folder tells when it is.
    let built = Path::new("web/dist");
    let sources = Path::new("web");
    if let Some(watched) = [built, sources].into_iter().find(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", watched.display());
    }
}
