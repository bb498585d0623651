//! `carved camera`: exposure set-up and reference frames on the emulated camera, whose light follows its exposure.
#![cfg(feature = "aravis")]

use crate::common::{configured, json, port, run, stderr, until};
use hardware_sim::scene::{Scene, SceneSettings, Specimen};
use hardware_sim::{Controller, OutputPin, RigSettings, zaber};
use serde_json::Value;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

/// Exposure at which the scene has its nominal brightness, us.
const NOMINAL_US: f32 = 4000.0;

struct Bench {
    rig: hardware_sim::Rig,
    scene: Arc<Scene>,
    text: String,
    dir: tempfile::TempDir,
}

impl Bench {
    fn start() -> Self {
        let scene = Arc::new(Scene::new(SceneSettings::default()));
        let settings = RigSettings { time_scale: 10.0, nominal_exposure_us: Some(NOMINAL_US), ..RigSettings::default() };
        let rig = hardware_sim::Rig::start(settings, scene.clone()).unwrap();
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/config/vast-grbl.toml")).unwrap();
        let text = text.replace("address = \"192.168.10.2\"", &format!("address = \"{}\"", rig.camera_address()));
        Self { rig, scene, text, dir: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn config(&self, changes: &[(&str, &str)]) -> PathBuf {
        let text = changes.iter().fold(self.text.clone(), |text, (from, to)| {
            assert!(text.contains(from), "the shipped configuration has no {from:?}");
            text.replace(from, to)
        });
        let path = self.path("rig.toml");
        std::fs::write(&path, text).unwrap();
        path
    }
}

fn carved(command: &str, config: &Path, more: &[&str]) -> Result<Value, String> {
    let output = run(&[&["camera", command, "--config", config.to_str().unwrap()], more].concat());
    if output.status.success() { Ok(serde_json::from_slice(&output.stdout).unwrap()) } else { Err(stderr(&output)) }
}

#[test]
fn the_exposure_is_found_from_far_below_and_far_above() {
    let bench = Bench::start();
    for start in ["40.0", "60000.0"] {
        let found = carved("exposure", &bench.config(&[("exposure_us = 5000.0", &format!("exposure_us = {start}"))]), &[]).unwrap();
        let (top, exposure_us) = (found["top"].as_f64().unwrap(), found["exposure_us"].as_f64().unwrap());
        assert!((top - 240.0).abs() <= 3.0 && found["light"]["saturated"].as_f64().unwrap() < 0.005, "{found}");
        // The scene's brightest colour is 250 of 255 at the nominal exposure.
        assert!((0.85..1.1).contains(&(exposure_us / f64::from(NOMINAL_US))), "{found}");
    }
    let error = carved("exposure", &bench.config(&[]), &["--target", "255"]).unwrap_err();
    assert!(error.contains("50 to 250"), "{error}");
}

#[test]
fn the_empty_capillary_is_stored_with_its_facts_and_taken_by_the_configuration() {
    let bench = Bench::start();
    let config = bench.config(&[("exposure_us = 5000.0", "exposure_us = 3800.0")]);
    let out = bench.path("empty.png");
    // A busy computer loses frames, most of all the first of an acquisition.
    bench.rig.faults().camera().drop_frames(1);
    let facts = carved("empty", &config, &["--out", out.to_str().unwrap(), "--frames", "8"]).unwrap();
    assert_eq!(facts, json(&bench.path("empty.json")));
    let sum = std::process::Command::new("sha256sum").arg(&out).output().unwrap();
    assert!(String::from_utf8_lossy(&sum.stdout).starts_with(facts["file_sha256"].as_str().unwrap()), "{facts}");
    assert_eq!((&facts["kind"], &facts["frames"]), (&Value::from("empty"), &Value::from(8)));
    assert!(facts["taken"].as_str().unwrap().ends_with('Z') && facts["camera"].as_str().unwrap().contains("GE1050C"), "{facts}");
    let dimmed = ("exposure_us = 5000.0", "exposure_us = 3800.0");
    let config = bench.config(&[dimmed, ("height_px = 1024", "height_px = 1024\nempty_capillary = \"empty.png\"")]);
    let output = run(&["config", "check", config.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));

    let again = carved("empty", &config, &["--out", out.to_str().unwrap()]).unwrap_err();
    assert!(again.contains("empty.png") && again.contains("not overwritten"), "{again}");
    bench.scene.load(Some(Specimen::larva(4, 1).unwrap())).unwrap();
    let full = carved("empty", &config, &["--out", bench.path("full.png").to_str().unwrap()]).unwrap_err();
    assert!(full.contains("not empty"), "{full}");
    assert!(!bench.path("full.png").exists());
}

#[test]
fn a_flat_field_is_stored_and_one_that_is_saturated_refused() {
    let bench = Bench::start();
    let out = bench.path("flat.png");
    let config = bench.config(&[("exposure_us = 5000.0", "exposure_us = 3000.0")]);
    let facts = carved("flat-field", &config, &["--out", out.to_str().unwrap()]).unwrap();
    assert_eq!(facts["kind"], "flat_field");
    assert!(out.is_file());
    let config = bench.config(&[("exposure_us = 5000.0", "exposure_us = 9000.0")]);
    let said = carved("flat-field", &config, &["--out", bench.path("bright.png").to_str().unwrap()]).unwrap_err();
    assert!(said.contains("saturated") && said.contains("carved camera exposure"), "{said}");
}

#[test]
fn a_light_at_an_output_is_on_for_the_frames_and_off_afterwards() {
    let settings = RigSettings { time_scale: 10.0, light: Some(OutputPin::Spindle), ..RigSettings::default() };
    let rig = hardware_sim::Rig::start(settings, Arc::new(Scene::new(SceneSettings::default()))).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let (config, _) = configured("vast-grbl.toml", dir.path(), &rig, &[port(&rig)]);
    let output = "\n[rotation.outputs.light]\npin = \"spindle\"\non = \"views\"\n";
    std::fs::write(&config, std::fs::read_to_string(&config).unwrap() + output).unwrap();
    let facts = carved("flat-field", &config, &["--out", dir.path().join("flat.png").to_str().unwrap(), "--frames", "2"]).unwrap();
    assert!(facts["light"]["background"].as_f64().unwrap() > 100.0, "{facts}");
    let switched: Vec<bool> = rig.outputs().switched().iter().map(|(_, on)| *on).collect();
    assert_eq!(switched, [true, false]);
}

/// The output of this controller holds its level when the connection closes.
#[test]
fn a_signal_ends_the_command_and_switches_the_light_off() {
    let light = OutputPin::Number(1);
    let controller = Controller::Zaber(zaber::Settings::default());
    let settings = RigSettings { time_scale: 10.0, controller, light: Some(light), ..RigSettings::default() };
    let rig = hardware_sim::Rig::start(settings, Arc::new(Scene::new(SceneSettings::default()))).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let (config, _) = configured("vast-zaber.toml", dir.path(), &rig, &[port(&rig)]);
    let output = "\n[rotation.outputs.light]\npin = 1\non = \"views\"\n";
    std::fs::write(&config, std::fs::read_to_string(&config).unwrap() + output).unwrap();
    let flat = dir.path().join("flat.png");
    let mut command = crate::common::carved();
    command.args(["camera", "flat-field", "--frames", "1000", "--config"]).arg(&config).arg("--out").arg(&flat);
    let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
    until("the light on", || rig.outputs().is_on(light));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{said}");
    assert!(said.contains("stop"), "{said}");
    assert!(!rig.outputs().is_on(light) && !flat.exists());
}
