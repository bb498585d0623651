//! Disturbances of a single well: a view that does not belong to it, a specimen that moved, a phase that takes too long, a specimen that is
//! partly outside the picture.
//!
//! ```text
//! test = plate-loader ── HTTP ──► carved serve (child) ── pty, GigE ──► emulated rig whose sight this test bends
//! ```
#![cfg(feature = "aravis")]

use crate::common::spoiled::Spoiled;
use crate::common::{Instrument, Rate, SLOW, SLOW_REFERENCE, json, run, standing, stderr};
use hardware_sim::SamplerSettings;
use hardware_sim::sampler::Next;
use hardware_sim::scene::{Contents, Placement, Specimen};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

/// No disturbance.
const STRAIGHT: (Range<f64>, f64) = (0.0..0.0, 0.0);

/// A method of 12 views.
const QUICK: Rate = Rate { asd: 12, ..crate::common::QUICK };

fn start(rate: &Rate, policy: &str, (at_rad, by_rad): (Range<f64>, f64)) -> Instrument {
    Instrument::start(rate, policy, |scene| Arc::new(Spoiled::bent(&scene, at_rad, by_rad)))
}

impl Instrument {
    fn put(&self, wells: &[Value]) {
        let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells});
        assert_eq!(self.daemon.put_run("r1", &plan), 201);
    }

    fn load_when_asked(&self, well: &str, specimen: Specimen) {
        let asked = |s: &Value| s["state"] == "Suspended" && s["plate"]["needs"].as_str().is_some_and(|n| n.contains(well));
        self.daemon.wait("the loader to be asked", asked);
        self.scene.load(Some(specimen)).unwrap();
        assert_eq!(self.daemon.put_loaded("r1", well), 200);
    }

    /// A run of one larva until it ends.
    fn one_larva(&self, specimen: Specimen) -> Value {
        self.put(&[json!({"well": "A01", "dpf": 4})]);
        self.load_when_asked("A01", specimen);
        self.daemon.wait("the run's end", |s| !s["run"]["outcome"].is_null())
    }

    fn events(&self) -> Vec<Value> {
        let text = std::fs::read_to_string(self.data.join("events.jsonl")).unwrap();
        text.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
    }

    fn well(&self, name: &str) -> PathBuf {
        self.data.join("runs/r1").join(name)
    }
}

fn larva() -> Specimen {
    Specimen::larva(4, 1).unwrap()
}

fn flags(status: &Value) -> Vec<String> {
    serde_json::from_value(status["run"]["results"][0]["flags"].clone()).unwrap()
}

