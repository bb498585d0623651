//! The daily bead gate through the daemon: a run of beads makes the gate, and the policy of a method requires it for larvae.
//!
//! ```text
//! no gate ── refused, flagged ── 3 beads ── gate ── accepted, not flagged ── a day later: refused
//!                                   └── wrong ky ── gate that failed ── refused, with the way out
//! ```
#![cfg(feature = "aravis")]

use crate::common::bench::{Bench, bead, larva, plan};
use crate::common::receiver::{Received, Receiver, Reply};
use crate::common::{Daemon, json};
use crate::monitoring;
use hardware_sim::scene::Specimen;
use serde_json::{Value, json};
use std::path::PathBuf;

/// A method whose policy refuses, beside the default method, which flags. Both have few views and large voxels.
const STRICT: &str = "
[methods.strict]
asd = 9
order = \"sequential\"
epsilon = 0.05
voxel_um = 17.1
policy = { bead_gate = \"refuse\" }
";

fn serve(bench: &Bench, changes: &[(&str, String)]) -> Daemon {
    let quick = [("asd = 21", "asd = 9".to_owned()), ("voxel_um = 6.93", "voxel_um = 17.1".to_owned())];
    let daemon = bench.serve(&[&quick[..], changes].concat(), STRICT);
    daemon.wait("readiness", |s| s["ready"] == true);
    daemon
}

fn end(daemon: Daemon) {
    daemon.signal("TERM");
    assert_eq!(daemon.ended(), Some(0));
}

/// Three beads of one batch.
fn beads() -> [(&'static str, Value, Specimen); 3] {
    [bead("A01", 496.0), bead("A02", 500.0), bead("A03", 504.0)]
}

/// The reason with which the strict method refuses a plan with a larva.
fn refused(daemon: &Daemon) -> String {
    let wells = json!([{"well": "A01", "specimen": "bead"}, {"well": "A02", "specimen": "larva", "dpf": 4}]);
    let (code, problem) = daemon.send("PUT", "/v1/runs/refused", &plan("strict", &wells));
    assert_eq!((code, &problem["code"], &problem["errors"][0]["pointer"]), (422, &json!("invalid_plan"), &json!("/method")), "{problem}");
    let (code, found) = daemon.send("POST", "/v1/preflight", &plan("strict", &wells));
    let check = found["checks"].as_array().unwrap().iter().find(|c| c["code"] == "calibration").unwrap();
    assert_eq!((code, &found["passed"], &check["passed"], &check["blocks"]), (200, &json!(false), &json!(false), &json!(true)), "{found}");
    let why = problem["errors"][0]["detail"].as_str().unwrap().to_owned();
    assert!(why.starts_with(check["detail"].as_str().unwrap()), "one reason: {why}; {check}");
    why
}

fn flags(status: &Value) -> Vec<&str> {
    status["run"]["results"][0]["flags"].as_array().unwrap().iter().map(|f| f.as_str().unwrap()).collect()
}

/// The file of the only gate.
fn kept(bench: &Bench) -> PathBuf {
    let mut gates: Vec<PathBuf> = std::fs::read_dir(bench.data().join("calibrations")).unwrap().map(|e| e.unwrap().path()).collect();
    gates.retain(|path| path.file_name().unwrap().to_str().unwrap().starts_with("gate-"));
    assert_eq!(gates.len(), 1, "{gates:?}");
    gates.remove(0)
}

#[test]
fn larvae_are_refused_or_flagged_without_a_gate_and_measured_with_one_that_is_fresh() {
    let bench = Bench::new();
    let receiver = Receiver::start(&[Reply::Status(200)]);
    let notify = ("[store]", format!("[notify]\nurl = \"{}\"\n\n[store]", receiver.url));
    let daemon = serve(&bench, &[notify]);
    assert!(daemon.status()["calibration"].is_null());
    assert!(refused(&daemon).starts_with("this rig has no bead gate: measure three to five beads"));
    let status = bench.measured(&daemon, "too-early", "standard", &[larva("A01")]);
    assert!(status["run"]["results"][0]["outcome"] == "succeeded" && flags(&status).contains(&"bead_gate"), "{status}");
    assert_eq!(status["run"]["wells"]["flagged"], 1, "{status}");

    // Beads alone need no gate, because they make one.
    let status = bench.measured(&daemon, "beads", "strict", &beads());
    assert_eq!(status["run"]["wells"]["succeeded"], 3, "{status}");
    let gate = daemon.wait("the gate", |s| !s["calibration"]["gate"].is_null())["calibration"].clone();
    assert_eq!((&gate["kind"], &gate["valid"]), (&json!("gate"), &json!(true)), "{gate}");
    assert_eq!((&gate["gate"]["verdict"], &gate["gate"]["stands"]), (&json!("no_history"), &json!(true)), "{gate}");
    let file = json(&kept(&bench));
    assert_eq!((&file["id"], &file["gate"]["numbers"]["beads"]), (&gate["gate"]["id"], &json!(3)), "{file}");
    assert_eq!(file["measured"], gate["gate"]["measured"]);

    let status = bench.measured(&daemon, "in-time", "strict", &[larva("A01")]);
    assert!(status["run"]["results"][0]["outcome"] == "succeeded" && !flags(&status).contains(&"bead_gate"), "{status}");
    assert_eq!(status["calibration"]["gate"]["id"], gate["gate"]["id"], "{status}");
    let ended: Vec<Value> = receiver.wait(3).iter().map(Received::json).collect();
    let of = |notice: &Value| (notice["event"].clone(), notice["run"]["id"].clone(), notice["instrument"]["uuid"].clone());
    let expected = ["too-early", "beads", "in-time"].map(|run| (json!("run.ended"), json!(run), status["instrument"]["uuid"].clone()));
    assert_eq!(ended.iter().map(of).collect::<Vec<_>>(), expected);
    monitoring::is_covered_by(&daemon);
    end(daemon);

    // This gate expires within seconds: it is valid when the daemon starts, and no longer when a run is requested.
    let soon = jiff::Timestamp::now() - jiff::SignedDuration::from_secs(24 * 3600 - 5);
    let mut file = file;
    file["measured"] = json!(soon.to_string());
    std::fs::write(kept(&bench), file.to_string()).unwrap();
    let daemon = serve(&bench, &[]);
    let told = daemon.wait("the gate to grow too old", |s| s["calibration"]["gate"]["stands"] == false)["calibration"].clone();
    assert_eq!((&told["valid"], &told["gate"]["verdict"]), (&json!(false), &json!("no_history")), "{told}");
    let why = refused(&daemon);
    assert!(why.contains(file["measured"].as_str().unwrap()) && why.contains("stands for 24 h"), "{why}");
    assert!(why.contains("bead_gate = \"refuse\""), "{why}");
}

/// ky is 2 % wrong, as with air in place of water around the capillary: the beads appear elongated.
#[test]
fn beads_on_a_rig_whose_scale_is_off_make_a_gate_that_failed() {
    let bench = Bench::new();
    let ky = ("ky_px_per_um = 0.18181818181818182", "ky_px_per_um = 0.18545454545454546".to_owned());
    let daemon = serve(&bench, &[ky]);
    let status = bench.measured(&daemon, "beads", "standard", &beads());
    assert_eq!(status["run"]["outcome"], "succeeded", "beads are measured all the same: {status}");
    let gate = daemon.wait("the gate", |s| !s["calibration"]["gate"].is_null())["calibration"]["gate"].clone();
    assert_eq!((&gate["verdict"], &gate["stands"]), (&json!("failed"), &json!(false)), "{gate}");
    let checks = json(&kept(&bench))["gate"]["checks"].clone();
    let over: Vec<&Value> = checks.as_array().unwrap().iter().filter(|c| c["over"] == true).map(|c| &c["name"]).collect();
    assert_eq!(over, [&json!("aspect_off")], "{checks}");
    let why = refused(&daemon);
    assert!(why.contains("% too long") && why.contains("air around the capillary"), "{why}");
    assert!(gate["words"].to_string().contains("kx and ky do not belong together"), "{gate}");
}
