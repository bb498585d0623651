//! `carved serve` on a stock VAST through each of its two interfaces, with the configuration shipped for it.
//!
//! ```text
//! test = plate-loader and VAST's sampler ── HTTP ──► carved serve (child) ── pty or TCP, GigE ──► emulated rig (in this process)
//!   └──────────── true angle, exposures, what VAST did with its list ────────────┘
//! ```
#![cfg(feature = "aravis")]

use crate::common::{Daemon, configured, json, patient, port, small_frames, small_scene, until};
use hardware_sim::scene::{Scene, Specimen};
use hardware_sim::{Controller, RigSettings, bridge, relay};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const STEPS: f64 = 500.0;
const ASD: u32 = 5;
/// The configured 90 deg/s, and the speed-up of everything mechanical.
const SPEED_DEG_PER_S: f64 = 90.0;
const SCALE: f64 = 10.0;

struct Instrument {
    daemon: Daemon,
    rig: hardware_sim::Rig,
    scene: Arc<Scene>,
    data: PathBuf,
    dir: tempfile::TempDir,
}

impl Instrument {
    fn start(shipped: &str, settings: impl FnOnce(&Path) -> RigSettings) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let list = dir.path().join("external.txt");
        let scene = small_scene();
        let rig = hardware_sim::Rig::start(RigSettings { time_scale: SCALE, ..settings(&list) }, scene.clone()).unwrap();
        let door = match rig.relay_address() {
            Some(relay) => vec![("192.168.10.3:5000", relay.to_string())],
            None => vec![port(&rig), ("/mnt/vast/external.txt", list.display().to_string())],
        };
        let pace = [
            ("settle_ms = 50", "settle_ms = 5".to_owned()),
            ("speed_deg_per_s = 90.0", format!("speed_deg_per_s = {:?}", SPEED_DEG_PER_S * SCALE)),
            ("asd = 21", format!("asd = {ASD}")),
        ];
        let (config, data) = configured(shipped, dir.path(), &rig, &[door, pace.into(), small_frames().into(), patient().into()].concat());
        Self { daemon: Daemon::serve(&config, &data), rig, scene, data, dir }
    }

    fn on_a_bridge() -> (Self, bridge::Knobs) {
        let knobs = bridge::Knobs::default();
        let at = |list: &Path| {
            let machine =
                bridge::Settings { speed_deg_per_s: SPEED_DEG_PER_S, knobs: knobs.clone(), ..bridge::Settings::reading(list.to_owned()) };
            RigSettings { controller: Controller::Bridge(machine), ..RigSettings::default() }
        };
        (Self::start("vast-bridge.toml", at), knobs)
    }

    fn start_run(&self, run: &str, wells: &[&str]) {
        let map: Vec<Value> = wells.iter().map(|well| json!({"well": well, "specimen": "bead"})).collect();
        let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": map});
        assert_eq!(self.daemon.put_run(run, &plan), 201);
    }

    fn awaits(&self, run: &str, well: &str) {
        let is_asked = |s: &Value| s["state"] == "Suspended" && s["plate"]["needs"].as_str().is_some_and(|n| n.contains(well));
        self.daemon.wait(&format!("{run} to ask for {well}"), |s| s["run"]["id"] == run && (is_asked(s) || !s["run"]["outcome"].is_null()));
    }

    fn load(&self, run: &str, well: &str, specimen: Option<Specimen>) {
        self.scene.load(specimen).unwrap();
        assert_eq!(self.daemon.put_loaded(run, well), 200);
    }

    /// A person loads VAST's list when the page asks for it, and lets the run go on.
    fn load_list(&self, run: &str, vast: &bridge::Knobs) {
        let asks = |s: &Value| s["state"] == "Held" && s["faults"][0]["code"] == "vast_list";
        let status = self.daemon.wait("the question for the list", asks);
        let fault = &status["faults"][0];
        let list = self.dir.path().join("external.txt");
        assert!(fault["message"].as_str().unwrap().contains(list.to_str().unwrap()), "{fault}");
        assert!(list.exists(), "the list is there before the question");
        assert_eq!(status["specimen"]["in_capillary"], false, "{status}");
        vast.load_list();
        self.daemon.go_on(run, fault);
    }

    /// Checks that every view of a well was exposed at the angle in its ledger, counted from the first view.
    fn holds(&self, run: &str, well: &str) {
        let recording = json(&self.data.join("runs").join(run).join(well).join("recording.json"));
        let ledger = recording["ledger"].as_array().unwrap();
        assert_eq!(ledger.len(), ASD as usize + 1);
        let exposures = self.rig.exposures();
        let angle =
            |entry: &Value| exposures.iter().rev().find(|e| e.sent && Some(e.frame_id) == entry["frame_id"].as_u64()).unwrap().angle_rad;
        for entry in ledger {
            let off_turns = (angle(entry) - angle(&ledger[0]) - entry["omega"].as_f64().unwrap()) / TAU;
            // A whole turn more or less shows the same view.
            let off_steps = (off_turns - off_turns.round()) * STEPS;
            assert!(off_steps.abs() < 1e-6, "well {well}, view {}: exposed {off_steps} steps from where the ledger says", entry["view"]);
        }
    }
}

fn bead() -> Specimen {
    Specimen::bead(500.0).unwrap()
}

