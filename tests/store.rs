//! Commands on stored runs: archive, prune, index, replay.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

mod common;

use carved::frame::{PixelFormat, RawFrame};
use carved::session::{Mode, RunOutcome, SpecimenOutcome};
use carved::store::{Claim, Recording, RecordingWriter, RunRecord, Store};
use common::{carved, run, stderr};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::path::Path;
use std::process::Output;

/// A run with one specimen, ended or not.
fn stored(data: &Path, id: &str, outcome: Option<RunOutcome>) {
    let (store, _journal, _) = Claim::on(data).and_then(Store::open).unwrap();
    let plan = json!({"plate_barcode": "P-1", "method": "m", "operator": "kim", "plate_map": [{"well": "A01", "dpf": 3}]});
    let method = json!({"asd": 3, "order": "sequential", "epsilon": 0.05, "voxel_um": 20.0});
    let (plan, method) = (serde_json::from_value(plan).unwrap(), serde_json::from_value(method).unwrap());
    let mut record = RunRecord::new(id, plan, method, Mode::Simulated, None);
    let rig = json!({
        "name": "rig", "pixel_format": "Mono8", "steps_per_revolution": [500, 1], "sense": 1,
        "camera": {"f": 60000.0, "kx": 0.18, "ky": 0.18, "ux": 8.0, "uy": 8.0, "width": 16, "height": 16},
        "rotation_identity": "axis", "camera_identity": "camera"
    });
    let planned = record.plan.plate_map[0].clone();
    let recording = Recording::new(id, planned, Mode::Simulated, serde_json::from_value(rig).unwrap(), "m", record.method.clone());
    let mut writer = RecordingWriter::create(&store.run_folder(id).join("A01"), recording, None).unwrap();
    for view in 0..3u32 {
        let frame = RawFrame::new(16, 16, PixelFormat::Mono8, vec![view as u8 + 7; 256]).unwrap();
        let sha256: String = Sha256::digest(frame.bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        let entry = json!({"view": view, "commanded_steps": 0, "achieved_steps": 0, "epoch": 1, "omega": f64::from(view), "moved_ms": 0.0,
            "settle_ms": 0.0, "grab_ms": 0.0, "frame_id": view, "attempts": 1, "sha256": sha256, "closure": false});
        writer.add_view(serde_json::from_value(entry).unwrap(), &frame).unwrap();
    }
    writer.add_file("mesh.ply", b"ply").unwrap();
    writer.close().unwrap();
    if let Some(outcome) = outcome {
        record.wells[0].end(SpecimenOutcome::Failed, Some("too few views"));
        record.end(outcome);
    }
    store.save_run(&record).unwrap();
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(output))
}

