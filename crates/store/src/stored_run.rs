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

use super::RECORDING;
use super::recording::MEASUREMENT;
use super::replay::Replayed;
use super::{RecordingFiles, RunRecord, StoreError, StoreReader, attempts, recording, schema};
use carved_core::flag::StoredFlag;
use carved_core::inside::SwimBladder;
use carved_core::measure::references::NotCompared;
use carved_records::{PlannedWell, WellStatus, sha256_hex};
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Name of the file with a specimen's times.
pub(super) const TIMINGS: &str = "timings.json";

/// A run and where it is.
#[derive(Debug)]
pub struct StoredRun {
    folder: PathBuf,
    record: RunRecord,
    /// Folder with the numbers of a later computation, as `RUN/WELL`.
    measurements: Option<PathBuf>,
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
    /// The computation that the numbers are from.
    pub computation: Computation,
}

/// The computation that the numbers of a well are from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Computation {
    /// The one of the run.
    OfRun,
    /// A later one, by the method of this name. `None`: by the method of the recording.
    Later { method_name: Option<String> },
    /// None: the run has numbers of this well, the folder of the later computation has not.
    Missing,
    /// None: a file of the well was altered or cannot be read, for this reason.
    Unreadable(String),
}

impl Computation {
    /// Whether the well may have numbers, which are not here.
    pub fn is_left_out(&self) -> bool {
        matches!(self, Self::Missing | Self::Unreadable(_))
    }
}

impl StoredRun {
    /// Reads the run of a folder, which may be a copy.
    ///
    /// # Errors
    /// No run, or one that cannot be read.
    pub fn read(folder: &Path) -> Result<Self, StoreError> {
        Ok(Self { folder: folder.to_owned(), record: RunRecord::of_folder(folder)?, measurements: None })
    }

    /// The same run with the numbers of a later computation, which are in `folder` as `RUN/WELL`, in place of its own. `RUN` is the name
    /// of the run's folder.
    ///
    /// # Errors
    /// The run's folder cannot be found.
    pub fn with_measurements(self, folder: &Path) -> Result<Self, StoreError> {
        let whole = self.folder.canonicalize().map_err(StoreError::io("find", &self.folder))?;
        Ok(Self { measurements: Some(folder.join(whole.file_name().unwrap_or_default())), ..self })
    }

    /// `run.json`.
    pub fn record(&self) -> &RunRecord {
        &self.record
    }

    /// The run's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The planned wells in the order of the plan. A well with a file that was altered or cannot be read has no numbers, and says why, so that the
    /// others can be given.
    pub fn wells(&self) -> impl Iterator<Item = StoredWell> {
        self.record.plan.plate_map.iter().map(|planned| self.readable_well(planned))
    }

    /// A planned well as [`Self::wells`] gives it.
    pub fn readable_well(&self, planned: &PlannedWell) -> StoredWell {
        self.well(planned).unwrap_or_else(|error| {
            let folder = self.folder.join(attempts::folder_name(&planned.well, 0));
            let mut status = self.record.wells.iter().find(|status| status.well == planned.well).cloned();
            if let Some(status) = &mut status {
                status.flags.clear();
            }
            StoredWell {
                planned: planned.clone(),
                status,
                earlier_attempts: attempts::earlier(&self.folder, &planned.well).len(),
                files: RecordingFiles::Folder(folder),
                recording: None,
                measurement: None,
                measurement_sha256: None,
                timings: None,
                computation: Computation::Unreadable(error.to_string()),
            }
        })
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
        let (measurement, measurement_sha256) = json(&files, MEASUREMENT)?.unzip();
        let mut well = StoredWell {
            planned: planned.clone(),
            status: self.record.wells.iter().find(|status| status.well == *well).cloned(),
            earlier_attempts: attempts::earlier(&self.folder, well).len(),
            recording: recording.map(|(value, _)| value),
            measurement,
            measurement_sha256,
            timings: json(&files, TIMINGS)?.map(|(value, _)| value),
            computation: Computation::OfRun,
            files,
        };
        if let Some(measurements) = &self.measurements {
            well = well.measured_again(&measurements.join(attempts::folder_name(&planned.well, 0)))?;
        }
        Ok(well.without_claims_on_unseen_parts())
    }
}

impl StoredWell {
    /// The numbers of a later computation, with its method and its software. Where it has none, nothing of the run's computation is left.
    fn measured_again(self, folder: &Path) -> Result<Self, StoreError> {
        let Some(found) = Replayed::read(folder)? else {
            return Ok(if self.measurement.is_some() { self.without_computation() } else { self });
        };
        let before = flags(self.measurement.as_ref());
        let path = folder.join(MEASUREMENT);
        let format = |e: serde_json::Error| StoreError::Format { path: path.clone(), expected: "JSON", found: e.to_string() };
        let mut recording = self.recording;
        if let Some(recording) = recording.as_mut().and_then(Value::as_object_mut) {
            recording.insert("method".into(), serde_json::to_value(&found.method).map_err(format)?);
            recording.insert("software".into(), serde_json::to_value(&found.software).map_err(format)?);
        }
        let measurement: Value = serde_json::from_slice(&found.measurement).map_err(format)?;
        // The run adds flags of its own, as `bead_gate`.
        let status = self.status.map(|mut status| {
            let of_run = status.flags.into_iter().filter(|flag| !before.contains(flag));
            status.flags = flags(Some(&measurement)).into_iter().chain(of_run).collect();
            status
        });
        Ok(Self {
            status,
            recording,
            measurement: Some(measurement),
            measurement_sha256: Some(sha256_hex(&found.measurement)),
            computation: Computation::Later { method_name: found.method_name },
            ..self
        })
    }

