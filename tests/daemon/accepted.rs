//! Once a specimen is accepted it is released from the capillary while its numbers are still computed. Whatever ends the daemon or the run
//! at that moment, the numbers are computed from the stored frames and no loader is asked to bring the specimen again.
//!
//! ```text
//! undisturbed run ── copies of its data, rewound to before its first well was done ──► restarted daemon ──► the same bytes
//! ```
#![cfg(feature = "aravis")]

use crate::common::{Daemon, crash, json};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

const SIMULATED: [&str; 4] = ["--time-scale", "10", "--no-demo", "--small"];

fn plan() -> Value {
    let wells = [json!({"well": "A01", "specimen": "larva", "dpf": 3}), json!({"well": "A02", "specimen": "bead"})];
    json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells})
}

fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        if entry.path().is_dir() {
            found.extend(files(&entry.path()).into_iter().map(|(file, bytes)| (format!("{name}/{file}"), bytes)));
        } else {
            found.insert(name, std::fs::read(entry.path()).unwrap());
        }
    }
    found
}

/// The files of a recording without `timings.json` and without its line in `SHA256SUMS`: only these depend on the clock.
fn timeless(well: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = files(well);
    assert!(files.remove("timings.json").is_some(), "a live run leaves them");
    let sums = String::from_utf8(files["SHA256SUMS"].clone()).unwrap();
    let lines: String = sums.lines().filter(|l| !l.ends_with("  timings.json")).map(|l| format!("{l}\n")).collect();
    assert_eq!(lines.lines().count() + 1, sums.lines().count());
    files.insert("SHA256SUMS".into(), lines.into_bytes());
    files
}

fn sums_hold(well: &Path) {
    let mut check = std::process::Command::new("sha256sum");
    assert!(check.args(["--check", "--strict", "--quiet", "SHA256SUMS"]).current_dir(well).status().unwrap().success());
}

fn events(data: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(data.join("events.jsonl")).unwrap();
    text.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
}

fn count(data: &Path, kind: &str, well: &str) -> usize {
    events(data).iter().filter(|e| e["kind"] == kind && e["well"] == well).count()
}

/// Starts a daemon on these data and returns the status once the run has reached this state.
fn taken_up(data: &Path, what: &str, state: &str) -> Value {
    Daemon::start(data, &SIMULATED).wait(what, |s| s["state"] == state)
}

fn names(files: &BTreeMap<String, Vec<u8>>) -> Vec<&String> {
    files.keys().collect()
}