/// The frames reproduce the recorded numbers.
fn is_reproduced(recording: &std::path::Path) {
    let output = run(&["measure", recording.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    let line: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(line["stored"], "identical");
}

#[test]
fn a_view_that_does_not_belong_is_taken_again_and_both_takes_are_kept() {
    // View 4 is at 120 deg.
    let instrument = start(&QUICK, "retries = 1", (2.0..2.2, 1.0));
    let status = instrument.one_larva(larva());
    let well = &status["run"]["results"][0];
    assert_eq!(well["outcome"], "succeeded", "{status}");
    assert!(!flags(&status).iter().any(|f| f == "bad_view"), "{status}");
    let recording = json(&instrument.well("A01/recording.json"));
    let ledger = recording["ledger"].as_array().unwrap();
    let of_view = |view: u64| ledger.iter().filter(|e| e["view"] == view).collect::<Vec<_>>();
    assert_eq!((ledger.len(), of_view(4).len(), of_view(12).len()), (15, 2, 2), "view 4 and the view at 360 deg, once more: {ledger:?}");
    assert_eq!((&of_view(4)[1]["retake"], &of_view(4)[1]["achieved_steps"]), (&json!(1), &of_view(4)[0]["achieved_steps"]));
    for name in ["frames/view_004.png", "frames/view_004.retake-1.png", "frames/closure.retake-1.png"] {
        assert!(instrument.well("A01").join(name).is_file(), "{name}");
    }
    let used = json(&instrument.well("A01/measurement.json"))["views"][4]["used"].clone();
    assert_eq!(used, true, "the view counts");
    is_reproduced(&instrument.well("A01"));
}

#[test]
fn a_specimen_that_moved_is_taken_from_the_reference_again_and_the_first_attempt_is_kept_beside() {
    // Disturbed from view 6 of the first turn on, including its closure view. The second attempt is undisturbed.
    let instrument = start(&QUICK, "retries = 1", (3.0..7.0, 0.6));
    let status = instrument.one_larva(larva());
    assert_eq!(status["run"]["results"][0]["outcome"], "succeeded", "{status}");
    assert!(!flags(&status).iter().any(|f| f == "moved"), "{status}");
    let tried: Vec<_> = instrument.events().into_iter().filter(|e| e["kind"] == "specimen.tried_again").collect();
    assert_eq!((tried.len(), &tried[0]["well"], &tried[0]["data"]["attempt"]), (1, &json!("A01"), &json!(1)), "{tried:?}");
    let first = instrument.well("A01.attempt-1");
    assert_eq!(json(&first.join("recording.json"))["ledger"].as_array().unwrap().len(), 13);
    assert!(first.join("SHA256SUMS").is_file() && !first.join("measurement.json").exists());
    let timings = json(&instrument.well("A01/timings.json"));
    assert_eq!(timings["attempts"], 2, "{timings}");
    for phase in ["load", "position", "detect", "revolve", "reconstruct", "measure", "eject"] {
        assert!(timings["phases_s"][phase].as_f64().unwrap() >= 0.0, "{phase}: {timings}");
    }
    let (own, devices) = (timings["own_s"].as_f64().unwrap(), timings["devices_s"].as_f64().unwrap());
    let all: f64 = timings["phases_s"].as_object().unwrap().values().map(|s| s.as_f64().unwrap()).sum();
    assert!(own > 0.0 && devices > 0.0 && (own + devices - all).abs() < 1e-6, "{timings}");
    let done = instrument.events().into_iter().find(|e| e["kind"] == "specimen.done").unwrap();
    assert_eq!(done["data"]["times"]["phases_s"], timings["phases_s"]);
    is_reproduced(&instrument.well("A01"));
}

#[test]
fn a_revolution_that_overruns_stops_the_motor_and_costs_its_well_only() {
    let instrument = start(&SLOW, "retries = 0, deadlines_s = { revolve = 4 }", STRAIGHT);
    let status = instrument.one_larva(larva());
    let well = &status["run"]["results"][0];
    assert_eq!(well["outcome"], "failed", "{status}");
    let reason = well["reason"].as_str().unwrap();
    assert!(reason.contains("revolve") && reason.contains("4 s"), "{reason}");
    assert_eq!(status["faults"], json!([]), "{status}");
    let (angle, from) = (standing(&instrument.rig), instrument.rig.exposures()[1].angle_rad);
    assert!(angle < from + 0.99 * TAU / f64::from(SLOW.asd), "it stands at {angle} rad, where it was sent from {from} rad");
    assert!(instrument.well("A01/SHA256SUMS").is_file(), "the record is closed");
    instrument.daemon.status();
    assert_eq!(instrument.rig.shaft().angle_rad().to_bits(), angle.to_bits(), "the shaft moves");
}

/// The numbers of A01 are made while A02 is measured. They come too late, and are not written.
#[test]
fn numbers_that_overrun_fail_their_well_and_are_written_nowhere() {
    let instrument = start(&QUICK, "retries = 0, deadlines_s = { measure = 0.001 }", STRAIGHT);
    instrument.put(&["A01", "A02"].map(|well| json!({"well": well, "dpf": 4})));
    for well in ["A01", "A02"] {
        instrument.load_when_asked(well, larva());
    }
    let status = instrument.daemon.wait("the run's end", |s| !s["run"]["outcome"].is_null());
    let well = &status["run"]["results"][0];
    assert_eq!((&well["outcome"], &well["volume_um3"]), (&json!("failed"), &Value::Null), "{status}");
    let reason = well["reason"].as_str().unwrap();
    assert!(reason.contains("measure") && reason.contains("allows it 0.001 s"), "{reason}");
    for name in ["measurement.json", "model.glb"] {
        assert!(!instrument.well("A01").join(name).exists(), "{name}");
    }
    assert!(instrument.well("A01/SHA256SUMS").is_file(), "the turn is kept");
    let listed = json(&instrument.well("run.json"));
    assert_eq!((&listed["wells"][0]["outcome"], &listed["wells"][0]["volume_um3"]), (&json!("failed"), &Value::Null), "{listed}");
}

#[test]
fn a_reference_that_overruns_is_a_fault_that_names_the_phase_and_both_times() {
    let instrument = start(&SLOW_REFERENCE, "retries = 0, deadlines_s = { position = 1 }", STRAIGHT);
    instrument.put(&[json!({"well": "A01", "dpf": 4})]);
    instrument.load_when_asked("A01", larva());
    let status = instrument.daemon.wait("the fault", |s| s["faults"].as_array().is_some_and(|f| !f.is_empty()));
    assert_eq!(status["faults"][0]["code"], "position_overrun", "{status}");
    let said = status["faults"][0]["message"].as_str().unwrap();
    assert!(said.contains("position") && said.contains("allows it 1 s"), "{said}");
    let angle = instrument.rig.shaft().angle_rad();
    assert!(angle.abs() > 10.0 * TAU / 500.0, "it stands at {angle} rad: the reference was found");
}

#[test]
fn a_specimen_that_is_cut_by_the_picture_is_skipped_where_the_method_says_so() {
    let instrument = start(&QUICK, "clipped = \"skip\"", STRAIGHT);
    let status = instrument.one_larva(larva().placed(Placement { x_um: 2000.0, ..Placement::default() }));
    let well = &status["run"]["results"][0];
    assert_eq!((&well["outcome"], &well["reason"]), (&json!("skipped"), &json!("clipped")), "{status}");
    let found = instrument.events().into_iter().find(|e| e["kind"] == "specimen.detected").unwrap();
    assert!(found["data"]["head"]["side"].is_string() && found["data"]["kind"] == "larva", "{found}");
    // A damaged frame is taken again, at the same angle.
    let exposures = instrument.rig.exposures();
    assert!(
        exposures.iter().all(|e| (e.angle_rad - exposures[0].angle_rad).abs() < 1e-6),
        "nothing but the look that it is judged by: {exposures:?}"
    );
}

/// The numbers of a specimen are computed while the next one is loaded, and are complete before the next one is moved.
#[test]
fn numbers_are_made_beside_the_next_load_and_no_further() {
    let instrument = start(&QUICK, "retries = 1", STRAIGHT);
    instrument.put(&[json!({"well": "A01", "dpf": 4}), json!({"well": "A02", "specimen": "bead"})]);
    instrument.load_when_asked("A01", larva());
    instrument.load_when_asked("A02", Specimen::bead(500.0).unwrap());
    let status = instrument.daemon.wait("the run's end", |s| {
        assert_eq!(s["plate"]["removable"], false, "{s}");
        // A well is pending until its numbers exist, whatever is in the capillary.
        assert!(s["run"]["results"][0]["outcome"].is_null() == s["run"]["results"][0]["volume_um3"].is_null(), "{s}");
        !s["run"]["outcome"].is_null()
    });
    assert_eq!(status["run"]["wells"]["total"], 2, "{status}");
    let events = instrument.events();
    let at = |well: &str, kind: &str, phase: Option<&str>| {
        let is = |e: &&Value| e["well"] == well && e["kind"] == kind && phase.is_none_or(|p| e["data"]["phase"] == p);
        events.iter().find(is).unwrap_or_else(|| panic!("no {kind} {phase:?} of {well}"))["id"].as_u64().unwrap()
    };
    let phase = |well: &str, name: &str| at(well, "specimen.phase", Some(name));
    assert!(phase("A01", "reconstruct") < phase("A01", "measure") && phase("A01", "measure") < phase("A01", "eject"));
    assert!(phase("A01", "eject") < at("A01", "specimen.done", None), "done is what is out and on disk");
    assert!(at("A01", "specimen.done", None) < phase("A02", "position"), "no more than one specimen's numbers are made at once");
}

/// A vendor's sampler does not take the specimen out. The result of the specimen stands nevertheless and is reported.
fn verdict_is_reported(specimen: Specimen, outcome: &str) {
    // Much longer than the daemon waits.
    let stuck = SamplerSettings { load_s: 20.0, eject_s: 1e6, bounce_s: 0.004 };
    let changes = [("driver = \"loader\"", "driver = \"trigger\"\ndone_output = true\neject_timeout_ms = 2000".to_owned())];
    let policy = "retries = 0, clipped = \"skip\", interrupted = \"skip\", bead_gate = \"off\"";
    let instrument = Instrument::filled_by(Some(stuck), &QUICK, policy, &changes, |scene| scene);
    instrument.put(&[json!({"well": "A01", "dpf": 4}), json!({"well": "A02", "dpf": 4})]);
    instrument.daemon.wait("the load", |s| s["specimen"]["phase"] == "load");
    let (brought, taken) = (instrument.scene.clone(), instrument.scene.clone());
    let bring = Box::new(move || brought.load(Some(specimen)).unwrap());
    let take_away = Box::new(move || taken.load(Contents::default()).unwrap());
    instrument.rig.sampler().unwrap().give(Next { bring, take_away });
    let status = instrument.daemon.wait("the hold", |s| s["state"] == "Held");
    assert_eq!(status["faults"][0]["code"], "sampler_failed", "{status}");
    assert_eq!((&status["specimen"]["well"], &status["specimen"]["in_capillary"]), (&json!("A01"), &json!(true)), "{status}");
    let result = &status["run"]["results"][0];
    assert_eq!((&result["outcome"], result["volume_um3"].is_number()), (&json!(outcome), outcome == "succeeded"), "{status}");
    assert_eq!(status["run"]["wells"]["pending"], 1, "{status}");
    let of_a01 = |kind: &str| instrument.events().into_iter().filter(|e| e["kind"] == kind && e["well"] == "A01").collect::<Vec<_>>();
    let done = of_a01("specimen.done");
    assert_eq!((done.len(), &done[0]["data"]["outcome"]), (1, &json!(outcome)), "{done:?}");
    assert_eq!(of_a01("specimen.interrupted").len(), 0, "{outcome}");
}

#[test]
fn numbers_are_reported_where_the_specimen_cannot_be_taken_out() {
    verdict_is_reported(larva(), "succeeded");
}

#[test]
fn that_a_well_is_skipped_is_reported_where_its_specimen_cannot_be_taken_out() {
    verdict_is_reported(larva().placed(Placement { x_um: 2000.0, ..Placement::default() }), "skipped");
}
