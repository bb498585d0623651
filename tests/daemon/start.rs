//! The daemon on the emulated rig as a user meets it: the real program, real serial and network lines, the API, the files.

use crate::common::{Daemon, contract, copy_folder, json, run, stderr};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::path::Path;

fn well<'a>(status: &'a Value, name: &str) -> &'a Value {
    status["run"]["results"].as_array().unwrap().iter().find(|w| w["well"] == name).unwrap()
}

fn plan(wells: &[Value]) -> Value {
    json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells})
}

/// One demo plate, and every property of the files that it leaves.
#[test]
fn the_demo_plate_is_measured_stored_and_reproduced() {
    let dir = tempfile::tempdir().unwrap();
    let mut daemon = Daemon::start(&dir.path().join("data"), &["--time-scale", "10"]);
    // From its acceptance to its end a run never appears as idle or finished, also between two wells.
    let status = daemon.wait("the run's outcome", |s| {
        if s["run"]["id"].is_string() && s["run"]["outcome"].is_null() {
            assert!(!["Idle", "Complete", "Stopped"].contains(&s["state"].as_str().unwrap()), "{s}");
        }
        !s["run"]["outcome"].is_null() && s["state"] == "Complete"
    });
    assert_eq!(status["run"]["outcome"], "succeeded");
    assert_eq!(status["mode"], "simulated");
    assert_eq!(status["plate"]["removable"], true);
    let counts = &status["run"]["wells"];
    assert_eq!((&counts["succeeded"], &counts["skipped"], &counts["total"]), (&json!(3), &json!(1), &json!(4)), "{status}");
    assert_eq!(well(&status, "A04")["outcome"], "skipped");
    assert_eq!(well(&status, "A04")["reason"], "empty");

    let folder = daemon.run_folder();
    // The volume of a larva is within 5 % of its ideal hull. The carver is up to 4 % too large there, including the effect of the finite
    // number of views.
    for name in ["A01", "A02"] {
        let truth = &json(&folder.join(name).join("recording.json"))["truth"];
        let (found, hull) = (well(&status, name)["volume_um3"].as_f64().unwrap(), truth["hull_volume_um3"].as_f64().unwrap());
        assert!((found / hull - 1.0).abs() < 0.05, "{name}: {found:e} um^3, ideal hull {hull:e}");
    }
    assert!(
        well(&status, "A01")["volume_um3"].as_f64() < well(&status, "A02")["volume_um3"].as_f64(),
        "a larva of 3 dpf is smaller than one of 5 dpf"
    );
    let truth = &json(&folder.join("A03/recording.json"))["truth"];
    let (found, diameter) = (well(&status, "A03")["diameter_um"].as_f64().unwrap(), truth["diameter_um"].as_f64().unwrap());
    assert!((found / diameter - 1.0).abs() < 0.01, "bead: {found} um, truth {diameter} um");

    larvae_have_their_place(&status, &folder);
    for name in ["A01", "A02", "A03"] {
        live_equals_offline(&folder.join(name));
    }
    for name in ["A01", "A02", "A03", "A04"] {
        contract::specimen_follows_it(&daemon, status["run"]["id"].as_str().unwrap(), name);
    }
    empty_well_is_recorded(&folder.join("A04"));
    events_tell_the_run(&daemon, &dir.path().join("data/events.jsonl"));
    assert!(daemon.line_with("A02").contains("Succeeded"));

    larvae_have_their_standard_pictures(&daemon, &folder, dir.path());
    altered_recordings_are_refused(&folder.join("A03"), dir.path());
    replay_gives_the_same_numbers(&folder.join("A03"), dir.path());
}

/// The larvae of 3 and 5 dpf are placed among the paper's larvae of their age and ASD. The paper has no volumes by ASD, and a bead has no
/// age.
fn larvae_have_their_place(status: &Value, folder: &Path) {
    for (name, dpf, n) in [("A01", 3, 12), ("A02", 5, 24)] {
        let stored = &json(&folder.join(name).join("measurement.json"))["reference"]["estimates"][0]["area"]["known"];
        assert_eq!(stored["group"], format!("fixed ABxTL, {dpf} dpf, ASD 21"));
        let short = &well(status, name)["reference"];
        assert_eq!((&short["area"]["z"], &short["area"]["n"]), (&stored["z"], &json!(n)));
        let words = short["area"]["words"].as_str().unwrap();
        assert!(words.ends_with(&format!("the mean of {n} larvae of {dpf} dpf")), "{words}");
        assert!(short["volume"]["words"].as_str().unwrap().starts_with("volume: no reference"), "{short}");
        assert!(short["volume"]["z"].is_null(), "{short}");
    }
    assert!(well(status, "A03")["reference"].is_null());
    assert!(json(&folder.join("A03/measurement.json")).get("reference").is_none());
}

