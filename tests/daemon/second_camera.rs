//! A second camera for the fluorescence of the specimen: its frames are stored beside those of the first, and its signal per volume equals
//! the truth.
#![cfg(feature = "aravis")]

use crate::common::bench::{Bench, larva};
use crate::common::spoiled::Spoiled;
use crate::common::{Daemon, configured, contract, json, patient, port, run, small_frames, small_scene, stderr};
use hardware_sim::scene::{Fluorescent, FluorescentSettings, Specimen};
use hardware_sim::{Pixels, RigSettings, Sight};
use serde_json::{Value, json};
use std::sync::Arc;

const ASD: usize = 9;

/// The configuration of the second camera, with the values of the emulated one.
fn tables(address: std::net::Ipv4Addr, glow: &FluorescentSettings) -> String {
    let c = &glow.camera;
    format!(
        "\n[camera_second]\ndriver = \"aravis\"\nselect = {{ address = \"{address}\" }}\npixel_format = \"Mono8\"\nwidth = {}\nheight = {}\n\
         exposure_us = 8000.0\n\n[optics_second]\naround_deg = {}\ndistance_um = {:?}\nkx_px_per_um = {:?}\nky_px_per_um = {:?}\n\
         ux_px = {:?}\nuy_px = {:?}\n",
        c.width,
        c.height,
        glow.around_rad.to_degrees(),
        c.f_um,
        c.kx_px_per_um,
        c.ky_px_per_um,
        c.ux_px,
        c.uy_px
    )
}

