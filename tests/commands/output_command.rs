//! `carved output` on the emulated rig: an output is on while the command holds it, and off afterwards.

use crate::common::{carved, configured, port, run, stderr};
use hardware_sim::scene::{Scene, SceneSettings};
use hardware_sim::{OutputPin, Rig, RigSettings};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::Arc;

const TABLES: &str = "\n[rotation.outputs.light]\npin = \"flood_coolant\"\non = \"views\"\n\n[rotation.outputs.valve]\npin = \"mist_coolant\"\non = \"manual\"\n";

#[test]
fn an_output_is_on_until_the_command_ends() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::start(RigSettings::default(), Arc::new(Scene::new(SceneSettings::default()))).unwrap();
    let (config, _) = configured("vast-grbl.toml", dir.path(), &rig, &[port(&rig)]);
    let config = config.to_str().unwrap();
    let refused = |args: &[&str]| {
        let output = run(&[&["output"], args, &["--config", config]].concat());
        assert!(!output.status.success());
        stderr(&output)
    };
    assert!(refused(&["valve", "on"]).contains("it has no table [rotation.outputs.NAME]"));
    std::fs::write(config, std::fs::read_to_string(config).unwrap() + TABLES).unwrap();
    assert!(refused(&["lamp", "on"]).contains("there is no output \"lamp\"; it has: light, valve"));
    for time in ["0", "-1", "soon", "1e9"] {
        assert!(refused(&["valve", "on", "--for", time]).contains("give a number of seconds above 0"), "{time}");
    }

    let mut child = carved().args(["output", "valve", "on", "--config", config]).stdout(Stdio::piped()).spawn().unwrap();
    let mut said = String::new();
    let mut out = BufReader::new(child.stdout.take().unwrap());
    out.read_line(&mut said).unwrap();
    assert_eq!(said, "valve is on, until Ctrl-C\n");
    assert!(rig.outputs().is_on(OutputPin::Mist) && !rig.outputs().is_on(OutputPin::Flood));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    out.read_line(&mut said).unwrap();
    assert!(child.wait().unwrap().success() && said.ends_with("valve is off\n"), "{said}");
    assert!(!rig.outputs().is_on(OutputPin::Mist));

    let output = run(&["output", "light", "on", "--for", "0.01", "--config", config]);
    assert!(output.status.success(), "{}", stderr(&output));
    let switched = rig.outputs().switched();
    assert!(switched.contains(&(OutputPin::Flood, true)) && !rig.outputs().is_on(OutputPin::Flood), "{switched:?}");
    assert!(run(&["output", "light", "off", "--config", config]).status.success());
    rig.outputs().refuse(OutputPin::Mist, true);
    assert!(refused(&["valve", "on"]).contains("valve"));
}
