//! The whole daemon on an emulated rig that turns at a constant speed while its camera runs freely.
#![cfg(feature = "aravis")]

use crate::common::bench::plan as run_plan;
use crate::common::{Daemon, configured, json, port, run, stderr};
use hardware_sim::scene::{Exposure, Scene, SceneSettings, Specimen};
use hardware_sim::{PixelFormat, Pixels, Rig, RigSettings, Sight};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const VIEWS: usize = 42;

fn rig(data: &Path, controller: &str) -> Daemon {
    let views = VIEWS.to_string();
    Daemon::start(data, &["--no-demo", "--small", "--sweep", "--views", &views, "--controller", controller])
}

fn plan() -> Value {
    json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": [{"well": "A01", "specimen": "bead"}]})
}

/// The preflight check of the sweep.
fn checked(daemon: &Daemon) -> Value {
    daemon.wait("readiness", |s| s["ready"] == true);
    loop {
        let (_, found) = daemon.send("POST", "/v1/preflight", &plan());
        // The daemon is looking at its devices at this moment.
        if found["code"] != "busy" {
            return found["checks"].as_array().unwrap().iter().find(|c| c["code"] == "sweep").cloned().unwrap();
        }
    }
}

#[test]
fn a_bead_is_measured_in_one_sweep_and_its_recording_gives_the_same_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = rig(&data, "grbl");
    let check = checked(&daemon);
    assert_eq!(check["passed"], true, "{check}");
    assert!(check["detail"].as_str().unwrap().contains("42 views at 30.0 frames/s"), "{check}");
    assert_eq!(daemon.put_run("bead", &plan()), 201);
    let mut attempts = 0;
    let status = loop {
        attempts += 1;
        let rests = |s: &Value| !s["run"]["outcome"].is_null() || s["state"] == "Held";
        let status = daemon.wait("the outcome", rests);
        if !status["run"]["outcome"].is_null() {
            break status;
        }
        // A busy computer loses frames, and an operator lets the run go on.
        assert!(attempts < 5, "{status}");
        assert!(["camera_no_frame", "revolution_failed"].contains(&status["faults"][0]["code"].as_str().unwrap()), "{status}");
        daemon.go_on("bead", &status["faults"][0]);
    };
    let well = &status["run"]["results"][0];
    assert_eq!(well["outcome"], "succeeded", "{status}");

    let folder = data.join("runs/bead/A01");
    let recording = json(&folder.join("recording.json"));
    assert_eq!(recording["method"]["order"], "sweep");
    let ledger = recording["ledger"].as_array().unwrap();
    let number = |entry: &Value, key: &str| entry[key].as_f64().unwrap();
    let (first, last) = (&ledger[0], &ledger[ledger.len() - 1]);
    assert!(ledger.iter().all(|e| number(&e["swept"], "omega_sd") > 0.0), "each angle has its uncertainty");
    for entry in ledger {
        let expected = number(entry, "view") / VIEWS as f64 * TAU;
        assert!((number(entry, "omega") - number(first, "omega") - expected).abs() < 1e-3, "{entry}");
    }
    assert_eq!((last["closure"].as_bool(), last["view"].as_u64()), (Some(true), Some(VIEWS as u64)));
    let (found, truth) = (number(well, "volume_um3"), number(&recording["truth"], "volume_um3"));
    assert!((found / truth - 1.0).abs() < 0.01, "{found} um^3, truth {truth} um^3");

    let output = run(&["measure", folder.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    let again: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(again["measurement"], json(&folder.join("measurement.json"))["measurement"]);
}

#[test]
fn an_axis_that_cannot_turn_at_a_constant_speed_fails_the_preflight() {
    let dir = tempfile::tempdir().unwrap();
    let daemon = rig(&dir.path().join("data"), "relay");
    let check = checked(&daemon);
    assert_eq!((&check["passed"], &check["blocks"]), (&json!(false), &json!(true)), "{check}");
    let said = check["detail"].as_str().unwrap();
    assert!(said.contains("steps/s at a constant speed") && said.contains("no such move"), "{said}");
    // A run that is started all the same is held, and nothing is ejected.
    assert_eq!(daemon.put_run("bead", &plan()), 201);
    let status = daemon.wait("the hold", |s| s["state"] == "Held");
    assert_eq!(status["faults"][0]["code"], "setup_unusable", "{status}");
}

/// The scene, rendered before the turn: a camera costs the computer of an instrument nothing.
struct Rendered {
    size: (u32, u32),
    frames: Vec<Pixels>,
}

impl Rendered {
    const DIRECTIONS: usize = 336;

    fn of(scene: &Scene) -> Self {
        let at = |i: usize| Exposure { angle_rad: TAU * i as f64 / Self::DIRECTIONS as f64, number: i as u64 };
        Self { size: scene.size(), frames: (0..Self::DIRECTIONS).map(|i| scene.look(&at(i), PixelFormat::BayerRG8)).collect() }
    }
}

impl Sight for Rendered {
    fn size(&self) -> (u32, u32) {
        self.size
    }

    fn look(&self, exposure: &Exposure, _format: PixelFormat) -> Pixels {
        let direction = (exposure.angle_rad / TAU * Self::DIRECTIONS as f64).round().rem_euclid(Self::DIRECTIONS as f64);
        self.frames[direction as usize % Self::DIRECTIONS].clone()
    }
}

/// `cargo test --test daemon sweep::times -- --ignored --nocapture`, on a quiet computer. The phases are the sums of all attempts: between the
/// directions that are rendered a specimen may seem to move, and is then tried again.
#[test]
#[ignore = "prints times, which depend on the computer"]
fn times_of_a_turn_and_from_the_last_frame_to_the_result() {
    for (order, asd) in [("sweep", 84), ("sequential", 84), ("sequential", 21)] {
        let dir = tempfile::tempdir().unwrap();
        let scene = Scene::new(SceneSettings::default());
        scene.load(Some(Specimen::larva(4, 1).unwrap())).unwrap();
        let rig = Rig::start(RigSettings::default(), Arc::new(Rendered::of(&scene))).unwrap();
        let changes = [port(&rig), ("asd = 21", format!("asd = {asd}")), ("order = \"sequential\"", format!("order = \"{order}\""))];
        let (config, data) = configured("vast-grbl.toml", dir.path(), &rig, &changes);
        let daemon = Daemon::serve(&config, &data);
        let planned = json!([{"well": "A01", "specimen": "larva", "dpf": 4}]);
        assert_eq!(daemon.put_run("r1", &run_plan("standard", &planned)), 201);
        daemon.wait("the loader to be asked", |s| s["state"] == "Suspended");
        assert_eq!(daemon.put_loaded("r1", "A01"), 200);
        let began = Instant::now();
        let status = daemon.wait("the end", |s| !s["run"]["results"][0]["outcome"].is_null());
        let took_s = began.elapsed().as_secs_f64();
        let times = json(&data.join("runs/r1/A01/timings.json"));
        println!("{order} {asd}: {took_s:.1} s in all, {}", status["run"]["results"][0]["outcome"]);
        println!("    phases {}", times["phases_s"]);
        for stage in ["store_ms", "profile_ms", "carve_ms", "live_ms", "refine_ms", "calibrate_ms", "surface_ms"] {
            let of_stage: Vec<f64> = times[stage].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
            println!("    {stage} {} times, {:.0} in all", of_stage.len(), of_stage.iter().sum::<f64>());
        }
    }
}
