//! `carved halt` after a process was killed that held an output on.

use crate::common::{carved, configured, port, run, stderr};
use carved_store::Claim;
use hardware_sim::scene::{Scene, SceneSettings};
use hardware_sim::{OutputPin, Rig, RigSettings};
use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::sync::Arc;

const VALVE: &str = "\n[rotation.outputs.valve]\npin = \"mist_coolant\"\non = \"manual\"\n";

#[test]
fn what_a_killed_process_left_on_is_switched_off() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::start(RigSettings::default(), Arc::new(Scene::new(SceneSettings::default()))).unwrap();
    let (config, data) = configured("vast-grbl.toml", dir.path(), &rig, &[port(&rig)]);
    std::fs::write(&config, std::fs::read_to_string(&config).unwrap() + VALVE).unwrap();
    let config = config.to_str().unwrap();

    let mut child = carved().args(["output", "valve", "on", "--config", config]).stdout(Stdio::piped()).spawn().unwrap();
    let mut said = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut said).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(rig.outputs().is_on(OutputPin::Mist), "{said}");

    let claim = Claim::on(&data).unwrap();
    let output = run(&["halt", "--config", config]);
    assert!(!output.status.success() && rig.outputs().is_on(OutputPin::Mist), "a daemon has the instrument: {}", stderr(&output));
    drop(claim);
    let output = run(&["halt", "--config", config]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).ends_with("the motors are stopped, and the outputs are off\n"));
    assert!(!rig.outputs().is_on(OutputPin::Mist));
}
