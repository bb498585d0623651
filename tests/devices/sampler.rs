//! An external sampler that reports by a wire whether a specimen is present. The wire is read through the status reports of the emulated
//! controller. The tests cover every fault of this wire and a whole run.

use crate::common::controllers;
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Grbl, Reference};
use carved_devices::sampler::{Expected, Sampler, TriggerSampler, TriggerSettings};
use carved_devices::{DeviceError, RotationAxis};
use hardware_sim::grbl::Settings;
use hardware_sim::sampler::Next;
use hardware_sim::serial::Button;
use hardware_sim::{Controller, Rig, RigSettings, SamplerSettings, TestCard, VendorSampler};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const TRIGGER: TriggerSettings =
    TriggerSettings { inverted: false, debounce_ms: 30, load_timeout_ms: 5000, eject_timeout_ms: 1500, done_output: true };
/// A load takes 0.8 s, so that it ends after the sampler was asked, and long before its timeout.
const QUICK: SamplerSettings = SamplerSettings { load_s: 16.0, eject_s: 1.0, bounce_s: 0.4 };

struct Bench {
    rig: Rig,
    sampler: TriggerSampler,
    axis: Box<dyn RotationAxis>,
    /// Whether a specimen is in the capillary.
    filled: Arc<AtomicBool>,
}

impl Bench {
    fn new(controller: Controller) -> Self {
        let settings = RigSettings { time_scale: 20.0, controller, sampler: Some(QUICK), ..RigSettings::default() };
        let rig = Rig::start(settings, Arc::new(TestCard::new(64, 64))).unwrap();
        let grbl = Grbl::open(controllers::grbl(controllers::serial_port(&rig), Reference::Here));
        let (sampler, axis) = TriggerSampler::beside(Box::new(grbl.unwrap()), TRIGGER).unwrap();
        Self { rig, sampler, axis, filled: Arc::default() }
    }

    fn machine(&self) -> &VendorSampler {
        self.rig.sampler().unwrap()
    }

    fn give(&self) {
        let (brought, taken) = (Arc::clone(&self.filled), Arc::clone(&self.filled));
        let bring = Box::new(move || brought.store(true, Ordering::SeqCst));
        let take_away = Box::new(move || taken.store(false, Ordering::SeqCst));
        self.machine().give(Next { bring, take_away });
    }

    fn is_filled(&self) -> bool {
        self.filled.load(Ordering::SeqCst)
    }

    fn load(&mut self, well: &str) -> Result<bool, DeviceError> {
        let expected = Expected { well, bead: true, dpf: None, asked_before: false };
        self.sampler.load(self.axis.as_mut(), expected, &CancelToken::new()).map(|loaded| loaded.is_some())
    }

    /// Loads a specimen and references the axis, which resets the controller and its outputs.
    fn loaded(&mut self, well: &str) {
        self.give();
        assert!(self.load(well).unwrap());
        assert!(self.is_filled());
        self.axis.reference(&CancelToken::new()).unwrap();
    }

    fn eject(&mut self, well: &str) -> Result<(), DeviceError> {
        self.sampler.eject(self.axis.as_mut(), well, &CancelToken::new())
    }
}

fn words<T: std::fmt::Debug>(result: Result<T, DeviceError>) -> String {
    let error = result.unwrap_err();
    assert!(matches!(error, DeviceError::Sampler { .. }), "{error}");
    error.to_string()
}

#[test]
fn specimens_come_and_go_by_the_wire_whose_contacts_bounce() {
    for controller in [Controller::default(), Controller::GrblHal(Settings::default())] {
        let mut bench = Bench::new(controller);
        for (number, well) in ["A01", "A02", "A03"].into_iter().enumerate() {
            bench.loaded(well);
            for stop in 1..=4 {
                bench.axis.move_to(Steps(125 * stop)).unwrap();
            }
            bench.eject(well).unwrap();
            assert!(!bench.is_filled(), "{well}: ejected before it is over");
            assert_eq!(bench.machine().ejected(), number as u32 + 1);
        }
    }
}

#[test]
fn a_specimen_that_never_comes_or_too_late_is_nobodys() {
    let mut bench = Bench::new(Controller::default());
    bench.give();
    bench.machine().set_load_s(f64::INFINITY);
    let said = words(bench.load("A01"));
    assert!(said.contains("well A01") && said.contains("no specimen within 5000 ms"), "{said}");
    bench.machine().set_load_s(0.0);
    let said = words(bench.load("A02"));
    assert!(said.contains("well A02") && said.contains("none was asked for"), "{said}");
}

