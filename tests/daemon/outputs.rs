//! A light at an output of the controller that turns the capillary. The emulated camera sees nothing while it is off.
#![cfg(feature = "aravis")]

use crate::common::bench::{bead, plan};
use crate::common::{Daemon, configured, json, patient, port, small_frames, small_scene, until};
use hardware_sim::scene::Contents;
use hardware_sim::{Controller, OutputPin, Rig, RigSettings, grbl, zaber};
use serde_json::{Value, json};
use std::path::PathBuf;

/// A rig whose light is switched by an output of its controller, with a bead in its capillary. The daemon is dropped first.
struct Lit {
    daemon: Daemon,
    rig: Rig,
    pin: OutputPin,
    data: PathBuf,
    _dir: tempfile::TempDir,
}

impl Lit {
    /// 21 quick views by a Grbl controller. The light is steady after `settle_ms`.
    fn quick(settle_ms: u32) -> Self {
        let settings = RigSettings { time_scale: 10.0, controller: Controller::Grbl(grbl::Settings::default()), ..RigSettings::default() };
        Self::start(settings, OutputPin::Flood, "vast-grbl.toml", "\"flood_coolant\"", settle_ms, &[])
    }

    /// Three views by a Zaber controller, 5 s apart. Its outputs hold their level through a stop and through a lost connection, so that
    /// nothing but carved switches the light off. (Grbl's reset does.)
    fn slow() -> Self {
        const MAXSPEED: u32 = 700;
        let firmware = zaber::Settings { maxspeed: MAXSPEED, ..zaber::Settings::default() };
        let settings = RigSettings { controller: Controller::Zaber(firmware), ..RigSettings::default() };
        let changes = [
            ("maxspeed = 5243", format!("maxspeed = {MAXSPEED}")),
            ("reference = \"home\"", "reference = \"here\"".into()),
            ("asd = 21", "asd = 3".into()),
        ];
        Self::start(settings, OutputPin::Number(1), "vast-zaber.toml", "1", 5, &changes)
    }

    fn start(settings: RigSettings, pin: OutputPin, shipped: &str, named: &str, settle_ms: u32, changes: &[(&str, String)]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let scene = small_scene();
        scene.load(Contents::from(bead("A01", 400.0).2)).unwrap();
        let rig = Rig::start(RigSettings { serial_link: Some(dir.path().join("motor")), light: Some(pin), ..settings }, scene).unwrap();
        let common = [port(&rig), ("settle_ms = 50", "settle_ms = 5".into())];
        let (config, data) = configured(shipped, dir.path(), &rig, &[&common[..], &small_frames(), &patient(), changes].concat());
        let light = format!("\n[rotation.outputs.light]\npin = {named}\non = \"views\"\nsettle_ms = {settle_ms}\n");
        std::fs::write(&config, std::fs::read_to_string(&config).unwrap() + &light).unwrap();
        Self { daemon: Daemon::serve(&config, &data), rig, pin, data, _dir: dir }
    }

    fn is_on(&self) -> bool {
        self.rig.outputs().is_on(self.pin)
    }

    fn begin(&self, run: &str) {
        let (code, said) = self.daemon.send("PUT", &format!("/v1/runs/{run}"), &plan("standard", &json!([bead("A01", 400.0).1])));
        assert_eq!(code, 201, "{said}");
        self.daemon.wait("the loader to be asked", |s| s["state"] == "Suspended");
        assert_eq!(self.daemon.put_loaded(run, "A01"), 200);
    }

    /// Waits until the status has the light in this state, and returns it.
    fn says(&self, state: &str) -> Value {
        self.daemon
            .wait("the light in the status", |s| s["hardware"]["outputs"] == json!([{"name": "light", "state": state, "trouble": null}]))
    }
}

#[test]
fn the_light_is_on_for_every_frame_and_at_no_other_time() {
    let lit = Lit::quick(5);
    lit.says("off");
    assert!(lit.rig.outputs().switched().is_empty());
    // The frame that checks a plan is lit too.
    let (code, checks) = lit.daemon.send("POST", "/v1/preflight", &plan("standard", &json!([bead("A01", 400.0).1])));
    assert_eq!(code, 200, "{checks}");
    let passed = |code: &str| checks["checks"].as_array().unwrap().iter().find(|c| c["code"] == code).map(|c| c["passed"] == true);
    assert_eq!((passed("outputs"), passed("light")), (Some(true), Some(true)), "{checks}");
    assert!(!lit.is_on());
    lit.begin("r1");
    lit.daemon.wait("the light on", |s| s["hardware"]["outputs"][0]["state"] == "on");
    let status = lit.daemon.wait_for_outcome();
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    lit.says("off");
    assert!(!lit.is_on());
    let recording = json(&lit.data.join("runs/r1/A01/recording.json"));
    let ledger = recording["ledger"].as_array().unwrap();
    assert_eq!(ledger.len(), 22);
    for entry in ledger {
        assert!(entry["light"]["background"].as_f64().unwrap() > 100.0, "a dark frame: {entry}");
    }
    let switched: Vec<bool> = lit.rig.outputs().switched().iter().map(|(_, on)| *on).collect();
    assert_eq!(switched, [true, false, true, false], "for the check of the plan, and for the specimen");
}

