//! A disk that is slow where the test wants it: the daemon's syncs of files of one name wait until the test lets them go on.

use super::until;
use std::path::{Path, PathBuf};
use std::process::Command;

pub struct HeldDisk {
    dir: tempfile::TempDir,
}

impl HeldDisk {
    pub fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reliability/kit/shim.c");
        let compiled =
            Command::new("cc").args(["-O1", "-shared", "-fPIC", "-o"]).arg(dir.path().join("shim.so")).arg(source).arg("-ldl").status();
        assert!(compiled.unwrap().success());
        std::fs::create_dir(dir.path().join("held")).unwrap();
        Self { dir }
    }

    fn held(&self) -> PathBuf {
        self.dir.path().join("held")
    }

    /// For `LD_PRELOAD` and `SHIM_HELD` of the program.
    pub fn paths(&self) -> [PathBuf; 2] {
        [self.dir.path().join("shim.so"), self.held()]
    }

    /// From now on syncs of files of this name wait.
    pub fn hold(&self, name: &str) {
        std::fs::write(self.held().join(name), "").unwrap();
    }

    /// Waits until a sync of a file of this name waits.
    pub fn wait_for(&self, name: &str) {
        let waits = self.held().join(format!("{name}.waits"));
        until(name, || waits.exists());
    }

    pub fn let_go(&self, name: &str) {
        std::fs::remove_file(self.held().join(name)).unwrap();
    }
}
