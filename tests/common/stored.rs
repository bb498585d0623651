//! A run on disk without an instrument.

use carved_core::frame::{PixelFormat, RawFrame};
use carved_records::{Mode, RunOutcome, SpecimenOutcome};
use carved_store::{Claim, Recording, RecordingWriter, RunRecord, Store};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::path::Path;

/// Writes a run with one specimen, which has ended if there is an `outcome`.
pub fn stored(data: &Path, id: &str, outcome: Option<RunOutcome>) {
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
