//! What outlives the daemon: run folders that are sufficient by themselves, and the event journal.
//!
//! ```text
//! DATA/events.jsonl               append-only, synced line by line
//! DATA/calibrations/              what is known of the rig's size (see `calibrations`)
//! DATA/runs/RUN/run.json          plan, method, outcome, one entry per well
//! DATA/runs/RUN/A01/              a recording with its results (see `recording`)
//! ```

pub mod calibrations;
pub mod durable;
mod error;
pub mod frames;
pub mod gates;
mod journal;
mod recording;
mod sums;

pub use error::StoreError;
pub use journal::Journal;
pub use recording::{
    MEASUREMENT, MeasurementFile, Recording, RecordingReader, RecordingWriter, RigRecord, SecondRecord, Software, fluorescence,
};

use crate::config::Method;
use crate::frame::RawFrame;
use crate::hash::sha256_hex;
use crate::session::{Event, Mode, RunOutcome, RunPlan, SpecimenOutcome, WellStatus};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::{Path, PathBuf};

const RUN_SCHEMA: &str = "carved.run/1";

/// `run.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    pub schema: String,
    pub id: String,
    pub software: Software,
    pub mode: Mode,
    pub plan: RunPlan,
    pub method: Method,
    /// Of the empty capillary's picture that the frames are compared with, as in every `recording.json`.
    #[serde(default)]
    pub empty_capillary_sha256: Option<String>,
    /// RFC 3339, UTC.
    pub started: String,
    pub ended: Option<String>,
    pub outcome: Option<RunOutcome>,
    pub wells: Vec<WellStatus>,
}

impl RunRecord {
    pub fn new(id: &str, plan: RunPlan, method: Method, mode: Mode, empty: Option<&RawFrame>) -> Self {
        let wells = plan.plate_map.iter().map(WellStatus::pending).collect();
        Self {
            schema: RUN_SCHEMA.into(),
            id: id.into(),
            software: Software::this(),
            mode,
            plan,
            method,
            empty_capillary_sha256: empty.map(|frame| sha256_hex(frame.bytes())),
            started: jiff::Timestamp::now().to_string(),
            ended: None,
            outcome: None,
            wells,
        }
    }

    pub fn end(&mut self, outcome: RunOutcome) {
        self.ended = Some(jiff::Timestamp::now().to_string());
        self.outcome = Some(outcome);
    }
}

/// The data folder, held by one daemon at a time.
pub struct Store {
    root: PathBuf,
    _lock: File,
}

impl Store {
    /// Opens or creates the data folder and its journal.
    pub fn open(root: &Path) -> Result<(Self, Journal, Vec<Event>), StoreError> {
        durable::create_folder(&root.join("runs"))?;
        let lock_path = root.join("lock");
        let lock = File::create(&lock_path).map_err(StoreError::io("create", &lock_path))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => return Err(StoreError::Locked { path: root.to_owned() }),
            Err(std::fs::TryLockError::Error(e)) => return Err(StoreError::io("lock", &lock_path)(e)),
        }
        let (journal, events) = Journal::open(&root.join("events.jsonl"))?;
        Ok((Self { root: root.to_owned(), _lock: lock }, journal, events))
    }

    pub fn run_folder(&self, run: &str) -> PathBuf {
        self.root.join("runs").join(run)
    }

    pub fn save_run(&self, run: &RunRecord) -> Result<(), StoreError> {
        let folder = self.run_folder(&run.id);
        durable::create_folder(&folder)?;
        durable::write_json(&folder.join("run.json"), run)
    }

    /// Takes back a run that was not accepted after all.
    pub fn forget_run(&self, id: &str) -> Result<(), StoreError> {
        let file = self.run_folder(id).join("run.json");
        match std::fs::remove_file(&file) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(StoreError::io("remove", &file)(e)),
            _ => Ok(()),
        }
    }

    /// The run of this name, if there is one.
    pub fn run(&self, id: &str) -> Result<Option<RunRecord>, StoreError> {
        let file = self.run_folder(id).join("run.json");
        if file.exists() { durable::read_json(&file, "a run (carved.run/1)").map(Some) } else { Ok(None) }
    }

    /// Ends what a crash left open, and says which runs those were: the pose of a specimen under way is lost, and a run
    /// that nobody works on must not look as if somebody did.
    pub fn close_interrupted(&self) -> Result<Vec<RunRecord>, StoreError> {
        let runs = self.root.join("runs");
        let mut closed = Vec::new();
        for entry in std::fs::read_dir(&runs).map_err(StoreError::io("list", &runs))? {
            let file = entry.map_err(StoreError::io("list", &runs))?.path().join("run.json");
            if !file.exists() {
                continue;
            }
            let mut run: RunRecord = durable::read_json(&file, "a run (carved.run/1)")?;
            if run.outcome.is_none() {
                for well in run.wells.iter_mut().filter(|w| w.outcome.is_none()) {
                    well.end(SpecimenOutcome::Interrupted, Some("the daemon ended before this well was done"));
                }
                run.end(RunOutcome::Interrupted);
                self.save_run(&run)?;
                closed.push(run);
            }
        }
        closed.sort_by(|a, b| a.started.cmp(&b.started));
        Ok(closed)
    }

    /// Free space where the data are, bytes.
    pub fn free_bytes(&self) -> Option<u64> {
        let s = nix::sys::statvfs::statvfs(&self.root).ok()?;
        Some(s.blocks_available() * s.fragment_size())
    }
}
