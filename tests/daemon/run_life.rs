//! The life of a run as loader and operator control it: held, resumed, stopped, aborted, and resumed after a crash. Every status on the way
//! is checked for what a reader may rely on.
#![cfg(feature = "aravis")]

use crate::common::{Daemon, json};
use serde_json::{Value, json};
use std::path::Path;

/// Two wells that are measured, and one empty well.
const WELLS: [&str; 3] = ["A01", "A02", "A03"];

fn plan() -> Value {
    let wells: Vec<Value> = WELLS.iter().map(|well| json!({"well": well, "specimen": "bead"})).collect();
    json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells})
}

fn start(data: &Path) -> Daemon {
    Daemon::start(data, &["--time-scale", "10", "--no-demo", "--small", "--empty", "A03"])
}

/// State, phase, outcome and faults are consistent, and a run without an outcome never appears as idle or finished.
fn sound(s: &Value) {
    let state = s["state"].as_str().unwrap();
    let open = !s["run"].is_null() && s["run"]["outcome"].is_null();
    let over = matches!(state, "Idle" | "Complete" | "Aborted" | "Stopped");
    assert!(!(open && over), "a run without an outcome in {state}: {s}");
    assert!(!(open && s["ready"] == true), "ready while busy: {s}");
    assert!(!(open && s["plate"]["removable"] == true), "removable while busy: {s}");
    assert!(state != "Complete" || !s["run"]["outcome"].is_null(), "{s}");
    let w = &s["run"]["wells"];
    if w.is_object() {
        let sum: u64 = ["succeeded", "flagged", "failed", "skipped", "interrupted", "pending"].iter().map(|k| w[k].as_u64().unwrap()).sum();
        assert_eq!(sum, w["total"].as_u64().unwrap(), "counts are disjoint: {s}");
        assert!(open || w["pending"] == 0 || s["run"].is_null(), "an ended run has nothing left: {s}");
    }
    assert_eq!(s["ready"] == true, s["not_ready_reason"].is_null(), "{s}");
}

fn wait(daemon: &Daemon, what: &str, done: impl Fn(&Value) -> bool) -> Value {
    daemon.wait(what, |s| {
        sound(s);
        done(s)
    })
}

fn post(daemon: &Daemon, command: &str) -> u16 {
    daemon.post(&format!("/v1/runs/r1/{command}"))
}

/// True during the revolution of `well`.
fn turning(well: &str) -> impl Fn(&Value) -> bool {
    move |s| s["specimen"]["well"] == well && s["specimen"]["view"].as_u64() >= Some(2)
}

fn of_kind(data: &Path, kind: &str) -> Vec<Value> {
    let text = std::fs::read_to_string(data.join("events.jsonl")).unwrap();
    text.lines().map(|l| serde_json::from_str::<Value>(l).unwrap()).filter(|e| e["kind"] == kind).collect()
}

fn kinds(data: &Path, kind: &str) -> usize {
    of_kind(data, kind).len()
}

#[test]
fn a_held_run_rests_between_two_wells_outlasts_a_crash_and_goes_on_where_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = start(&data);
    assert_eq!(daemon.put_run("r1", &plan()), 201);
    wait(&daemon, "the first well", turning("A01"));
    assert_eq!(post(&daemon, "hold"), 200);
    assert_eq!(post(&daemon, "hold"), 200, "a repeat answers the same");
    let held = wait(&daemon, "the hold", |s| s["state"] == "Held");
    assert_eq!((&held["run"]["results"][0]["outcome"], &held["run"]["wells"]["pending"]), (&json!("succeeded"), &json!(2)), "{held}");
    assert_eq!((&held["pending"]["hold"], &held["faults"]), (&json!(false), &json!([])), "{held}");
    let measured = std::fs::read(data.join("runs/r1/A01/measurement.json")).unwrap();
    let sums = std::fs::read(data.join("runs/r1/A01/SHA256SUMS")).unwrap();

    // An operator's hold survives a crash of the daemon.
    daemon.signal("KILL");
    daemon.ended();
    std::fs::create_dir(data.join("runs/broken")).unwrap();
    std::fs::write(data.join("runs/broken/run.json"), "{").unwrap();
    let daemon = start(&data);
    let held = wait(&daemon, "the held run", |s| s["run"]["id"] == "r1" && s["state"] == "Held");
    assert_eq!(held["run"]["wells"]["pending"], 2, "{held}");
    assert_eq!(post(&daemon, "unhold"), 200);
    let status = wait(&daemon, "the end", |s| s["state"] == "Complete");
    assert_eq!(post(&daemon, "unhold"), 409, "it is over");
    assert_eq!(status["run"]["outcome"], "succeeded", "an empty well is honest work: {status}");
    assert_eq!((&status["run"]["wells"]["succeeded"], &status["run"]["wells"]["skipped"]), (&json!(2), &json!(1)), "{status}");
    assert_eq!(std::fs::read(data.join("runs/r1/A01/measurement.json")).unwrap(), measured);
    assert_eq!(std::fs::read(data.join("runs/r1/A01/SHA256SUMS")).unwrap(), sums);
    assert!(!data.join("runs/r1/A02.attempt-1").exists(), "nothing was begun twice");
    assert_eq!((kinds(&data, "run.ended"), kinds(&data, "specimen.done"), kinds(&data, "run.resumed")), (1, 3, 1));
    assert_eq!(of_kind(&data, "run.resumed")[0]["data"]["by"], "operator", "it did not go on by itself before");
}

