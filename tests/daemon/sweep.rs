//! The whole daemon on an emulated rig that turns at a constant speed while its camera runs freely.
#![cfg(feature = "aravis")]

use crate::common::{Daemon, json, run, stderr};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::path::Path;

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
    let status = daemon.wait_for_outcome();
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
