//! For build scripts: turns what some tests need of the machine into `cfg`s. A test whose need is not met is ignored with the reason.
//!
//! ```text
//!  build.rs ── has_NAME ──┬─ #[cfg_attr(not(has_NAME), ignore = "reason")]     each test that needs it
//!                         └─ strict::holds([..cfg!(has_NAME)..])              one test per crate, which fails in a strict run
//! ```
//! Cargo runs the script again when a program disappears, and when a missing one may have appeared. It cannot watch a folder that does not
//! exist: set `CARVED_SHARED` to use shared data that were added later. If the data disappear, their tests fail. If a Python gets venv
//! later, run `touch build.rs`.
#![allow(dead_code)] // each build script has its own needs

use std::env;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

pub enum Need {
    /// The folder of shared data.
    Shared,
    /// Python 3 with venv.
    Python,
    Program {
        name: &'static str,
        cfg: &'static str,
    },
    Root,
}

pub fn tell(needs: &[Need]) {
    for need in needs {
        let (cfg, met) = match need {
            Need::Shared => ("has_shared", shared()),
            Need::Python => ("has_python", program("python3").is_some_and(|python| has_venv(&python))),
            Need::Program { name, cfg } => (*cfg, program(name).is_some()),
            Need::Root => ("has_root", root()),
        };
        println!("cargo::rustc-check-cfg=cfg({cfg})");
        if met {
            println!("cargo::rustc-cfg={cfg}");
        }
    }
}

/// The same rule as in `tests/common/shared.rs`.
fn shared() -> bool {
    println!("cargo::rerun-if-env-changed=CARVED_SHARED");
    let package = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let beside = || package.ancestors().skip(1).map(|folder| folder.join("shared")).find(|found| found.is_dir());
    let folder = env::var_os("CARVED_SHARED").map(PathBuf::from).or_else(beside);
    folder.is_some_and(|folder| folder.is_dir())
}

fn program(name: &str) -> Option<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    // Builds could change the contents of a relative folder.
    let folders: Vec<PathBuf> = env::split_paths(&path).filter(|folder| folder.is_absolute() && folder.is_dir()).collect();
    let found = folders.iter().map(|folder| folder.join(name)).find(|program| program.is_file());
    if let Some(program) = &found {
        println!("cargo::rerun-if-changed={}", program.display());
    } else {
        println!("cargo::rerun-if-env-changed=PATH");
        for folder in &folders {
            println!("cargo::rerun-if-changed={}", folder.display());
        }
    }
    found
}

fn has_venv(python: &Path) -> bool {
    let asked = Command::new(python).args(["-c", "import ensurepip, venv"]).stderr(Stdio::null()).status();
    asked.is_ok_and(|status| status.success())
}

fn root() -> bool {
    // Another user has another USER. Not every shell sets it.
    println!("cargo::rerun-if-env-changed=USER");
    std::fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}
