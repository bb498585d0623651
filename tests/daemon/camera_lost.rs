//! `carved serve` with a camera that is lost. The status reports it. A run continues if the camera returns in time, and otherwise ends in a
//! fault. The fault clears without a restart when the camera answers again.
#![cfg(feature = "aravis")]

use crate::common::{Daemon, configured, json, port, small_frames, small_scene, until};
use hardware_sim::RigSettings;
use hardware_sim::scene::{Scene, Specimen};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Ten times faster than real time; 9 views.
const TIME_SCALE: f64 = 10.0;
const ASD: usize = 9;

/// The daemon is dropped first, so that it releases the devices before they end.
struct Instrument {
    daemon: Daemon,
    rig: hardware_sim::Rig,
    scene: Arc<Scene>,
    data: PathBuf,
    _dir: tempfile::TempDir,
}

impl Instrument {
    fn start() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let scene = small_scene();
        let rig = hardware_sim::Rig::start(RigSettings { time_scale: TIME_SCALE, ..RigSettings::default() }, scene.clone()).unwrap();
        let changes = [port(&rig), ("settle_ms = 50", "settle_ms = 5".to_owned()), ("asd = 21", format!("asd = {ASD}"))];
        let (config, data) = configured("vast-grbl.toml", dir.path(), &rig, &[&changes[..], &small_frames()].concat());
        Self { daemon: Daemon::serve(&config, &data), rig, scene, data, _dir: dir }
    }

    fn faults(&self) -> &hardware_sim::gige::CameraFaults {
        self.rig.faults().camera()
    }

    /// Puts a bead into the capillary and starts its revolution.
    fn begin(&self, run: &str) {
        let wells = json!([{"well": "A01", "specimen": "bead"}]);
        let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells});
        assert_eq!(self.daemon.put_run(run, &plan), 201);
        self.daemon.wait("the loader to be asked", |s| s["run"]["id"] == run && s["state"] == "Suspended");
        self.scene.load(Some(Specimen::bead(500.0).unwrap())).unwrap();
        assert_eq!(self.daemon.put_loaded(run, "A01"), 200);
        self.daemon.wait("the first views", |s| s["specimen"]["view"].as_u64() >= Some(2));
    }

    /// Every recorded view shows the exposure at the recorded angle.
    fn views_are_true(&self, run: &str, views: usize) {
        let record = json(&self.data.join(format!("runs/{run}/A01/recording.json")));
        let ledger = record["ledger"].as_array().unwrap();
        assert_eq!(ledger.len(), views, "{ledger:?}");
        let exposures = self.rig.exposures();
        let hex = |hash: &[u8]| hash.iter().map(|b| format!("{b:02x}")).collect::<String>();
        let of = |entry: &Value| exposures.iter().find(|e| entry["sha256"] == hex(&e.sha256)).expect("a view that was never exposed");
        let zero = of(&ledger[0]).angle_rad - ledger[0]["omega"].as_f64().unwrap();
        for entry in ledger {
            let off_deg = (of(entry).angle_rad - zero - entry["omega"].as_f64().unwrap()).to_degrees();
            assert!(off_deg.abs() < 1e-6, "view {} shows a place {off_deg} deg beside its own", entry["view"]);
            let light = &entry["light"];
            assert!((100.0..250.0).contains(&light["background"].as_f64().unwrap()) && light["focus"].as_f64() > Some(0.0), "{light}");
        }
    }

    fn succeeded(&self, run: &str) {
        let status = self.daemon.wait("the run's end", |s| s["run"]["id"] == run && !s["run"]["outcome"].is_null());
        assert_eq!((&status["run"]["outcome"], &status["faults"]), (&json!("succeeded"), &json!([])), "{status}");
        assert_eq!(status["hardware"]["camera"]["connected"], true, "{status}");
        self.views_are_true(run, ASD + 1);
    }
}

/// R7: a loss of less than ten seconds costs time but no view.
#[test]
fn a_run_goes_on_where_the_camera_comes_back() {
    let instrument = Instrument::start();
    let daemon = &instrument.daemon;
    instrument.begin("stolen");
    let began = Instant::now();
    instrument.faults().steal_control(true);
    let status = daemon.wait("the loss", |s| s["hardware"]["camera"]["connected"] == false);
    println!("theft in the status after {:.1} s: {}", began.elapsed().as_secs_f64(), status["doing"]);
    assert!(status["doing"].as_str().unwrap().contains("camera is lost"), "{status}");
    instrument.faults().steal_control(false);
    instrument.succeeded("stolen");
    assert_eq!(daemon.put_unloaded("stolen", "A01"), 200);

    instrument.begin("restarted");
    instrument.faults().restart();
    instrument.succeeded("restarted");
    assert_eq!(daemon.put_unloaded("restarted", "A01"), 200);

    instrument.begin("unplugged");
    instrument.faults().pull_cable(true);
    daemon.wait("the loss", |s| s["hardware"]["camera"]["connected"] == false);
    instrument.faults().pull_cable(false);
    instrument.succeeded("unplugged");
}