#[test]
fn the_signal_per_volume_is_the_truths_and_is_computed_again_from_the_recording() {
    let dir = tempfile::tempdir().unwrap();
    let scene = small_scene();
    let mut rig = hardware_sim::Rig::start(RigSettings { time_scale: 10.0, ..RigSettings::default() }, scene.clone()).unwrap();
    let settings = FluorescentSettings::default();
    let glow = Arc::new(Fluorescent::new(scene.clone(), settings.clone()));
    let second = rig.add_camera(glow.clone()).unwrap();
    let changes = [port(&rig), ("settle_ms = 50", "settle_ms = 5".to_owned()), ("asd = 21", format!("asd = {ASD}"))];
    let (config, data) = configured("vast-grbl.toml", dir.path(), &rig, &[&changes[..], &small_frames(), &patient()].concat());
    std::fs::write(&config, std::fs::read_to_string(&config).unwrap() + &tables(second, &settings)).unwrap();
    let daemon = Daemon::serve(&config, &data);
    daemon.wait("the second camera", |s| s["hardware"]["camera_second"]["connected"] == true);

    let specimens = [("A01", "bead", Specimen::bead(500.0).unwrap()), ("A02", "larva", Specimen::larva(4, 1).unwrap())];
    let bodies_nl = specimens.each_ref().map(|(_, _, specimen)| specimen.truth().volume_um3 * 1e-6);
    let wells: Vec<Value> = specimens.iter().map(|(well, kind, _)| json!({"well": well, "specimen": kind})).collect();
    assert_eq!(daemon.put_run("r1", &json!({"plate_barcode": "P-1", "method": "standard", "operator": "t", "plate_map": wells})), 201);
    for (well, _, specimen) in specimens {
        daemon.wait("the loader to be asked", |s| {
            s["plate"]["needs"].as_str().is_some_and(|n| n.contains(well)) && s["state"] == "Suspended"
        });
        scene.load(Some(specimen)).unwrap();
        assert_eq!(daemon.put_loaded("r1", well), 200);
        daemon.wait("the well to be taken on", |s| s["state"] == "Execute" && s["plate"]["needs"].is_null());
    }
    let status = daemon.wait("the run's end", |s| !s["run"]["outcome"].is_null());
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    assert!(status["hardware"]["camera_second"]["completed_frames"].as_u64() >= Some(2 * (ASD as u64 + 1)), "{status}");

    let exposures = rig.second_exposures();
    let hex = |hash: &[u8]| hash.iter().map(|b| format!("{b:02x}")).collect::<String>();
    // Perspective beside the axis, the facets of the mesh and noise together are less than 1 %.
    for ((well, body_nl), result) in ["A01", "A02"].into_iter().zip(bodies_nl).zip(status["run"]["results"].as_array().unwrap()) {
        let folder = data.join("runs/r1").join(well);
        let found = &json(&folder.join("measurement.json"))["fluorescence"];
        let per_nl = found["signal_per_nl"].as_f64().unwrap();
        let off = found["signal"].as_f64().unwrap() / (body_nl * glow.signal_per_nl()) - 1.0;
        println!(
            "{well}: {per_nl:.1} +- {:.1} per nl, truth of the body {:.1}; signal {:+.2} %, spread between views {:.2} %",
            found["signal_per_nl_sd"].as_f64().unwrap(),
            glow.signal_per_nl(),
            off * 100.0,
            found["signal_sd"].as_f64().unwrap() / found["signal"].as_f64().unwrap() * 100.0
        );
        assert!(off.abs() < 0.015, "{well}: {off}");
        // The error of the volume enters the signal per volume. For a larva the hull is up to 5 % above the body.
        let volume_nl = result["volume_um3"].as_f64().unwrap() * 1e-6;
        assert!((per_nl * volume_nl / found["signal"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{found}");
        assert!((per_nl / glow.signal_per_nl() - 1.0).abs() < if well == "A01" { 0.015 } else { 0.06 }, "{well}: {per_nl}");
        assert_eq!(found["views"].as_array().unwrap().len(), ASD, "{found}");
        assert_eq!(result["signal_per_nl"].as_f64(), Some(per_nl));
        let recording = json(&folder.join("recording.json"));
        // The signal follows the exposure, which is not that of the first camera.
        let exposure_us = |of: &Value| of["camera_features"]["ExposureTimeAbs"].as_str().and_then(|text| text.parse::<f64>().ok());
        let (first, second) = (exposure_us(&recording["rig"]), exposure_us(&recording["rig"]["second"]));
        assert!(second.is_some_and(|us| (us - 8000.0).abs() < 50.0) && first != second, "{first:?} {second:?}");
        for entry in recording["ledger"].as_array().unwrap() {
            let seen = &entry["second"];
            assert!(exposures.iter().any(|e| seen["sha256"] == hex(&e.sha256)), "a frame that was never exposed: {entry}");
        }
        contract::specimen_follows_it(&daemon, "r1", well);
        assert!(folder.join("second/view_000.png").is_file() && folder.join("second/closure.png").is_file());
        let output = run(&["measure", folder.to_str().unwrap()]);
        assert!(output.status.success(), "{}", stderr(&output));
        assert_eq!(serde_json::from_slice::<Value>(&output.stdout).unwrap()["stored"], "identical");
    }
    // The recorded frames are measured: a replaced frame is refused by name.
    let folder = data.join("runs/r1/A01/second");
    std::fs::copy(folder.join("view_001.png"), folder.join("view_002.png")).unwrap();
    let said = stderr(&run(&["measure", data.join("runs/r1/A01").to_str().unwrap()]));
    assert!(said.contains("view_002.png") && said.contains("SHA-256"), "{said}");
}

/// View 4 of 12 is wrong, without fluorescence. When it is taken again, it is right.
#[test]
fn a_view_that_is_taken_again_is_taken_again_by_both_cameras() {
    let at_rad = 2.0..2.2;
    let mut bench = Bench::seen_by(|scene| Arc::new(Spoiled::bent(scene, at_rad.clone(), 1.0)));
    let settings = FluorescentSettings::default();
    let background = settings.background as u8;
    let glow = Arc::new(Fluorescent::new(bench.scene.clone(), settings.clone()));
    let (width, height) = glow.size();
    let dark = Spoiled::new(glow.clone(), at_rad, move |_, format| Pixels::filled(width, height, format, background));
    let second = bench.rig.add_camera(Arc::new(dark)).unwrap();
    let changes = [("asd = 21", "asd = 12".to_owned()), ("voxel_um = 6.93", "voxel_um = 17.1".to_owned())];
    let daemon = bench.serve(&changes, &tables(second, &settings));
    let specimen = larva("A01");
    let body_nl = specimen.2.truth().volume_um3 * 1e-6;
    let status = bench.measured(&daemon, "r1", "standard", &[specimen]);
    assert_eq!(status["run"]["results"][0]["outcome"], "succeeded", "{status}");

    let a01 = bench.data().join("runs/r1/A01");
    let recording = json(&a01.join("recording.json"));
    let takes: Vec<&Value> = recording["ledger"].as_array().unwrap().iter().filter(|e| e["view"] == 4).collect();
    assert_eq!((takes.len(), &takes[1]["retake"]), (2, &json!(1)), "{takes:?}");
    assert!(takes[0]["second"]["sha256"] != takes[1]["second"]["sha256"] && takes[1]["second"]["sha256"].is_string(), "{takes:?}");
    for name in ["second/view_004.png", "second/view_004.retake-1.png", "second/closure.retake-1.png"] {
        assert!(a01.join(name).is_file(), "{name}");
    }
    let found = json(&a01.join("measurement.json"))["fluorescence"].clone();
    let signals: Vec<(u64, f64)> =
        found["views"].as_array().unwrap().iter().map(|v| (v["view"].as_u64().unwrap(), v["signal"].as_f64().unwrap())).collect();
    let mut views: Vec<u64> = signals.iter().map(|(view, _)| *view).collect();
    views.sort_unstable();
    assert_eq!(views, (0..12).collect::<Vec<u64>>(), "each view once");
    // As above: perspective, facets and noise.
    for (view, signal) in signals {
        let off = signal / (body_nl * glow.signal_per_nl()) - 1.0;
        assert!(off.abs() < 0.03, "view {view}: {off}");
    }
    let output = run(&["measure", a01.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(serde_json::from_slice::<Value>(&output.stdout).unwrap()["stored"], "identical");
}

#[test]
fn half_of_a_second_camera_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/config/vast-grbl.toml")).unwrap();
    let whole = tables("127.0.0.9".parse().unwrap(), &FluorescentSettings::default());
    let config = dir.path().join("rig.toml");
    let check = |tables: &str| {
        std::fs::write(&config, text.clone() + tables).unwrap();
        let output = run(&["config", "check", config.to_str().unwrap()]);
        (output.status.success(), stderr(&output))
    };
    assert!(check(&whole).0, "{}", check(&whole).1);
    let (ok, said) = check(whole.split("\n[optics_second]").next().unwrap());
    assert!(!ok && said.contains("[optics_second]"), "{said}");
    let (ok, said) = check(&whole.replace("Mono8", "BayerRG8"));
    assert!(!ok && said.contains("expected Mono8"), "{said}");
}

/// The cable of the second camera is pulled during a turn. The larva is fine and waits in the capillary.
#[test]
fn a_second_camera_that_dies_in_mid_turn_holds_the_run_and_the_same_larva_is_measured_once_it_is_back() {
    let mut bench = Bench::new();
    let settings = FluorescentSettings::default();
    let second = bench.rig.add_camera(Arc::new(Fluorescent::new(bench.scene.clone(), settings.clone()))).unwrap();
    let policy = "policy = { retries = 1, interrupted = \"skip\", bead_gate = \"off\" }";
    let changes = [("asd = 21", format!("asd = 21\n{policy}")), ("voxel_um = 6.93", "voxel_um = 17.1".to_owned())];
    let daemon = bench.serve(&changes, &tables(second, &settings));
    let (well, planned, specimen) = larva("A01");
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "t", "plate_map": [planned]});
    assert_eq!(daemon.put_run("r1", &plan), 201);
    daemon.wait("the loader to be asked", |s| s["state"] == "Suspended" && s["plate"]["bring"] == well);
    bench.scene.load(Some(specimen)).unwrap();
    assert_eq!(daemon.put_loaded("r1", well), 200);
    daemon.wait("the middle of the turn", |s| s["specimen"]["view"].as_u64() >= Some(3));
    let camera = bench.rig.faults().second_camera().unwrap();
    camera.pull_cable(true);

    let status = daemon.wait("the hold", |s| s["state"] == "Held" || !s["run"]["outcome"].is_null());
    assert_eq!(status["faults"].as_array().map(Vec::len), Some(1), "{status}");
    let fault = &status["faults"][0];
    assert_eq!((&fault["code"], &fault["operator_required"]), (&json!("second_camera_failed"), &json!(true)), "{status}");
    assert_eq!((&status["specimen"]["well"], &status["specimen"]["in_capillary"]), (&json!(well), &json!(true)), "{status}");
    assert_eq!((&status["plate"]["needs"], &status["plate"]["removable"]), (&Value::Null, &json!(false)), "{status}");
    assert_eq!(status["run"]["results"][0]["outcome"], Value::Null, "the larva is not to blame: {status}");
    let (code, problem) = daemon.send("POST", "/v1/runs/r1/unhold", &Value::Null);
    assert_eq!((code, &problem["code"]), (409, &json!("fault_stands")), "{problem}");

    camera.pull_cable(false);
    daemon.go_on("r1", fault);
    let status = daemon.wait("the run's end", |s| {
        assert!(s["state"] != "Suspended" && s["plate"]["bring"].is_null(), "the loader is asked for what is inside: {s}");
        !s["run"]["outcome"].is_null() || s["state"] == "Held"
    });
    assert_eq!((&status["run"]["outcome"], &status["faults"]), (&json!("succeeded"), &json!([])), "{status}");
    let text = std::fs::read_to_string(bench.data().join("events.jsonl")).unwrap();
    let count = |kind: &str| text.lines().filter(|line| line.contains(&format!("\"{kind}\""))).count();
    assert_eq!((count("well.awaited"), count("specimen.interrupted"), count("specimen.done")), (1, 1, 1));
    let found = json(&bench.data().join("runs/r1/A01/measurement.json"));
    assert_eq!(found["fluorescence"]["views"].as_array().map(Vec::len), Some(21), "{found}");
}