#[test]
fn a_specimen_that_is_gone_gets_its_numbers_from_its_frames_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole");
    let daemon = Daemon::start(&whole, &SIMULATED);
    assert_eq!(daemon.put_run("r1", &plan()), 201);
    let status = daemon.wait_for_outcome();
    assert_eq!(status["run"]["wells"]["total"], 2, "{status}");
    daemon.signal("TERM");
    daemon.ended();
    let expected = json(&whole.join("runs/r1/run.json"))["wells"][0].clone();
    assert_eq!((&expected["outcome"], expected["reference"].is_object()), (&json!("succeeded"), true), "{expected}");
    let taken_back = |name: &str, asked: Option<&str>| {
        let data = dir.path().join(name);
        crate::common::copy_folder(&whole, &data);
        crash::before_the_first_well_was_done(&data, "r1", asked);
        data
    };
    let live = timeless(&whole.join("runs/r1/A01"));
    let as_live = |data: &Path| {
        let well = data.join("runs/r1/A01");
        let found = timeless(&well);
        assert_eq!(names(&found), names(&live));
        for (name, bytes) in &live {
            assert!(found[name] == *bytes, "{name} is not what the live run left");
        }
        sums_hold(&well);
        assert_eq!(json(&data.join("runs/r1/run.json"))["wells"][0], expected);
        // A busy computer loses frames, so the live run may have tried twice.
        let tried_again = |data: &Path| data.join("runs/r1/A01.attempt-1").exists();
        assert_eq!(tried_again(data), tried_again(&whole), "its larva is gone: there is no other attempt");
        let told = ["specimen.recovered", "specimen.done", "specimen.interrupted"].map(|kind| count(data, kind, "A01"));
        assert_eq!(told, [1, 1, 0]);
    };

    // Killed while the loader was to bring the second specimen: the run continues.
    let data = taken_back("killed", None);
    crash::without_results(&data.join("runs/r1/A01"));
    let status = taken_up(&data, "the run's end", "Complete");
    assert_eq!(
        (&status["run"]["outcome"], &status["run"]["results"][1]["outcome"]),
        (&json!("succeeded"), &json!("succeeded")),
        "{status}"
    );
    assert_eq!(status["run"]["results"][0], expected, "{status}");
    as_live(&data);

    // Killed while a result file was being written.
    let data = taken_back("torn", Some("run.abort_requested"));
    crash::without_results(&data.join("runs/r1/A01"));
    std::fs::write(data.join("runs/r1/A01/mesh.ply.part"), "ply").unwrap();
    let status = taken_up(&data, "the abort", "Aborted");
    assert_eq!((&status["run"]["outcome"], &status["run"]["results"][1]["outcome"]), (&json!("aborted"), &json!("aborted")), "{status}");
    as_live(&data);

    // All results were on disk, only the event of their completion was missing: every file stays as it is, `timings.json` too.
    let data = taken_back("closed", Some("run.stop_requested"));
    let before = files(&data.join("runs/r1/A01"));
    let status = taken_up(&data, "the stop", "Stopped");
    assert_eq!((&status["run"]["outcome"], &status["run"]["results"][0]["outcome"]), (&json!("partial"), &json!("succeeded")), "{status}");
    as_live(&data);
    assert!(files(&data.join("runs/r1/A01")) == before, "nothing is written twice");

    // A frame that differs from the recorded one gives no numbers. The run still reaches its end.
    let data = taken_back("altered", Some("run.stop_requested"));
    let well = data.join("runs/r1/A01");
    crash::without_results(&well);
    std::fs::copy(well.join("frames/view_003.png"), well.join("frames/view_004.png")).unwrap();
    let status = taken_up(&data, "the stop", "Stopped");
    let found = &status["run"]["results"][0];
    assert!(found["outcome"] == "failed" && found["reason"].as_str().unwrap().contains("view_004.png"), "{found}");

    // A turn that was not accepted counts as not measured. The policy would repeat it; the abort ends it.
    let data = taken_back("turning", Some("run.abort_requested"));
    let well = data.join("runs/r1/A01");
    crash::without_results(&well);
    let recording = std::fs::read_to_string(well.join("recording.json")).unwrap();
    assert!(recording.contains("\"accepted\": true"), "it was let go");
    std::fs::write(well.join("recording.json"), recording.replace("\"accepted\": true", "\"accepted\": false")).unwrap();
    let status = taken_up(&data, "the abort", "Aborted");
    assert_eq!(status["run"]["results"][0]["outcome"], "aborted", "{status}");
    assert_eq!((count(&data, "specimen.recovered", "A01"), count(&data, "specimen.interrupted", "A01")), (0, 1));
    sums_hold(&well);

    // After two crashes during the computation the numbers are given up. SHA256SUMS still protects what is kept of the larva.
    let data = taken_back("given up", Some("run.stop_requested"));
    let well = data.join("runs/r1/A01");
    crash::without_results(&well);
    crash::happened(&data, "r1", &["specimen.recovering"; 2], "A01");
    let status = taken_up(&data, "the stop", "Stopped");
    let found = &status["run"]["results"][0];
    assert!(found["outcome"] == "failed" && found["reason"].as_str().unwrap().contains("2 attempts"), "{found}");
    sums_hold(&well);
    let sums = std::fs::read_to_string(well.join("SHA256SUMS")).unwrap();
    assert!(sums.contains("  frames/view_020.png\n") && sums.contains("  recording.json\n"), "{sums}");

    // The loader is asked for the next specimen at once, and never for the accepted one.
    let data = taken_back("loader", None);
    crash::without_results(&data.join("runs/r1/A01"));
    let daemon = Daemon::start(&data, &["--time-scale", "10", "--no-demo", "--small", "--sampler", "loader"]);
    daemon.wait("the next specimen", |s| {
        let needs = s["plate"]["needs"].as_str().unwrap_or_default();
        assert!(!needs.contains("A01 in the capillary"), "its larva is gone: {s}");
        needs.contains("A02 in the capillary")
    });
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200);
    let status = daemon.wait("the abort", |s| s["state"] == "Aborted");
    assert_eq!(status["run"]["results"][1]["outcome"], "aborted", "{status}");
    as_live(&data);
}

/// The sampler needs time to eject the specimen. Until then the well is not done, even if all its results are on disk.
#[test]
fn an_abort_leaves_an_accepted_specimen_its_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = Daemon::start(&data, &["--time-scale", "1", "--no-demo", "--small", "--sampler", "trigger"]);
    let wells = [json!({"well": "A01", "specimen": "bead"}), json!({"well": "A02", "specimen": "bead"})];
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells});
    assert_eq!(daemon.put_run("r1", &plan), 201);
    daemon.wait("the specimen on its way out", |s| s["specimen"]["well"] == "A01" && s["specimen"]["phase"] == "eject");
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200);
    let status = daemon.wait("the abort", |s| s["state"] == "Aborted");
    let results = &status["run"]["results"];
    assert_eq!((&results[0]["outcome"], &results[1]["outcome"]), (&json!("succeeded"), &json!("aborted")), "{status}");
    assert!((results[0]["diameter_um"].as_f64().unwrap() - 500.0).abs() < 5.0, "{status}");
    assert_eq!(status["run"]["outcome"], "aborted", "{status}");
    sums_hold(&data.join("runs/r1/A01"));
    let events = events(&data);
    let at = |kind: &str| events.iter().position(|e| e["kind"] == kind).unwrap_or_else(|| panic!("no {kind}"));
    assert!(at("run.abort_requested") < at("specimen.done"), "its numbers were pending");
}
