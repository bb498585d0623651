//! The rows of a run, a specimen and an event. The daemon and a rebuild both write them here.

use super::cells;
use crate::columns::OfRun;
use crate::stored_run::TIMINGS;
use crate::{Computation, MEASUREMENT, RECORDING, RecordingFiles, RunRecord, StoredWell, attempts, run};
use carved_files::Tree;
use carved_records::{Event, EventData, PlannedWell, WellStatus, sha256_hex};
use rusqlite::{Connection, OptionalExtension, params};
use serde_json::Value;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A value as serde writes it: `succeeded`, `simulated`.
pub(crate) fn word<T: serde::Serialize>(value: &T) -> Option<String> {
    serde_json::to_value(value).ok()?.as_str().map(str::to_owned)
}

/// Modification time and length of a `run.json`, which show whether it has changed. Zeros if it does not exist.
pub(super) fn stamp(file: &Path) -> (i64, i64) {
    std::fs::metadata(file).map_or((0, 0), |m| (m.mtime() * 1_000_000_000 + m.mtime_nsec(), m.len() as i64))
}

/// Writes the rows of a run and its wells. The folders of unchanged wells are not read, unless `anew` is set.
pub(super) fn put_run(c: &Connection, root: &Path, record: &RunRecord, anew: bool) -> rusqlite::Result<()> {
    let folder = root.join("runs").join(&record.id);
    if anew {
        remove_run(c, &record.id)?;
    }
    let (ns, bytes) = stamp(&folder.join(run::FILE));
    let plan = &record.plan;
    let started_us = record.started.parse::<jiff::Timestamp>().map_or(0, jiff::Timestamp::as_microsecond);
    c.prepare_cached("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")?.execute(params![
        record.id,
        record.software.version,
        word(&record.mode),
        plan.plate_barcode,
        plan.method,
        plan.operator,
        plan.external_id,
        record.started,
        started_us,
        record.ended,
        word(&record.outcome),
        ns,
        bytes,
    ])?;
    cells::put_run(c, record)?;
    let of_run = OfRun::new(record);
    for status in &record.wells {
        let text = serde_json::to_string(status).unwrap_or_default();
        let known: Option<String> = c
            .prepare_cached("SELECT status FROM specimens WHERE run = ? AND well = ? AND attempt = 0")?
            .query_row(params![record.id, status.well], |row| row.get(0))
            .optional()?;
        if known.as_ref() == Some(&text) {
            continue;
        }
        let earlier = attempts::earlier(&folder, &status.well);
        let files = Files::read(&folder.join(attempts::folder_name(&status.well, 0)));
        put_specimen(c, &record.id, &status.well, 0, Some((status, &text)), &files.folder)?;
        if let Some((place, planned)) = plan.plate_map.iter().enumerate().find(|(_, planned)| planned.well == status.well) {
            cells::put_specimen(c, &of_run, place, &files.into_well(planned, status, earlier.len()))?;
        }
        for attempt in earlier {
            put_specimen(c, &record.id, &status.well, attempt, None, &folder.join(attempts::folder_name(&status.well, attempt)))?;
        }
    }
    Ok(())
}

pub(super) fn remove_run(c: &Connection, id: &str) -> rusqlite::Result<()> {
    for table in ["specimens", "specimen_cells", "run_cells"] {
        c.execute(&format!("DELETE FROM {table} WHERE run = ?"), [id])?;
    }
    c.execute("DELETE FROM runs WHERE id = ?", [id]).map(|_| ())
}

/// The files of one attempt at a well, as far as they are there and valid.
struct Files {
    folder: PathBuf,
    recording: Option<Value>,
    /// With the hash of its bytes.
    measurement: Option<(String, Value)>,
}

impl Files {
    fn read(folder: &Path) -> Self {
        let recording = json(&folder.join(RECORDING)).map(|(_, recording)| recording);
        Self { folder: folder.to_owned(), recording, measurement: json(&folder.join(MEASUREMENT)) }
    }

    fn into_well(self, planned: &PlannedWell, status: &WellStatus, earlier_attempts: usize) -> StoredWell {
        let (measurement_sha256, measurement) = self.measurement.unzip();
        StoredWell {
            planned: planned.clone(),
            status: Some(status.clone()),
            earlier_attempts,
            recording: self.recording,
            measurement,
            measurement_sha256,
            timings: json(&self.folder.join(TIMINGS)).map(|(_, timings)| timings),
            computation: Computation::OfRun,
            files: RecordingFiles::Folder(self.folder),
        }
        .without_claims_on_unseen_parts()
    }
}

/// Writes the row of one attempt at a well. Only the newest one has a status.
fn put_specimen(
    c: &Connection,
    run: &str,
    well: &str,
    attempt: u32,
    status: Option<(&WellStatus, &str)>,
    folder: &Path,
) -> rusqlite::Result<()> {
    let insert = "INSERT OR REPLACE INTO specimens VALUES (?, ?, ?, ?, ?, ?, ?)";
    c.prepare_cached(insert)?
        .execute(params![
            run,
            well,
            attempt,
            status.and_then(|(s, _)| word(&s.outcome)),
            status.map(|(s, _)| serde_json::to_string(&s.flags).unwrap_or_default()),
            bytes_of(folder),
            status.map(|(_, text)| text),
        ])
        .map(|_| ())
}

/// A JSON file and the hash of its bytes. `None` if it is missing or invalid. A reader of the recording reports this error.
fn json(path: &Path) -> Option<(String, Value)> {
    let text = carved_files::read_own(path).ok()?;
    Some((sha256_hex(&text), serde_json::from_slice(&text).ok()?))
}

/// Disk space of a folder, bytes. A link has none, and what it leads to is not counted.
fn bytes_of(folder: &Path) -> u64 {
    let Ok(tree) = Tree::of(folder) else { return 0 };
    tree.files.iter().filter_map(|name| folder.join(name).symlink_metadata().ok()).map(|m| m.len()).sum()
}

/// Writes an event, its effect on faults, and the length of the journal including this event.
pub(super) fn put_event(c: &Connection, event: &Event, journal_bytes: u64) -> rusqlite::Result<()> {
    let body = &event.body;
    c.prepare_cached("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?)")?.execute(params![
        event.id,
        body.time,
        body.data.kind(),
        body.run,
        body.well,
        body.data.to_json().to_string()
    ])?;
    match &body.data {
        EventData::FaultRaised(fault) => {
            c.prepare_cached("INSERT OR REPLACE INTO faults VALUES (?, ?, NULL, NULL)")?.execute(params![fault.seq, event.id])?;
        }
        EventData::FaultsCleared(over) => {
            for seq in &over.seq {
                c.prepare_cached("UPDATE faults SET cleared = ? WHERE seq = ?")?.execute(params![body.time, seq])?;
            }
        }
        EventData::FaultAcknowledged(known) => {
            c.prepare_cached("UPDATE faults SET acknowledged = ? WHERE seq = ?")?.execute(params![body.time, known.seq])?;
        }
        _ => {}
    }
    c.prepare_cached("UPDATE place SET journal_bytes = ?")?.execute([journal_bytes]).map(|_| ())
}
