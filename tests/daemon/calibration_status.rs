//! The calibration of the rig in the status: beads are measured, `carved calibrate` uses them, and the status reports the result from then
//! on.

use crate::common::{Daemon, carved, json, stderr};
use serde_json::{Value, json};
use std::path::Path;

fn plan(well: &Value) -> Value {
    json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": [well]})
}

fn run_to_its_end(daemon: &Daemon, id: &str, well: &Value) {
    assert_eq!(daemon.put_run(id, &plan(well)), 201);
    daemon.wait("the run's end", |s| s["run"]["id"] == id && !s["run"]["outcome"].is_null() && s["ready"] == true);
}

/// Stores a changed copy of a calibration, as `calibrate` would.
fn put(folder: &Path, name: &str, kept: &Value, change: impl Fn(&mut Value)) {
    let mut file = kept.clone();
    change(&mut file);
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join(name), file.to_string()).unwrap();
}

#[test]
fn the_newest_calibration_of_this_rig_is_reported_until_it_is_too_old() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let kept = data.join("calibrations");
    let daemon = Daemon::start(&data, &["--time-scale", "10", "--no-demo"]);
    assert!(daemon.wait("the first word", |s| s["ready"] == true)["calibration"].is_null());
    run_to_its_end(&daemon, "beads", &json!({"well": "A01", "specimen": "bead"}));
    let mut calibrate = carved();
    let output = calibrate.args(["calibrate", "beads"]).arg(data.join("runs/beads")).arg("--out").arg(&kept).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let beads: Value = serde_json::from_slice(&output.stdout).unwrap();
    // What a real turn tells about a bead of 500 um and its rig: the scale to half a percent, a round bead, water around it, and the
    // position of the axis.
    let found = |pointer: &str| beads.pointer(pointer).unwrap().as_f64().unwrap();
    assert!((found("/diameter_um/mean") / 500.0 - 1.0).abs() < 0.005 && (found("/aspect_ratio/mean") - 1.0).abs() < 0.005, "{beads:#}");
    assert!(beads["refraction"]["words"].as_str().unwrap().starts_with("water"), "{beads:#}");
    assert!((found("/uy_px/mean") - 511.5).abs() < 0.1 && (found("/gamma_rad/mean").to_degrees() - 0.25).abs() < 0.05, "{beads:#}");

    // The second run reads the calibrations again.
    run_to_its_end(&daemon, "empty", &json!({"well": "A04"}));
    let told = daemon.status()["calibration"].clone();
    assert_eq!((&told["id"], &told["kind"], &told["valid"]), (&beads["id"], &json!("beads"), &json!(true)), "{told}");
    assert_eq!(told["measured"], beads["measured"]);
    let bias = told["bead_bias_percent"].as_f64().unwrap();
    assert!((bias - 100.0 * (found("/diameter_um/mean") / 500.0 - 1.0)).abs() < 1e-9, "{told}");
    assert!(told["age_s"].as_f64().unwrap() > 0.0 && told["max_age_s"] == json!(30.0 * 86400.0), "{told}");
    daemon.signal("TERM");
    assert_eq!(daemon.ended(), Some(0));

    // A newer one of another rig, a newer one of a real instrument, a broken one and an older one: none of them counts.
    put(&kept, "calibration-1.json", &beads, |f| {
        (f["rig"], f["id"], f["measured"]) = ("other".into(), "b".into(), "2099-01-01T00:00:00Z".into());
    });
    put(&kept, "calibration-2.json", &beads, |f| {
        (f["mode"], f["id"], f["measured"]) = ("hardware".into(), "c".into(), "2099-01-01T00:00:00Z".into());
    });
    put(&kept, "calibration-3.json", &beads, |f| f["measured"] = "yesterday".into());
    put(&kept, "calibration-4.json", &beads, |f| (f["id"], f["measured"]) = ("d".into(), "2020-01-01T00:00:00Z".into()));
    let daemon = Daemon::start(&data, &["--no-demo"]);
    let told = daemon.wait("the first word", |s| s["ready"] == true)["calibration"].clone();
    assert_eq!((&told["id"], &told["valid"]), (&beads["id"], &json!(true)), "{told}");
    daemon.signal("TERM");
    assert_eq!(daemon.ended(), Some(0));

    // A scale whose age reaches the limit while the daemon runs: the status reports it as a change of state.
    let of_beads = json(
        &std::fs::read_dir(&kept)
            .unwrap()
            .map(|e| e.unwrap().path())
            .find(|p| p.to_string_lossy().contains(beads["id"].as_str().unwrap()))
            .unwrap(),
    );
    assert_eq!(of_beads, beads);
    std::fs::remove_dir_all(&kept).unwrap();
    let output = carved()
        .args(["calibrate", "scale", "--bead-um", "500", "--bead-sd", "2", "--bead-spread", "5"])
        .arg(data.join("runs/beads/A01"))
        .arg("--out")
        .arg(dir.path().join("scales"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let scale: Value = serde_json::from_slice(&output.stdout).unwrap();
    let soon = jiff::Timestamp::now() - jiff::SignedDuration::from_secs(30 * 86400 - 10);
    put(&kept, "scale-1.json", &scale, |f| f["measured"] = soon.to_string().into());
    let daemon = Daemon::start(&data, &["--no-demo"]);
    let told = daemon.wait("the calibration to grow too old", |s| s["calibration"]["valid"] == false)["calibration"].clone();
    assert_eq!((&told["id"], &told["kind"], &told["bead_bias_percent"]), (&scale["id"], &json!("scale"), &Value::Null), "{told}");
    assert!(told["age_s"].as_f64() >= told["max_age_s"].as_f64(), "{told}");
}