    /// The same without what earlier builds said of a larva of which a part was not measured.
    #[must_use]
    pub(super) fn without_claims_on_unseen_parts(mut self) -> Self {
        let of_well = self.status.as_ref().is_some_and(|status| StoredFlag::is_bound(&status.flags));
        if let Some(measurement) = &mut self.measurement {
            remove_claims_on_unseen_parts(measurement, of_well);
        }
        self
    }

    fn without_computation(mut self) -> Self {
        if let Some(recording) = self.recording.as_mut().and_then(Value::as_object_mut) {
            recording.retain(|key, _| !matches!(key.as_str(), "method" | "software"));
        }
        if let Some(status) = &mut self.status {
            status.flags.clear();
        }
        Self { measurement: None, measurement_sha256: None, computation: Computation::Missing, ..self }
    }
}

impl StoreReader {
    /// A run with its wells. `None` where there is none of this name.
    ///
    /// # Errors
    /// A run that cannot be read.
    pub fn stored_run(&self, id: &str) -> Result<Option<StoredRun>, StoreError> {
        let Some(record) = self.run(id)? else { return Ok(None) };
        Ok(self.run_folder(id).map(|folder| StoredRun { folder, record, measurements: None }))
    }
}

/// The place of a quantity among reference larvae, in the JSON of a `measurement.json`, with the name of the estimator. Of `volume` and `area`
/// that of the trusted estimator, or else the paper's; `eye_volume` and `eye_distance` are of the eyes. `None` without a reference.
pub fn place_among_references<'m>(measurement: &'m Value, quantity: &str) -> Option<(&'m str, &'m Value)> {
    if let Some(of_eyes) = quantity.strip_prefix("eye_") {
        let place = measurement.pointer("/reference/eyes")?.get(of_eyes)?.get("known")?;
        return Some(("eyes", place));
    }
    let all = measurement.pointer("/reference/estimates")?.as_array()?;
    let of = |name: &str| all.iter().find(|e| e["estimator"] == name && e[quantity]["known"].is_object());
    let found = measurement.pointer("/measurement/estimator")?.as_str().and_then(of).or_else(|| of("voxel"))?;
    Some((found["estimator"].as_str()?, &found[quantity]["known"]))
}

/// Builds before this one compared a larva of which a part was not measured with whole ones, and called it one without gas where the part that
/// was measured has none. Takes both out of such a `measurement.json`. `is_bound`: the flags of the well say that a part was not measured.
pub(super) fn remove_claims_on_unseen_parts(measurement: &mut Value, is_bound: bool) {
    if !is_bound && !StoredFlag::is_bound(&flags(Some(measurement))) {
        return;
    }
    if let Some(reference) = measurement.get_mut("reference").filter(|stored| stored.is_object() && stored.get("not_compared").is_none()) {
        *reference = json!({ "dpf": reference["dpf"], "not_compared": NotCompared::PartUnseen, "estimates": [] });
    }
    if let Some(bladder) = measurement.get_mut("bladder").and_then(|stored| SwimBladder::deserialize(&*stored).ok())
        && let Ok(known) = serde_json::to_value(bladder.of_a_part())
    {
        measurement["bladder"] = known;
    }
}

/// The flags of a `measurement.json`.
fn flags(measurement: Option<&Value>) -> Vec<StoredFlag> {
    let list = measurement.and_then(|m| m["flags"].as_array());
    list.into_iter().flatten().filter_map(|flag| StoredFlag::deserialize(flag).ok()).collect()
}

/// A JSON file of a recording and the hash of its bytes. `None` where it is not there.
fn json(files: &RecordingFiles, name: &str) -> Result<Option<(Value, String)>, StoreError> {
    let Some(bytes) = files.verified(name)? else { return Ok(None) };
    let value = super::durable::parse_json(&files.path(name), &bytes, "JSON")?;
    Ok(Some((value, sha256_hex(&bytes))))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As builds before this one wrote it of a larva whose head is outside the picture.
    #[test]
    fn what_was_said_of_a_larva_of_which_a_part_was_not_measured_is_not_read() {
        let bladder = json!({ "state": "not_inflated", "probability": 0.01, "reason": "no_gas", "lobes": [] });
        let standing = json!({ "dpf": 4.0, "estimates": [{ "estimator": "voxel", "volume": { "known": { "z": -9.0 } } }] });
        let stored =
            |flags: Value| json!({ "measurement": { "estimator": "voxel" }, "reference": standing, "bladder": bladder, "flags": flags });
        let place = |numbers: &Value| place_among_references(numbers, "volume").map(|(_, place)| place["z"].clone());
        for (flags, is_bound) in [(json!(["clipped_left"]), false), (json!(["outside_box", "moved"]), false), (json!([]), true)] {
            let mut numbers = stored(flags);
            assert_eq!(place(&numbers), Some(json!(-9.0)));
            remove_claims_on_unseen_parts(&mut numbers, is_bound);
            assert_eq!((place(&numbers), &numbers["reference"]["not_compared"]), (None, &json!("part_unseen")));
            let found = &numbers["bladder"];
            assert_eq!(
                (&found["state"], &found["reason"], &found["probability"]),
                (&json!("undecided"), &json!("part_unseen"), &Value::Null)
            );
        }
        // A whole larva, and one that was not compared.
        let mut whole = stored(json!(["moved"]));
        remove_claims_on_unseen_parts(&mut whole, false);
        assert_eq!(whole, stored(json!(["moved"])));
        let mut bead = json!({ "flags": ["clipped_left"], "bladder": null });
        remove_claims_on_unseen_parts(&mut bead, false);
        assert_eq!(bead, json!({ "flags": ["clipped_left"], "bladder": null }));
    }
}