#[test]
fn an_input_that_is_stuck_is_seen_before_a_load_and_after_an_eject() {
    let mut bench = Bench::new(Controller::default());
    bench.loaded("A01");
    bench.machine().force_line(Some(true));
    let said = words(bench.eject("A01"));
    assert!(said.contains("still says") && said.contains("stuck"), "{said}");
    // The next load finds the same state.
    assert!(words(bench.load("A02")).contains("A01"));
    bench.machine().force_line(None);
    bench.give();
    assert!(bench.load("A02").unwrap());
    let mut other = Bench::new(Controller::default());
    other.machine().force_line(Some(true));
    assert!(words(other.load("A01")).contains("the input is stuck"));
}

#[test]
fn a_specimen_that_slips_out_and_a_wire_that_is_pulled_end_the_turn() {
    for pulled in [false, true] {
        let mut bench = Bench::new(Controller::default());
        bench.loaded("A01");
        bench.axis.move_to(Steps(100)).unwrap();
        if pulled {
            bench.machine().force_line(Some(false));
        } else {
            bench.machine().lose_specimen();
        }
        let said = words(bench.axis.move_to(Steps(200)));
        assert!(said.contains("A01") && said.contains("mid-turn"), "{said}");
        // According to the wire the specimen is gone. The sampler still ejects what may be left.
        bench.eject("A01").unwrap();
        bench.machine().force_line(None);
        bench.axis.move_to(Steps(0)).unwrap();
    }
}

#[test]
fn a_stopped_run_leaves_its_specimen_to_the_next_load() {
    let mut bench = Bench::new(Controller::default());
    bench.loaded("A01");
    bench.axis.stop_handle().stop();
    let cancel = CancelToken::new();
    cancel.cancel();
    assert!(matches!(bench.sampler.eject(bench.axis.as_mut(), "A01", &cancel), Err(DeviceError::Stopped)));
    assert!(bench.is_filled());
    bench.give();
    assert!(bench.load("B01").unwrap());
    assert_eq!(bench.machine().ejected(), 1, "A01's specimen is not taken for B01's");
}

/// A specimen that arrives between two runs was not asked for: the next run does not take it for that of its first well.
#[test]
fn a_specimen_that_comes_in_between_two_runs_is_seen_and_refused() {
    let mut bench = Bench::new(Controller::default());
    bench.sampler.begin_run();
    bench.loaded("A01");
    bench.eject("A01").unwrap();
    bench.give();
    let until = Instant::now() + Duration::from_secs(60);
    while bench.sampler.sees_specimen() != Some(true) {
        assert!(Instant::now() < until, "it is never seen");
        bench.sampler.look(bench.axis.as_mut()).unwrap();
    }
    assert!(bench.is_filled());
    bench.sampler.begin_run();
    assert!(words(bench.load("A01")).contains("none was asked for"));
}

/// While a person has stopped the controller no output is switched: otherwise the specimen would be ejected when the hold ends.
#[test]
fn a_held_controller_is_not_reset_to_eject_and_switches_nothing_when_it_is_released() {
    for door in [false, true] {
        let mut bench = Bench::new(Controller::default());
        bench.loaded("A01");
        let (hold, resume) = if door { (Button::Door, None) } else { (Button::FeedHold, Some(Button::FeedHold)) };
        bench.rig.faults().button(hold, true);
        assert!(matches!(bench.axis.move_to(Steps(100)), Err(DeviceError::Intervention { .. })));
        for stopped in [false, true] {
            if stopped {
                bench.axis.stop_handle().end_motion();
            }
            let error = bench.eject("A01").unwrap_err();
            assert!(matches!(error, DeviceError::Intervention { .. }), "{error}");
            assert!(matches!(bench.load("A02"), Err(DeviceError::Intervention { .. })));
        }
        bench.rig.faults().button(resume.unwrap_or(Button::Door), false);
        bench.rig.faults().button(Button::CycleStart, true);
        bench.axis.reference(&CancelToken::new()).unwrap();
        assert!(bench.is_filled() && bench.machine().ejected() == 0, "the specimen has been kept");
        bench.axis.move_to(Steps(100)).unwrap();
        bench.eject("A01").unwrap();
    }
}

/// A fault ends a turn by a stop, and a controller in alarm ignores commands. The specimen must be ejected nevertheless.
#[test]
fn a_fault_of_the_axis_keeps_no_specimen_in() {
    for alarm in [false, true] {
        let mut bench = Bench::new(Controller::default());
        bench.loaded("A01");
        if alarm {
            bench.rig.faults().serial().rewrite_next(b"Idle", b"Alarm");
            assert!(bench.axis.move_to(Steps(100)).is_err());
        } else {
            bench.axis.stop_handle().stop();
        }
        bench.eject("A01").unwrap();
        assert!(!bench.is_filled());
        bench.loaded("A02");
        bench.axis.move_to(Steps(100)).unwrap();
    }
}

