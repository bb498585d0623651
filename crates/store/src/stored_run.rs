//! A run as tables and reports read it: the record, and well by well the files with numbers.
//!
//! ```text
//! runs/RUN/run.json ─────────── StoredRun::read ── record
//! runs/RUN/A01/recording.json ─┐
//!              measurement.json ├─ StoredRun::well ── StoredWell      one well at a time: a plate's files are some 100 MB in memory
//!              timings.json ────┘
//! ```
//! The files are JSON as they are on disk, because tables must be readable of runs of every earlier build. A file is compared with
//! `SHA256SUMS` before it is believed.

use super::recording::{MEASUREMENT, RECORDING};
use super::{RecordingFiles, RunRecord, StoreError, StoreReader, attempts, recording, schema};
use carved_records::{PlannedWell, WellStatus, sha256_hex};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Name of the file with a specimen's times.
const TIMINGS: &str = "timings.json";

/// A run and where it is.
#[derive(Debug)]
pub struct StoredRun {
    folder: PathBuf,
    record: RunRecord,
}

/// One planned well of a run, of its newest attempt.
#[derive(Debug)]
pub struct StoredWell {
    pub planned: PlannedWell,
    /// The well's entry in `run.json`.
    pub status: Option<WellStatus>,
    /// Number of attempts before this one.
    pub earlier_attempts: usize,
    /// Files of the recording, whether or not there are any.
    pub files: RecordingFiles,
    /// `recording.json`. `None` where nothing was recorded.
    pub recording: Option<Value>,
    /// `measurement.json`. `None` where nothing was measured.
    pub measurement: Option<Value>,
    /// SHA-256 of the bytes of `measurement.json`.
    pub measurement_sha256: Option<String>,
    /// `timings.json`. `None` where the recording was not closed.
    pub timings: Option<Value>,
}

impl StoredRun {
    /// Reads the run of a folder, which may be a copy.
    ///
    /// # Errors
    /// No run, or one that cannot be read.
    pub fn read(folder: &Path) -> Result<Self, StoreError> {
        Ok(Self { folder: folder.to_owned(), record: RunRecord::of_folder(folder)? })
    }

    /// `run.json`.
    pub fn record(&self) -> &RunRecord {
        &self.record
    }

    /// The run's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The files with numbers of a planned well.
    ///
    /// # Errors
    /// A file that is there and cannot be read, that a newer carved wrote, or that was altered.
    pub fn well(&self, planned: &PlannedWell) -> Result<StoredWell, StoreError> {
        let well = &planned.well;
        let folder = self.folder.join(attempts::folder_name(well, 0));
        let files = RecordingFiles::of(&folder)?;
        let recording = json(&files, RECORDING)?;
        if recording.is_some() {
            schema::parse::<serde::de::IgnoredAny>(&files.path(RECORDING), &files.require(RECORDING)?, recording::SCHEMA)?;
        }
        let measurement = json(&files, MEASUREMENT)?;
        let (measurement, measurement_sha256) = measurement.unzip();
        Ok(StoredWell {
            planned: planned.clone(),
            status: self.record.wells.iter().find(|status| status.well == *well).cloned(),
            earlier_attempts: attempts::earlier(&self.folder, well).len(),
            recording: recording.map(|(value, _)| value),
            measurement,
            measurement_sha256,
            timings: json(&files, TIMINGS)?.map(|(value, _)| value),
            files,
        })
    }
}

impl StoredWell {
    /// The files of the recording with their SHA-256, by their names in its folder. None of a recording that was not closed.
    ///
    /// # Errors
    /// Sums that cannot be read.
    pub fn sums(&self) -> Result<Vec<(String, String)>, StoreError> {
        Ok(self.files.sums()?.unwrap_or_default())
    }
}

impl StoreReader {
    /// A run with its wells. `None` where there is none of this name.
    ///
    /// # Errors
    /// A run that cannot be read.
    pub fn stored_run(&self, id: &str) -> Result<Option<StoredRun>, StoreError> {
        let Some(record) = self.run(id)? else { return Ok(None) };
        Ok(self.run_folder(id).map(|folder| StoredRun { folder, record }))
    }
}

/// The place of the volume or the area among reference larvae, in the JSON of a `measurement.json`: that of the trusted estimator, or else
/// the paper's, with the name of the estimator. `None` without a reference.
pub fn place_among_references<'m>(measurement: &'m Value, quantity: &str) -> Option<(&'m str, &'m Value)> {
    let all = measurement.pointer("/reference/estimates")?.as_array()?;
    let of = |name: &str| all.iter().find(|e| e["estimator"] == name && e[quantity]["known"].is_object());
    let found = measurement.pointer("/measurement/estimator")?.as_str().and_then(of).or_else(|| of("voxel"))?;
    Some((found["estimator"].as_str()?, &found[quantity]["known"]))
}

/// A JSON file of a recording and the hash of its bytes. `None` where it is not there.
fn json(files: &RecordingFiles, name: &str) -> Result<Option<(Value, String)>, StoreError> {
    let Some(bytes) = files.verified(name)? else { return Ok(None) };
    let value = super::durable::parse_json(&files.path(name), &bytes, "JSON")?;
    Ok(Some((value, sha256_hex(&bytes))))
}
