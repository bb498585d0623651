//! The whole daemon on the emulated rig of each type of controller.

use crate::common::{Daemon, json};
use serde_json::json;

/// A bead is measured as on the demo plate with every controller, and the ledger uses the steps of that controller.
fn measures_a_bead(controller: &str, identity: &str, steps_per_revolution: f64) {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = Daemon::start(&data, &["--no-demo", "--small", "--time-scale", "10", "--controller", controller]);
    let plan =
        json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": [{"well": "A01", "specimen": "bead"}]});
    assert_eq!(daemon.put_run("bead", &plan), 201);
    if controller == "vast-bridge" {
        // The emulated VAST loads its list by itself. The run asks all the same.
        let status = daemon.wait("the question for the list", |s| s["state"] == "Held");
        assert_eq!(status["faults"][0]["code"], "vast_list", "{status}");
        daemon.go_on("bead", &status["faults"][0]);
    }
    let status = daemon.wait_for_outcome();
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    let recording = json(&data.join("runs/bead/A01/recording.json"));
    assert!(recording["rig"]["rotation_identity"].as_str().unwrap().contains(identity), "{}", recording["rig"]);
    let ledger = recording["ledger"].as_array().unwrap();
    assert_eq!(ledger.len(), 22);
    for entry in ledger {
        let target = (entry["view"].as_f64().unwrap() * steps_per_revolution / 21.0).round();
        assert_eq!(entry["achieved_steps"].as_f64(), Some(target));
    }
    let (found, truth) = (&status["run"]["results"][0]["diameter_um"], &recording["truth"]["diameter_um"]);
    assert!((found.as_f64().unwrap() / truth.as_f64().unwrap() - 1.0).abs() < 0.01, "bead: {found} um, truth {truth} um");
}

#[test]
fn a_trinamic_pair_turns_the_whole_daemon() {
    measures_a_bead("tmcl", "TMCM-6212", 6400.0);
}

#[test]
fn a_stock_vast_behind_its_bridge_or_a_relay_turns_the_whole_daemon() {
    measures_a_bead("vast-bridge", "VAST trigger bridge", 500.0);
    measures_a_bead("relay", "VAST relay", 500.0);
}

#[test]
fn a_zaber_axis_turns_the_whole_daemon() {
    measures_a_bead("zaber", "Zaber 51234", 6400.0);
}