#[test]
fn a_stopped_run_ends_after_its_specimen_and_says_what_was_not_visited() {
    let dir = tempfile::tempdir().unwrap();
    let daemon = start(&dir.path().join("data"));
    assert_eq!(daemon.put_run("r1", &plan()), 201);
    wait(&daemon, "the first well", turning("A01"));
    assert_eq!((post(&daemon, "stop"), post(&daemon, "stop")), (200, 200));
    let (code, problem) = daemon.send("POST", "/v1/runs/r1/hold", &Value::Null);
    assert_eq!(
        (code, &problem["code"], &problem["run"]),
        (409, &json!("wrong_state"), &json!("r1")),
        "an end is not taken back: {problem}"
    );
    assert!(problem["accepted_in"].as_array().unwrap().contains(&json!("Execute")), "{problem}");
    let status = wait(&daemon, "the stop", |s| s["state"] == "Stopped");
    assert_eq!(status["run"]["outcome"], "partial", "{status}");
    let results = status["run"]["results"].as_array().unwrap();
    assert_eq!((&results[0]["outcome"], &results[1]["outcome"]), (&json!("succeeded"), &json!("aborted")), "{status}");
    assert_eq!(results[2]["reason"], "the run was stopped before this well", "{status}");
    assert_eq!((&status["ready"], &status["plate"]["removable"]), (&json!(true), &json!(true)), "{status}");
    assert_eq!(post(&daemon, "stop"), 200, "it has reached the state that was asked for");
    assert_eq!(daemon.put_run("r2", &plan()), 201);
    // This run is stopped before it has any numbers.
    assert_eq!(daemon.post("/v1/runs/r2/hold"), 200);
    wait(&daemon, "the hold", |s| s["state"] == "Held");
    assert_eq!(daemon.post("/v1/runs/r2/abort"), 200);
    let status = wait(&daemon, "the abort", |s| s["state"] == "Aborted");
    assert_eq!((&status["run"]["id"], &status["run"]["outcome"]), (&json!("r2"), &json!("aborted")), "{status}");
}

#[test]
fn a_killed_daemon_goes_on_at_the_right_well_and_measures_nothing_twice() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = start(&data);
    assert_eq!(daemon.put_run("r1", &plan()), 201);
    wait(&daemon, "the second well", turning("A02"));
    daemon.signal("KILL");
    daemon.ended();
    let sums = std::fs::read(data.join("runs/r1/A01/SHA256SUMS")).unwrap();
    let begun = json(&data.join("runs/r1/A02/recording.json"));
    let instrument = begun["instrument"].clone();
    assert_eq!((&instrument["name"], instrument["uuid"].as_str().map(str::len)), (&json!("emulated"), Some(36)), "{instrument}");

    let daemon = start(&data);
    let status = wait(&daemon, "the end", |s| s["run"]["id"] == "r1" && s["state"] == "Complete");
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    assert_eq!((&status["run"]["wells"]["succeeded"], &status["run"]["wells"]["skipped"]), (&json!(2), &json!(1)), "{status}");
    assert_eq!(std::fs::read(data.join("runs/r1/A01/SHA256SUMS")).unwrap(), sums, "a finished specimen keeps its bytes");
    assert_eq!(json(&data.join("runs/r1/A02.attempt-1/recording.json")), begun, "what there was of the second is kept");
    let mut check = std::process::Command::new("sha256sum");
    check.args(["--check", "--strict", "--quiet", "SHA256SUMS"]).current_dir(data.join("runs/r1/A02.attempt-1"));
    assert!(check.status().unwrap().success(), "and is protected by its sums");
    let ledger = json(&data.join("runs/r1/A02/recording.json"))["ledger"].as_array().unwrap().len();
    assert_eq!(ledger, 22, "views of two lives are not mixed");
    assert_eq!((kinds(&data, "run.ended"), kinds(&data, "specimen.done"), kinds(&data, "run.accepted")), (1, 3, 1));
    assert_eq!((kinds(&data, "run.resumed"), kinds(&data, "specimen.interrupted")), (1, 1));
    assert!(status["run"]["eta_s"].is_null(), "{status}");
    let recorded = ["run.json", "A01/recording.json", "A02/recording.json"].map(|file| json(&data.join("runs/r1").join(file)));
    for found in [&status].into_iter().chain(&recorded) {
        assert_eq!(found["instrument"], instrument, "the same instrument after the restart");
    }
}