/// The left side and the back of each larva in its folder, by the links of its record, and the same again from the frames. A bead has none.
/// Twice on a busy machine a larva had none, and the cause is not known. The table must then say that its head or back is undecided, or that
/// its shape has no body axis.
fn larvae_have_their_standard_pictures(daemon: &Daemon, folder: &Path, scratch: &Path) {
    let run_id = folder.file_name().unwrap().to_str().unwrap();
    let out = scratch.join("pictures");
    let exported = run(&["export", "pictures", folder.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(exported.status.success(), "{}", stderr(&exported));
    let index = std::fs::read_to_string(out.join("pictures.csv")).unwrap();
    let lines: Vec<&str> = index.lines().collect();
    let is_reason = |line: &str| line.contains("is not decided") || line.contains("has no body axis");
    let has_none = |well: &str| lines.iter().any(|line| line.contains(&format!(",{well},")) && is_reason(line));
    let mut sizes = Vec::new();
    for well in ["A01", "A02"] {
        let links = &daemon.get(&format!("/v1/runs/{run_id}/specimens/{well}"))["links"];
        if has_none(well) {
            assert!(links["lateral_png"].is_null() && links["dorsal_tif"].is_null(), "{well}: {links}");
            continue;
        }
        for (link, file) in
            [("lateral_png", "lateral.png"), ("lateral_tif", "lateral.tif"), ("dorsal_png", "dorsal.png"), ("dorsal_tif", "dorsal.tif")]
        {
            let path = links[link].as_str().unwrap_or_else(|| panic!("{well} has no {link}: {links}; {index}"));
            let mut answer = ureq::get(format!("{}{path}", daemon.url)).call().unwrap();
            let kind = answer.headers()["content-type"].to_str().unwrap().to_owned();
            assert_eq!(kind, if file.ends_with("png") { "image/png" } else { "image/tiff" });
            let stored = std::fs::read(folder.join(well).join(file)).unwrap();
            assert!(answer.body_mut().read_to_vec().unwrap() == stored, "{well} {file}: another file is served");
            let again = std::fs::read(out.join(format!("{run_id}_{well}_{file}"))).unwrap();
            assert!(again == stored, "{well} {file}: the export differs");
            if let Some(name) = file.strip_suffix(".tif") {
                let picture = image::load_from_memory(&stored).unwrap().to_luma8();
                sizes.push(picture.dimensions());
                head_is_left(&picture, &format!("{well} {name}"));
            }
        }
    }
    assert!(sizes.len() >= 2 && sizes.iter().all(|size| *size == sizes[0]), "cropped alike: {sizes:?}; {index}");
    assert!(daemon.get(&format!("/v1/runs/{run_id}/specimens/A03"))["links"]["lateral_png"].is_null(), "a bead has no sides");
    let unknown = ureq::get(format!("{}/v1/runs/{run_id}/specimens/A01/ventral.png", daemon.url)).call();
    assert!(matches!(unknown, Err(ureq::Error::StatusCode(404))), "{unknown:?}");
    assert_eq!(lines[0], "run,well,picture,file,view,off_deg,confidence,um_per_px,reason");
    assert_eq!(lines.iter().filter(|line| line.ends_with(',')).count(), sizes.len(), "the pictures of the larvae: {index}");
    assert!(lines.iter().any(|line| line.contains(",A03,") && line.contains("is not decided")), "a bead has no head: {index}");
    assert!(lines.iter().any(|line| line.contains(",A04,") && line.contains("no numbers")), "{index}");
}

/// The eyes are the darkest compact part of a larva.
fn head_is_left(picture: &image::GrayImage, name: &str) {
    let (width, height) = picture.dimensions();
    // The middle half of the height: the walls are beyond it.
    let dark = picture.enumerate_pixels().filter(|(_, v, pixel)| (height / 4..3 * height / 4).contains(v) && pixel.0[0] < 60);
    let columns: Vec<u32> = dark.map(|(u, _, _)| u).collect();
    let left = columns.iter().filter(|u| **u < width / 2).count();
    assert!(columns.len() > 50 && left * 10 > columns.len() * 7, "{name}: {left} of {} dark pixels are at the left", columns.len());
}

/// `carved measure` computes the same bytes, and the last live volume is the measured one.
fn live_equals_offline(recording: &Path) {
    let output = run(&["measure", recording.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    let line: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(line["stored"], "identical", "{}", recording.display());
    let stored = json(&recording.join("measurement.json"));
    assert_eq!(line["measurement"], stored["measurement"]);
    assert_eq!(stored["views"].as_array().unwrap().len(), 21);

    let sums = std::process::Command::new("sha256sum")
        .args(["--check", "--strict", "--quiet", "SHA256SUMS"])
        .current_dir(recording)
        .status()
        .unwrap();
    assert!(sums.success(), "{}: sha256sum -c", recording.display());
    let ledger = json(&recording.join("recording.json"))["ledger"].clone();
    let ledger = ledger.as_array().unwrap();
    assert_eq!(ledger.len(), 22, "21 views and the closure view");
    for entry in ledger {
        let part = entry["view"].as_f64().unwrap();
        let target = (part * 500.0 / 21.0).round();
        assert_eq!(entry["commanded_steps"].as_f64(), Some(target), "integer absolute steps of 500");
        assert_eq!(entry["achieved_steps"], entry["commanded_steps"]);
        let omega = std::f64::consts::TAU * target / 500.0;
        assert!((entry["omega"].as_f64().unwrap() - omega).abs() < 1e-12, "the angle is the achieved one");
    }
}

fn empty_well_is_recorded(recording: &Path) {
    assert!(recording.join("frames/detect.png").is_file(), "the frame on which the well was judged");
    assert!(!recording.join("measurement.json").exists(), "an empty well has no number");
    let output = run(&["measure", recording.to_str().unwrap()]);
    assert!(!output.status.success());
    assert!(stderr(&output).contains("0 views are recorded, 21 were planned"), "{}", stderr(&output));
}

fn events_tell_the_run(daemon: &Daemon, journal: &Path) {
    let text = std::fs::read_to_string(journal).unwrap();
    let events: Vec<Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    for (i, event) in events.iter().enumerate() {
        assert_eq!(event["id"], json!(i + 1), "ids rise by one");
    }
    let volumes: Vec<f64> = events
        .iter()
        .filter(|e| e["kind"] == "view.taken" && e["well"] == "A02")
        .filter_map(|e| e["data"]["hull_volume_um3"].as_f64())
        .collect();
    assert_eq!(volumes.len(), 21);
    // The live hull only shrinks from view to view. A new calibration may give back what earlier views removed by mistake.
    assert!(volumes.windows(2).all(|w| w[1] <= 1.1 * w[0]), "{volumes:?}");
    let status = daemon.status();
    // The live hull is that of the paper, some per cent larger than the measured volume.
    let a02 = well(&status, "A02");
    let excess = volumes[20] / a02["volume_um3"].as_f64().unwrap() - 1.0;
    assert!((0.0..0.06).contains(&excess), "{excess}");
    assert_eq!(a02["estimator"], "support", "{a02}");
    let spread = a02["volume_sd_um3"].as_f64().unwrap() / a02["volume_um3"].as_f64().unwrap();
    assert!((1e-4..0.02).contains(&spread), "{spread}");
}

fn altered_recordings_are_refused(recording: &Path, scratch: &Path) {
    let copy = scratch.join("altered");
    copy_folder(recording, &copy);
    let frame = copy.join("frames/view_007.png");
    std::fs::copy(copy.join("frames/view_008.png"), &frame).unwrap();
    let output = run(&["measure", copy.to_str().unwrap()]);
    let said = stderr(&output);
    assert!(!output.status.success() && said.contains("view_007.png") && said.contains("SHA-256"), "{said}");

    std::fs::remove_file(&frame).unwrap();
    let said = stderr(&run(&["measure", copy.to_str().unwrap()]));
    assert!(said.contains("view_007.png") && said.contains("missing"), "{said}");

    let file = copy.join("recording.json");
    let text = std::fs::read_to_string(&file).unwrap().replace("\"epsilon\": 0.05", "\"epsilon\": 0.10");
    std::fs::write(&file, text).unwrap();
    let said = stderr(&run(&["measure", copy.to_str().unwrap()]));
    assert!(said.contains("recording.json") && said.contains("SHA-256"), "{said}");
}

fn replay_gives_the_same_numbers(recording: &Path, scratch: &Path) {
    let mut daemon = Daemon::start(&scratch.join("replayed"), &["--time-scale", "10", "--replay", recording.to_str().unwrap()]);
    let line = daemon.line_with("Replayed numbers");
    assert!(line.contains("identical, bit for bit"), "{line}");
    let replayed = daemon.run_folder().join("A03");
    assert_eq!(std::fs::read(recording.join("measurement.json")).unwrap(), std::fs::read(replayed.join("measurement.json")).unwrap());
    assert_eq!(std::fs::read(recording.join("mesh.ply")).unwrap(), std::fs::read(replayed.join("mesh.ply")).unwrap());
    let model = std::fs::read(recording.join("model.glb")).unwrap();
    assert_eq!(model, std::fs::read(replayed.join("model.glb")).unwrap());
    let surface = std::fs::metadata(recording.join("mesh.ply")).unwrap().len();
    assert!(model.starts_with(b"glTF") && (model.len() as u64) < surface / 4, "{} of {surface} bytes", model.len());
}

/// kill -9 during a revolution: everything that was acknowledged is readable, and the next start finds the run.
#[test]
fn a_killed_daemon_loses_nothing_that_it_acknowledged() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = Daemon::start(&data, &["--time-scale", "4", "--no-demo", "--small"]);
    assert_eq!(daemon.put_run("r1", &plan(&[json!({"well": "B02", "dpf": 4}), json!({"well": "B03", "dpf": 4})])), 201);
    let status = daemon.wait("five views", |s| s["specimen"]["view"].as_u64() >= Some(5));
    let acknowledged = status["specimen"]["view"].as_u64().unwrap() as usize;
    daemon.signal("KILL");
    daemon.ended();

    let recording = json(&data.join("runs/r1/B02/recording.json"));
    let ledger = recording["ledger"].as_array().unwrap();
    assert!(ledger.len() >= acknowledged, "{} of {acknowledged} acknowledged views are in the ledger", ledger.len());
    for entry in ledger {
        // The PNG of a mosaic has one grey channel: its pixels are the bytes that the camera sent.
        let name = format!("runs/r1/B02/frames/view_{:03}.png", entry["view"].as_u64().unwrap());
        let frame = image::open(data.join(&name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((frame.color(), frame.width(), frame.height()), (image::ColorType::L8, 1024, 256), "{name}");
        let hash: String = Sha256::digest(frame.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(entry["sha256"], hash, "{name} is not what the camera sent");
    }
    let said = stderr(&run(&["measure", data.join("runs/r1/B02").to_str().unwrap()]));
    assert!(said.contains("the revolution was not finished"), "{said}");
    assert_eq!(json(&data.join("runs/r1/run.json"))["outcome"], Value::Null);

    let daemon = Daemon::start(&data, &["--time-scale", "10", "--no-demo", "--small"]);
    let status = daemon.wait("the run", |s| s["run"]["id"] == "r1");
    assert_ne!(status["state"], "Idle", "a run without an outcome: {status}");
    // A client that repeats the same plan gets the same run. It is not started twice.
    assert_eq!(daemon.put_run("r1", &plan(&[json!({"well": "B02", "dpf": 4}), json!({"well": "B03", "dpf": 4})])), 200);
    assert_eq!(daemon.put_run("r1", &plan(&[json!({"well": "B02"})])), 409);
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200);
    assert_eq!(daemon.wait_for_outcome()["run"]["outcome"], "aborted");
}

/// SIGTERM during a move: the axis stops under control, and the record is closed.
#[test]
fn a_signal_stops_the_motor_and_closes_the_record() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = Daemon::start(&data, &["--no-demo", "--small"]);
    assert_eq!(daemon.put_run("r1", &plan(&[json!({"well": "C01", "dpf": 5})])), 201);
    daemon.wait("two views", |s| s["specimen"]["view"].as_u64() >= Some(2));
    daemon.signal("TERM");
    assert_eq!(daemon.ended(), Some(0));
    let record = json(&data.join("runs/r1/run.json"));
    assert_eq!(record["outcome"], "interrupted");
    assert_eq!(record["wells"][0]["outcome"], "interrupted");
    assert!(data.join("runs/r1/C01/SHA256SUMS").is_file(), "the recording is closed");
    assert!(std::fs::read_to_string(data.join("events.jsonl")).unwrap().contains("daemon.stopped"));
}

/// An abort is acknowledged at once, ends without further requests, and is not reported as success. The next run starts from this state.
#[test]
fn an_abort_ends_as_aborted_and_a_new_run_may_follow() {
    let dir = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&dir.path().join("data"), &["--time-scale", "4", "--no-demo", "--small"]);
    assert_eq!(daemon.put_run("r1", &plan(&[json!({"well": "A01"}), json!({"well": "A02"})])), 201);
    daemon.wait("a view", |s| s["specimen"]["view"].as_u64() >= Some(1));
    assert_eq!(daemon.put_run("r2", &plan(&[json!({"well": "A03", "specimen": "bead"})])), 409, "one run at a time");
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200);
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200, "a repeat answers the same");
    let status = daemon.wait("the abort", |s| s["state"] == "Aborted");
    assert_eq!(status["run"]["outcome"], "aborted");
    assert_eq!(status["faults"], json!([]), "an abort is no fault");
    assert_eq!(daemon.post("/v1/runs/unknown/abort"), 404);

    assert_eq!(daemon.put_run("r2", &plan(&[json!({"well": "A03", "specimen": "bead"})])), 201);
    let status = daemon.wait("the second run", |s| s["run"]["id"] == "r2" && !s["run"]["outcome"].is_null());
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
}

#[test]
fn bad_starts_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let holder = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = holder.local_addr().unwrap().to_string();
    let output = run(&["simulate", "--listen", &taken, "--data", data.to_str().unwrap()]);
    assert!(!output.status.success());
    assert!(stderr(&output).contains(&taken) && stderr(&output).contains("--listen"), "{}", stderr(&output));

    let output = run(&["simulate", "--replay", "/nowhere/A01", "--data", data.to_str().unwrap(), "--listen", "127.0.0.1:0"]);
    assert!(!output.status.success());
    assert!(stderr(&output).contains("/nowhere/A01"), "{}", stderr(&output));

    // Nothing is started, because an address in use would give another message.
    let output = run(&["simulate", "--empty", "A03,Z99", "--listen", &taken, "--data", data.to_str().unwrap()]);
    assert!(!output.status.success());
    let said = stderr(&output);
    assert!(said.contains("Z99") && said.contains("A01 to AF48") && !said.contains(&taken), "{said}");

    let output = run(&["serve"]);
    assert!(!output.status.success(), "a daemon without a configuration does not fall back to simulation");
    assert!(stderr(&output).contains("--config"), "{}", stderr(&output));

    let config = dir.path().join("rig.toml");
    let sample = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("config/vast-grbl.toml")).unwrap();
    let sample = sample.replace("/dev/carved-rotation", "/dev/no-such-port").replace("127.0.0.1:8420", "127.0.0.1:0");
    let sample = sample.replace("/var/lib/carved", data.to_str().unwrap());
    assert!(sample.contains("127.0.0.1:0"), "a port that another test or daemon may hold");
    std::fs::write(&config, sample).unwrap();
    let output = run(&["serve", "--config", config.to_str().unwrap()]);
    assert!(!output.status.success());
    assert!(stderr(&output).contains("/dev/no-such-port"), "{}", stderr(&output));

    // The holder of the data folder owns the instrument: a second daemon opens no port.
    let _another = carved_store::Claim::on(&data).unwrap();
    for args in [["serve", "--config", config.to_str().unwrap()], ["simulate", "--data", data.to_str().unwrap()]] {
        let output = run(&[&args[..], if args[0] == "serve" { &[] } else { &["--listen", "127.0.0.1:0"] }].concat());
        assert!(!output.status.success());
        let said = stderr(&output);
        assert!(said.contains("another carved uses this folder") && !said.contains("no-such-port"), "{said}");
    }
}
