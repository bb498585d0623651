//! The protocols as implemented by others: Trinamic's `PyTrinamic` and Zaber's Motion Library, from `PyPI`.
//!
//! ```text
//! PyTrinamic, Motion Library ── pty ── emulated module, emulated controller      do they understand what we emulate?
//! our driver ─────────────────── pty ── a module of PyTrinamic's frames          do they understand what we send?
//! ```
//! Without access to `PyPI` the tests report this and pass, but they fail in a strict run. Zaber offers no emulated controller in a
//! package, and there is no package of a Grbl.

use crate::common::venv;
use crate::driver::{stand, turns};
use crate::motion_tmcl;
use carved_core::units::Steps;
use carved_devices::RotationAxis;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Port, Reference, Tmcl, TmclSettings};
use hardware_sim::{Controller, tmcl, zaber};
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

/// A Python that has the packages, or the reason why there is none.
fn python() -> Result<PathBuf, String> {
    static FOUND: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    FOUND.get_or_init(|| venv::python("oracles", "pytrinamic, zaber_motion", "tests/oracles/requirements.txt")).clone()
}

/// A program of tests/oracles. `None` if it cannot run here.
fn oracle(name: &str) -> Option<Command> {
    match python() {
        Ok(python) => {
            let mut command = Command::new(python);
            command.arg(format!("{}/tests/oracles/{name}", env!("CARGO_MANIFEST_DIR")));
            Some(command)
        }
        Err(why) => {
            crate::common::strict::cannot_run(&format!("PyTrinamic and Zaber's Motion Library cannot be installed: {why}"));
            None
        }
    }
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn pytrinamic_drives_the_emulated_module() {
    let Some(mut host) = oracle("tmcl_host.py") else { return };
    let rig = crate::driver::rig(Controller::Tmcl(tmcl::Settings::default()), (6400, 1));
    let before = turns(&rig);
    let output = host.arg(rig.serial_path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    stand(&rig);
    assert!((turns(&rig) - before + 0.1).abs() < 1e-9, "from {before} to {}", turns(&rig));
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn zabers_own_library_drives_the_emulated_controller() {
    let Some(mut host) = oracle("zaber_host.py") else { return };
    let rig = crate::driver::rig(Controller::Zaber(zaber::Settings::default()), (6400, 1));
    let output = host.arg(rig.serial_path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    stand(&rig);
    assert!((turns(&rig) - 0.25).abs() < 1e-9, "{}", turns(&rig));
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn a_module_of_pytrinamics_frames_understands_the_driver() {
    let Some(mut module) = oracle("tmcl_module.py") else { return };
    let mut module = module.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(module.stdout.take().unwrap()).lines();
    let port = said.next().unwrap().unwrap();
    let settings = TmclSettings {
        reference: Reference::Here,
        // The module is another process on a machine that may be busy.
        answer_timeout_ms: 5000,
        homing_timeout_ms: 5000,
        outputs: std::collections::BTreeMap::new(),
        ..motion_tmcl::settings_at(Port::Path(port))
    };
    let mut axis = Tmcl::open(settings).unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    for target in [1600, -20_000] {
        assert_eq!(axis.move_to(Steps(target)).unwrap().steps, Steps(target));
        for motor in [0, 1] {
            assert_eq!(said.next().unwrap().unwrap(), format!("motor {motor} to {target}"));
        }
    }
    drop((axis, module.stdin.take()));
    let output = module.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