#[test]
fn an_abort_in_a_move_switches_the_light_off() {
    let lit = Lit::slow();
    lit.begin("r1");
    lit.daemon.wait("the first view", |s| s["specimen"]["view"].as_u64() >= Some(1));
    until("the axis to turn", || lit.rig.shaft().is_turning());
    assert!(lit.is_on());
    assert_eq!(lit.daemon.post("/v1/runs/r1/abort"), 200);
    lit.daemon.wait("the abort", |s| s["state"] == "Aborted");
    lit.says("off");
    assert!(!lit.is_on());
}

#[test]
fn the_light_of_a_lost_controller_is_unknown_and_is_off_when_it_is_back() {
    let lit = Lit::slow();
    lit.begin("r1");
    lit.daemon.wait("the first view", |s| s["specimen"]["view"].as_u64() >= Some(1));
    lit.rig.faults().unplug_serial();
    lit.says("unknown");
    lit.rig.faults().replug_serial().unwrap();
    lit.says("off");
    assert!(!lit.is_on());
}

#[test]
fn a_light_that_is_not_switched_on_holds_the_run_with_the_specimen() {
    let lit = Lit::quick(5);
    lit.rig.outputs().refuse(OutputPin::Flood, true);
    lit.begin("r1");
    let status = lit.daemon.wait("the hold", |s| s["state"] == "Held");
    let fault = &status["faults"][0];
    assert_eq!(fault["code"], "output_failed", "{status}");
    assert!(fault["message"].as_str().unwrap().contains("\"light\" was not switched on"), "{fault}");
    assert_eq!(status["plate"]["take_out"], Value::Null, "{status}");
    lit.rig.outputs().refuse(OutputPin::Flood, false);
    lit.daemon.go_on("r1", fault);
    let status = lit.daemon.wait_for_outcome();
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
}

#[test]
fn the_emergency_stop_ends_the_check_of_a_plan_that_waits_for_a_steady_light() {
    let lit = Lit::quick(60_000);
    let checks = std::thread::scope(|scope| {
        let check = scope.spawn(|| lit.daemon.send("POST", "/v1/preflight", &plan("standard", &json!([bead("A01", 400.0).1]))));
        until("the light on", || lit.is_on());
        assert_eq!(lit.daemon.post("/v1/emergency-stop"), 200);
        check.join().unwrap()
    });
    // The check would have passed after the minute that the light takes to be steady.
    let outputs = checks.1["checks"].as_array().unwrap().iter().find(|check| check["code"] == "outputs").unwrap().clone();
    assert_eq!((checks.0, &outputs["passed"]), (200, &json!(false)), "{outputs}");
    assert!(!lit.is_on());
}

/// Nobody waits for a picture at rest: neither a run, nor the emergency stop. The light would take a minute to be steady.
#[test]
fn a_picture_at_rest_gives_way_to_a_run_and_to_the_emergency_stop() {
    let lit = Lit::quick(60_000);
    let while_waiting = |then: &dyn Fn()| {
        std::thread::scope(|scope| {
            let picture = scope.spawn(|| lit.daemon.send("POST", "/v1/live/picture", &Value::Null));
            until("the light on", || lit.is_on());
            then();
            picture.join().unwrap()
        })
    };
    let (code, problem) = while_waiting(&|| {
        let (code, said) = lit.daemon.send("PUT", "/v1/runs/r1", &plan("standard", &json!([bead("A01", 400.0).1])));
        assert_eq!(code, 201, "{said}");
    });
    assert_eq!((code, &problem["code"]), (503, &json!("no_picture")), "{problem}");
    assert!(!lit.is_on());
    let (code, problem) = lit.daemon.send("POST", "/v1/live/picture", &Value::Null);
    assert_eq!((code, &problem["code"]), (409, &json!("wrong_state")), "during a run: {problem}");
    assert_eq!(lit.daemon.post("/v1/runs/r1/abort"), 200);
    lit.daemon.wait("the end of the run", |s| s["state"] == "Aborted");

    let (code, problem) = while_waiting(&|| assert_eq!(lit.daemon.post("/v1/emergency-stop"), 200));
    assert_eq!((code, &problem["code"]), (503, &json!("no_picture")), "{problem}");
    assert!(!lit.is_on());
    let (code, problem) = lit.daemon.send("POST", "/v1/live/picture", &Value::Null);
    assert_eq!((code, &problem["code"]), (409, &json!("fault_stands")), "nothing is switched before a person has looked: {problem}");
}