#[test]
fn an_emergency_stop_latches_until_somebody_has_acknowledged_it() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = start(&data);
    assert_eq!(daemon.put_run("r1", &plan()), 201);
    wait(&daemon, "the first well", turning("A01"));
    assert_eq!((daemon.post("/v1/emergency-stop"), daemon.post("/v1/emergency-stop")), (200, 200));
    let stopped = |s: &Value| s["faults"][0]["code"] == "emergency_stop" && s["state"] == "Aborted";
    let status = wait(&daemon, "the stop", stopped);
    assert_eq!((&status["run"]["outcome"], &status["faults"].as_array().unwrap().len()), (&json!("aborted"), &1), "{status}");
    assert_eq!(status["faults"][0]["operator_required"], true, "{status}");
    let (code, problem) = daemon.send("PUT", "/v1/runs/r2", &plan());
    assert_eq!((code, &problem["code"]), (409, &json!("fault_stands")), "{problem}");

    daemon.signal("KILL");
    daemon.ended();
    let daemon = start(&data);
    let status = wait(&daemon, "the fault", |s| s["faults"][0]["code"] == "emergency_stop");
    assert_eq!(status["ready"], false, "a new start does not clear it: {status}");
    let seq = status["faults"][0]["seq"].as_u64().unwrap();
    let acknowledge = format!("/v1/faults/{seq}/acknowledge");
    assert_eq!((daemon.post(&acknowledge), daemon.post(&acknowledge)), (200, 200));
    assert_eq!(daemon.post(&format!("/v1/faults/{}/acknowledge", seq + 1)), 404);
    let status = wait(&daemon, "readiness", |s| s["ready"] == true);
    assert_eq!(status["faults"], json!([]), "{status}");
    assert_eq!(daemon.put_run("r2", &plan()), 201);
    wait(&daemon, "the next run", turning("A01"));
}

#[test]
fn a_plate_is_handed_over_and_only_its_own_run_is_taken() {
    let dir = tempfile::tempdir().unwrap();
    let daemon = start(&dir.path().join("data"));
    let handoff = |intent: &str, barcode: &str| daemon.send("PUT", "/v1/plate/handoff", &json!({"intent": intent, "barcode": barcode}));
    let end = |how: &str| daemon.send("PUT", &format!("/v1/plate/handoff/{how}"), &Value::Null);
    wait(&daemon, "readiness", |s| s["ready"] == true);
    assert_eq!(end("completed").1["code"], "no_handoff");
    let (code, needs) = handoff("load", "P-2");
    assert_eq!((code, &needs["needs"]), (200, &Value::Null), "{needs}");
    assert_eq!(end("aborted").0, 200);
    assert_eq!(daemon.status()["plate"]["present"], false, "it did not come");
    assert_eq!((handoff("load", "P-2").0, end("completed").0, end("completed").0), (200, 200, 200));
    let status = wait(&daemon, "the plate", |s| s["plate"]["present"] == true);
    assert_eq!(status["plate"]["barcode"], "P-2", "{status}");
    assert_eq!(handoff("load", "P-3").1["code"], "other_barcode");

    let (code, problem) = daemon.send("PUT", "/v1/runs/r1", &plan());
    assert_eq!((code, &problem["code"]), (409, &json!("other_barcode")), "{problem}");
    let right = json!({"plate_barcode": "P-2", "method": "standard", "operator": "test", "plate_map": [{"well": "A03"}]});
    assert_eq!(daemon.put_run("r1", &right), 201);
    let (code, needs) = handoff("unload", "P-2");
    assert_eq!(code, 200);
    if needs["needs"].is_string() {
        assert_eq!(needs["needs"], "the run to end", "{needs}");
    }
    wait(&daemon, "the end", |s| s["state"] == "Complete" && s["plate"]["removable"] == true);
    assert_eq!(handoff("unload", "P-9").1["code"], "other_barcode");
    assert_eq!(handoff("unload", "P-2").1["needs"], Value::Null);
    assert_eq!((end("completed").0, end("completed").0), (200, 200));
    let plate = &daemon.status()["plate"];
    assert_eq!((&plate["present"], &plate["barcode"], &plate["removable"]), (&json!(false), &Value::Null, &json!(false)), "{plate}");
}