/// The gamma is compared after the last view only.
#[test]
fn a_turn_in_which_another_program_changed_the_gamma_is_not_measured_and_taken_again() {
    let instrument = Instrument::start();
    instrument.begin("r1");
    assert!(instrument.rig.camera().leave("Gamma", 0.5f32.to_bits()));
    instrument.succeeded("r1");
    let set_aside = instrument.data.join("runs/r1/A01.attempt-1");
    assert_eq!(json(&set_aside.join("recording.json"))["ledger"].as_array().unwrap().len(), ASD + 1);
    assert!(!set_aside.join("measurement.json").exists());
}

#[test]
fn a_cable_that_stays_out_holds_the_run_which_continues_by_itself_once_it_is_in() {
    let instrument = Instrument::start();
    let daemon = &instrument.daemon;
    instrument.begin("r1");
    let began = Instant::now();
    instrument.faults().pull_cable(true);
    daemon.wait("the loss", |s| s["hardware"]["camera"]["connected"] == false);
    println!("in the status after {:.1} s", began.elapsed().as_secs_f64());
    let status = daemon.wait("the fault", |s| s["state"] == "Held");
    println!("the run was held after {:.1} s: {}", began.elapsed().as_secs_f64(), status["doing"]);
    let fault = &status["faults"][0];
    assert_eq!(status["faults"].as_array().unwrap().len(), 1, "{status}");
    assert_eq!((&fault["code"], &fault["category"]), (&json!("camera_lost"), &json!("camera")), "{status}");
    assert_eq!((&fault["scheduler_action"], &fault["recoverable"]), (&json!("pause_instrument"), &json!(true)), "{status}");
    assert_eq!((&status["run"]["outcome"], &status["ready"]), (&Value::Null, &json!(false)), "{status}");
    let why = status["not_ready_reason"].as_str().unwrap();
    assert!(why.contains("camera") && why.contains("when it answers"), "{why}");
    // The loader can take the specimen out without waiting for the camera.
    assert_eq!(daemon.put_unloaded("r1", "A01"), 200);
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": [{"well": "A01"}]});
    assert_eq!(daemon.put_run("other", &plan), 409, "one run at a time");
    assert_eq!(daemon.post("/v1/runs/r1/unhold"), 503);

    // The held run searches its camera again and again. Aravis sends the first request of a search at most seven times.
    let unheard = instrument.faults().unheard_requests();
    until("a second search", || instrument.faults().unheard_requests() > unheard + 7);
    let status = daemon.status();
    assert_eq!((&status["state"], &status["hardware"]["camera"]["connected"]), (&json!("Held"), &json!(false)), "{status}");
    assert_eq!(status["faults"].as_array().unwrap().len(), 1, "{status}");
    instrument.faults().pull_cable(false);
    let plugged = Instant::now();
    let status = daemon.wait("the loader to be asked again", |s| s["state"] == "Suspended");
    println!("continues {:.1} s after the cable was in", plugged.elapsed().as_secs_f64());
    assert_eq!(status["faults"], json!([]), "{status}");
    assert_eq!(status["hardware"]["camera"]["connected"], true, "{status}");
    let events = std::fs::read_to_string(instrument.data.join("events.jsonl")).unwrap();
    for kind in ["fault.raised", "fault.cleared", "specimen.interrupted", "run.held", "run.resumed"] {
        assert!(events.contains(kind), "{kind}: {events}");
    }
    assert_eq!(daemon.put_loaded("r1", "A01"), 200);
    instrument.succeeded("r1");
    let first = json(&instrument.data.join("runs/r1/A01.attempt-1/recording.json"));
    assert!(first["ledger"].as_array().unwrap().len() >= 2, "what there is of the first attempt is kept: {first}");
}

/// An idle daemon also detects the loss, and its end.
#[test]
fn an_idle_instrument_says_that_its_camera_is_gone_and_back() {
    let instrument = Instrument::start();
    let daemon = &instrument.daemon;
    daemon.wait("readiness", |s| s["ready"] == true);
    instrument.faults().steal_control(true);
    let status = daemon.wait("the fault", |s| s["faults"].as_array().is_some_and(|f| !f.is_empty()));
    assert_eq!((&status["faults"][0]["code"], &status["ready"]), (&json!("camera_lost"), &json!(false)), "{status}");
    assert_eq!(status["state"], "Idle", "{status}");
    instrument.faults().steal_control(false);
    let status = daemon.wait("the camera", |s| s["ready"] == true);
    assert_eq!(status["faults"], json!([]), "{status}");
    instrument.begin("r1");
    instrument.succeeded("r1");
}