#[test]
fn vast_is_stepped_through_its_list_well_by_well_and_let_go_after_each() {
    let (rig, vast) = Instrument::on_a_bridge();
    rig.start_run("plate", &["A01", "A02", "A03"]);
    rig.load_list("plate", &vast);
    for (number, (well, specimen)) in [("A01", Some(bead())), ("A02", None), ("A03", Some(bead()))].into_iter().enumerate() {
        rig.awaits("plate", well);
        let list = std::fs::read_to_string(rig.dir.path().join("external.txt")).unwrap();
        assert_eq!(list.lines().count(), ASD as usize + 1, "the list is there before the specimen");
        until("VAST to have done with the specimen before", || vast.finished_lists() == number as u32);
        vast.take_up_specimen();
        rig.load("plate", well, specimen);
    }
    let status = rig.daemon.wait_for_outcome();
    let outcomes: Vec<_> = status["run"]["results"].as_array().unwrap().iter().map(|well| well["outcome"].clone()).collect();
    assert_eq!(outcomes, ["succeeded", "skipped", "succeeded"], "{status}");
    assert_eq!(status["hardware"]["rotation"]["can_stop"], false);
    assert_eq!(vast.finished_lists(), 3, "one that is skipped is gone through as well");
    rig.holds("plate", "A01");
    rig.holds("plate", "A03");
}

#[test]
fn a_list_that_nobody_loaded_before_the_abort_is_asked_for_again() {
    let (rig, vast) = Instrument::on_a_bridge();
    rig.start_run("first", &["A01"]);
    rig.daemon.wait("the question for the list", |s| s["state"] == "Held" && s["faults"][0]["code"] == "vast_list");
    assert_eq!(rig.daemon.post("/v1/runs/first/abort"), 200);
    rig.daemon.wait("the abort", |s| s["run"]["outcome"] == "aborted");
    for fault in rig.daemon.status()["faults"].as_array().unwrap() {
        assert_eq!(rig.daemon.post(&format!("/v1/faults/{}/acknowledge", fault["seq"])), 200);
    }
    rig.start_run("second", &["A01"]);
    rig.load_list("second", &vast);
    rig.awaits("second", "A01");
}

#[test]
fn an_abort_ends_the_triggers_vast_ends_its_step_and_the_next_run_begins_anew() {
    let (rig, vast) = Instrument::on_a_bridge();
    rig.start_run("first", &["A01"]);
    rig.load_list("first", &vast);
    rig.awaits("first", "A01");
    vast.take_up_specimen();
    rig.load("first", "A01", Some(bead()));
    let (step, steps) = (TAU / f64::from(ASD), || rig.rig.shaft().angle_rad());
    until("the first turn", || steps() > 0.1 * step);
    assert_eq!(rig.daemon.post("/v1/runs/first/abort"), 200);
    let status = rig.daemon.wait("the abort", |s| s["state"] == "Aborted");
    assert_eq!((&status["run"]["outcome"], &status["faults"]), (&json!("aborted"), &json!([])), "{status}");
    assert_eq!(status["hardware"]["rotation"]["referenced"], false, "{status}");
    let off = |angle: f64| (angle / step - (angle / step).round()).abs();
    until("VAST to end its step", || off(steps()) < 1e-6);
    let (stands, exposures) = (steps(), rig.rig.exposures().len());
    for _ in 0..50 {
        rig.daemon.status();
        assert_eq!(steps().to_bits(), stands.to_bits(), "VAST was triggered again");
    }
    assert_eq!(rig.rig.exposures().len(), exposures, "a frame was taken");

    assert_eq!(rig.daemon.put_unloaded("first", "A01"), 200);
    rig.start_run("second", &["A01"]);
    rig.awaits("second", "A01");
    vast.take_up_specimen();
    rig.load("second", "A01", Some(bead()));
    assert_eq!(rig.daemon.wait_for_outcome()["run"]["outcome"], "succeeded");
    rig.holds("second", "A01");
}

#[test]
fn a_trigger_that_vast_does_not_see_holds_the_run_and_calls_a_person() {
    let (rig, vast) = Instrument::on_a_bridge();
    rig.start_run("run", &["A01"]);
    rig.load_list("run", &vast);
    rig.awaits("run", "A01");
    vast.miss_triggers(1);
    vast.take_up_specimen();
    rig.load("run", "A01", Some(bead()));
    let status = rig.daemon.wait("the fault", |s| s["state"] == "Held");
    let fault = &status["faults"][0];
    assert_eq!((&fault["code"], &fault["scheduler_action"]), (&json!("rotation_suspect"), &json!("escalate_operator")), "{status}");
    assert!(fault["message"].as_str().unwrap().contains("not in position"), "{fault}");
    assert_eq!(rig.daemon.post("/v1/runs/run/unhold"), 409, "not before somebody has looked");
}

#[test]
fn a_relay_turns_the_whole_daemon() {
    let machine = relay::Settings { speed_deg_per_s: SPEED_DEG_PER_S, ..relay::Settings::default() };
    let rig = Instrument::start("vast-relay.toml", |_| RigSettings { relay: Some(machine), ..RigSettings::default() });
    rig.start_run("plate", &["A01"]);
    rig.awaits("plate", "A01");
    rig.load("plate", "A01", Some(bead()));
    let status = rig.daemon.wait_for_outcome();
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    assert!(status["hardware"]["rotation"]["identity"].as_str().unwrap().contains("VAST relay"), "{status}");
    rig.holds("plate", "A01");
}