#[test]
fn a_run_is_archived_with_a_receipt_and_pruned_only_while_the_copy_is_good() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    stored(&data, "r1", Some(RunOutcome::Failed));
    let at = |args: &[&str]| carved().current_dir(dir.path()).args(args).output().unwrap();
    let here = data.join("runs/r1");
    let frame = here.join("A01/frames/view_001.png");

    let output = at(&["prune", "data", "r1", "--yes"]);
    assert!(!output.status.success() && text(&output).contains("never archived"), "{}", text(&output));
    // Names without a folder before them, as one types them.
    let output = at(&["archive", "data/runs/r1", "--to", "copies"]);
    assert!(output.status.success() && text(&output).contains("every hash verified"), "{}", text(&output));
    let copy = dir.path().join("copies/r1");
    for name in ["run.json", "A01/recording.json", "A01/frames/view_001.png", "A01/SHA256SUMS"] {
        assert_eq!(std::fs::read(copy.join(name)).unwrap(), std::fs::read(here.join(name)).unwrap(), "{name}");
    }
    assert!(copy.join("archive.json").is_file());

    // A copy with one bit flipped is no copy.
    let good = std::fs::read(copy.join("A01/mesh.ply")).unwrap();
    std::fs::write(copy.join("A01/mesh.ply"), b"plz").unwrap();
    let output = at(&["prune", "data", "r1", "--yes"]);
    assert!(!output.status.success() && text(&output).contains("its copy is not good"), "{}", text(&output));
    std::fs::write(copy.join("A01/mesh.ply"), good).unwrap();
    // Nor does it hold what was changed here since.
    let kept = std::fs::read(&frame).unwrap();
    std::fs::write(&frame, b"changed since").unwrap();
    let output = at(&["prune", "data", "r1", "--yes"]);
    assert!(!output.status.success() && text(&output).contains("view_001.png is not in its copy"), "{}", text(&output));
    std::fs::write(&frame, kept).unwrap();

    let output = at(&["prune", "data"]);
    assert!(output.status.success() && text(&output).contains("r1: would remove 3 files"), "{}", text(&output));
    assert!(frame.is_file(), "a dry run removes nothing");
    let output = at(&["prune", "data", "--yes"]);
    assert!(output.status.success() && text(&output).contains("r1: removed 3 files"), "{}", text(&output));
    assert!(!frame.exists() && here.join("A01/mesh.ply").is_file() && here.join("A01/recording.json").is_file());
    let output = at(&["archive", "data/runs/r1", "--to", "others"]);
    assert!(!output.status.success() && text(&output).contains("view_000.png"), "no copy of half a run: {}", text(&output));

    let output = at(&["prune", "data", "r1", "--all", "--yes"]);
    assert!(output.status.success(), "{}", text(&output));
    assert!(!here.exists() && copy.join("A01/frames/view_001.png").is_file());
    let store = Claim::on(&data).and_then(Store::open).unwrap().0;
    assert_eq!(store.budget(None).unwrap().used_bytes, 0);
}

#[test]
fn a_run_under_way_is_not_archived_and_other_files_are_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    stored(&data, "open", None);
    stored(&data, "r1", Some(RunOutcome::Failed));
    let to = dir.path().join("copies");
    let archive = |id: &str, to: &Path| run(&["archive", data.join("runs").join(id).to_str().unwrap(), "--to", to.to_str().unwrap()]);
    assert!(text(&archive("open", &to)).contains("no outcome"), "{}", text(&archive("open", &to)));
    std::fs::create_dir_all(to.join("r1/A01")).unwrap();
    std::fs::write(to.join("r1/A01/mesh.ply"), "somebody's").unwrap();
    let output = archive("r1", &to);
    assert!(!output.status.success() && text(&output).contains("nothing is overwritten"), "{}", text(&output));
    // What was cut short is finished.
    std::fs::remove_file(to.join("r1/A01/mesh.ply")).unwrap();
    assert!(archive("r1", &to).status.success());
    assert!(text(&archive("r1", &data.join("runs"))).contains("apart from the run's own"));
    std::fs::write(data.join("runs/r1/A01/mesh.ply"), "altered").unwrap();
    assert!(text(&archive("r1", &dir.path().join("more"))).contains("SHA-256"));
}

#[test]
fn the_index_is_rebuilt_by_hand_and_not_under_a_daemon() {
    let dir = tempfile::tempdir().unwrap();
    stored(dir.path(), "r1", Some(RunOutcome::Failed));
    let data = dir.path().to_str().unwrap();
    std::fs::write(dir.path().join("index.sqlite"), "broken").unwrap();
    let output = run(&["index", "rebuild", data]);
    assert!(output.status.success() && text(&output).contains("1 run(s), 0 of them"), "{}", text(&output));
    std::fs::create_dir(dir.path().join("runs/r2")).unwrap();
    std::fs::write(dir.path().join("runs/r2/run.json"), r#"{"schema": "carved.run/9", "software": {"version": "7.0"}}"#).unwrap();
    let output = run(&["index", "rebuild", data]);
    assert!(!output.status.success() && text(&output).contains("carved.run/9"), "{}", text(&output));
    let _daemon = Claim::on(dir.path()).and_then(Store::open).unwrap();
    assert!(text(&run(&["index", "rebuild", data])).contains("another carved uses this folder"));
}