/// A stopped run does not eject. The next run ejects the specimen, or somebody takes it out.
#[cfg(feature = "aravis")]
#[test]
fn what_a_run_that_was_cut_short_left_inside_is_ejected_by_the_next() {
    use serde_json::{Value, json};
    let dir = tempfile::tempdir().unwrap();
    let start = || crate::common::Daemon::start(dir.path(), &["--no-demo", "--small", "--time-scale", "20", "--sampler", "trigger"]);
    let plan = |well: &str| json!({"plate_barcode": "P-1", "method": "standard", "operator": "t", "plate_map": [{"well": well, "specimen": "bead"}]});
    let turning = |daemon: &crate::common::Daemon, well: &str| {
        daemon.wait("the turn", |s| s["specimen"]["well"] == well && s["specimen"]["view"].as_u64() >= Some(2));
    };
    let left = |status: &Value, well: &str| {
        assert_eq!((&status["specimen"]["well"], &status["specimen"]["in_capillary"]), (&json!(well), &json!(true)), "{status}");
        assert_eq!((&status["plate"]["removable"], &status["plate"]["take_out"]), (&json!(false), &json!(well)), "{status}");
    };
    let daemon = start();
    assert_eq!(daemon.put_run("r1", &plan("A01")), 201);
    turning(&daemon, "A01");
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200);
    left(&daemon.wait("the abort", |s| s["state"] == "Aborted" && s["ready"] == true), "A01");

    assert_eq!(daemon.put_run("r2", &plan("B01")), 201);
    turning(&daemon, "B01");
    daemon.signal("TERM");
    assert_eq!(daemon.ended(), Some(0));
    let daemon = start();
    left(&daemon.wait("the run of before", |s| s["state"] == "Stopped" && s["ready"] == true), "B01");
    assert_eq!(daemon.put_run("r3", &plan("C01")), 201);
    let status = daemon.wait("the run's end", |s| s["run"]["id"] == "r3" && !s["run"]["outcome"].is_null());
    assert_eq!(status["plate"]["removable"], true, "{status}");

    let events = std::fs::read_to_string(dir.path().join("events.jsonl")).unwrap();
    let events: Vec<Value> = events.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for (run, well) in [("r2", "A01"), ("r3", "B01")] {
        let first = events.iter().find(|e| e["run"] == run && e["kind"] == "specimen.phase").unwrap();
        assert_eq!((&first["well"], &first["data"]["phase"]), (&json!(well), &json!("eject")), "{run}");
    }
}

/// One run with every device of the emulated rig besides axis and camera.
#[cfg(feature = "aravis")]
#[test]
fn a_run_on_the_wires_with_a_second_camera_and_a_translation() {
    use serde_json::json;
    let dir = tempfile::tempdir().unwrap();
    let options = ["--no-demo", "--small", "--time-scale", "20", "--sampler", "trigger", "--second-camera", "--translation"];
    let daemon = crate::common::Daemon::start(dir.path(), &options);
    // The status answers before all devices are open.
    let at_rest = daemon.wait("the translation axis", |status| status["hardware"]["translation"]["connected"] == true);
    assert_eq!(at_rest["hardware"]["translation"]["referenced"], false);
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "t", "plate_map": [{"well": "A01", "specimen": "bead"}]});
    assert_eq!(daemon.put_run("r1", &plan), 201);
    let status = daemon.wait_for_outcome();
    let well = &status["run"]["results"][0];
    assert_eq!(well["outcome"], "succeeded", "{status}");
    let diameter_um = well["diameter_um"].as_f64().unwrap();
    assert!((diameter_um - 500.0).abs() < 5.0, "{well}");
    assert!(well["signal_per_nl"].as_f64().unwrap() > 0.0, "{well}");
    let hardware = &status["hardware"];
    assert!(hardware["camera_second"]["completed_frames"].as_u64().unwrap() >= 22, "{hardware}");
    let translation = &hardware["translation"];
    assert_eq!(translation["referenced"], true, "{hardware}");
    // At 21.333 steps per um the position is the whole step nearest to the configured one.
    assert!((translation["position_um"].as_f64().unwrap() + 5000.0).abs() < 0.03, "{translation}");
    assert_eq!(translation["position_steps"].as_i64().unwrap(), -106_667);
    assert!(hardware["camera"]["light"]["background"].as_f64().unwrap() > 100.0, "{hardware}");
    assert_eq!(status["faults"], json!([]));
}
