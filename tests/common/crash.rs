//! Restores the state on disk that a crash leaves, from a run that ended. This is reproducible and needs no kill at the right moment.

use super::json;
use carved_records::{WellStatus, kind};
use carved_store::RunRecord;
use serde_json::Value;
use std::path::Path;

/// The files made from a specimen's frames. All of them are written while the next specimen is loaded.
pub const RESULTS: [&str; 5] = ["mesh.ply", "model.glb", "measurement.json", "timings.json", "SHA256SUMS"];

/// Takes an ended run back to the moment before its first well was done: the specimen is accepted and released, its numbers are not
/// reported yet, and the later wells were never loaded. `asked` is the last event, a request of an operator such as `run.abort_requested`.
pub fn before_the_first_well_was_done(data: &Path, run: &str, asked: Option<&str>) {
    let folder = data.join("runs").join(run);
    let mut record: RunRecord = serde_json::from_value(json(&folder.join("run.json"))).unwrap();
    let first = record.plan.plate_map[0].well.clone();
    for later in &record.plan.plate_map[1..] {
        std::fs::remove_dir_all(folder.join(&later.well)).unwrap();
    }
    record.wells = record.plan.plate_map.iter().map(WellStatus::pending).collect();
    (record.ended, record.outcome) = (None, None);
    std::fs::write(folder.join("run.json"), serde_json::to_vec_pretty(&record).unwrap()).unwrap();

    let text = std::fs::read_to_string(data.join("events.jsonl")).unwrap();
    let is_done = |event: &Value| event["kind"] == "specimen.done" && event["well"] == first.as_str();
    let events = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let mut kept: Vec<Value> = events.take_while(|event| !is_done(event)).collect();
    if let Some(kind) = asked {
        let last = kept.last().unwrap();
        let id = last["id"].as_u64().unwrap() + 1;
        kept.push(serde_json::json!({"id": id, "time": last["time"], "kind": kind, "run": run, "well": null, "data": null}));
    }
    let lines = |kept: &mut dyn Iterator<Item = &Value>| kept.map(|event| format!("{event}\n")).collect::<String>();
    std::fs::write(folder.join("events.jsonl"), lines(&mut kept.iter().filter(|e| e["run"] == run))).unwrap();
    std::fs::write(data.join("events.jsonl"), lines(&mut kept.iter())).unwrap();
    for index in ["index.sqlite", "index.sqlite-wal", "index.sqlite-shm"] {
        let _ = std::fs::remove_file(data.join(index));
    }
}

/// Appends events of a well to the journals of a run.
pub fn happened(data: &Path, run: &str, kinds: &[&str], well: &str) {
    for journal in [data.join("events.jsonl"), data.join("runs").join(run).join("events.jsonl")] {
        let mut text = std::fs::read_to_string(&journal).unwrap();
        let last: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        for (id, kind) in (last["id"].as_u64().unwrap() + 1..).zip(kinds) {
            let event = serde_json::json!({"id": id, "time": last["time"], "kind": kind, "run": run, "well": well, "data": {}});
            text.push_str(&format!("{event}\n"));
        }
        std::fs::write(journal, text).unwrap();
    }
}

/// Removes everything that was made from the frames of a well.
pub fn without_results(well: &Path) {
    for name in RESULTS {
        std::fs::remove_file(well.join(name)).unwrap();
    }
}
