//! The recordings of specimens that were accepted and released, and whose numbers are not in the run's record: which wells have one, and
//! their numbers, computed from the frames and written as in a live run. The larva has left the capillary.
//!
//! ```text
//! accepted ──► wells ──► StoredNumbers::of_frames ──► keep ──► measurement.json, mesh, SHA256SUMS ──► Recovered
//!                         (reads the recording)       (writes, unless the recording was closed before the crash)
//! ```

use super::super::{numbers, worker};
use carved_core::surface::Mesh;
use carved_offline::recording::{Computed, compute};
use carved_records::{LedgerEntry, Phase, PlannedWell, SpecimenOutcome, WellStatus, WellTimes};
use carved_store::{MeasurementFile, RecordingReader, RecordingWriter, RunRecord, StoreError};
use std::collections::VecDeque;
use std::path::Path;

/// The result of a well, computed from its frames, and the time that this took.
pub(super) struct Recovered {
    pub result: WellStatus,
    pub times: WellTimes,
}

/// The wells without outcome whose specimens were accepted. These specimens are not requested again. `run`: the run's folder.
pub(super) fn accepted(run: &Path, record: &RunRecord) -> VecDeque<PlannedWell> {
    let open = record.plan.plate_map.iter().zip(&record.wells).filter(|(_, w)| w.outcome.is_none());
    let is_accepted = |planned: &PlannedWell| RecordingReader::open(&run.join(&planned.well)).is_ok_and(|r| r.is_accepted());
    open.map(|(planned, _)| planned).filter(|planned| is_accepted(planned)).cloned().collect()
}

/// The result of a specimen, computed from its frames, before anything is written.
pub(super) struct StoredNumbers {
    result: WellStatus,
    reader: RecordingReader,
    numbers: Option<Box<(Mesh, MeasurementFile)>>,
    times: WellTimes,
    /// The recording was closed before the crash. Only the run's record lacks its numbers.
    closed: bool,
}

impl StoredNumbers {
    /// Computes the numbers of an accepted specimen in the same way as a live run.
    ///
    /// # Errors
    /// The recording cannot be read. If the frames give no number, the well fails and this returns `Ok`.
    pub fn of_frames(folder: &Path, planned: &PlannedWell) -> Result<Self, StoreError> {
        let began = std::time::Instant::now();
        let reader = RecordingReader::open(folder)?;
        let mut found = Self { result: WellStatus::pending(planned), numbers: None, times: WellTimes::default(), closed: false, reader };
        let asd = found.reader.recording().method.asd;
        if let Some(file) = found.reader.closed_numbers() {
            numbers::end_well(&mut found.result, &file, asd);
            return Ok(Self { closed: true, ..found });
        }
        let entries: Vec<&LedgerEntry> = found.reader.recording().ledger.counted().collect();
        match compute(&found.reader, &found.reader.recording().method, &entries, |_, _| Ok(())) {
            Ok(Computed { mesh, file, .. }) => {
                numbers::end_well(&mut found.result, &file, asd);
                found.numbers = Some(Box::new((mesh, file)));
            }
            Err(error) => found.result.end(SpecimenOutcome::Failed, Some(&error.to_string())),
        }
        found.times.phase(Phase::Measure, began.elapsed());
        Ok(found)
    }

    /// Writes the files that a live run writes.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn keep(self) -> Result<Recovered, StoreError> {
        let Self { result, reader, numbers: made, times, closed } = self;
        if !closed {
            let mut writer = RecordingWriter::resume(&reader);
            if let Some((mesh, file)) = made.as_deref() {
                numbers::write(&mut writer, mesh, file)?;
            }
            worker::add_timings(&mut writer, &times)?;
            writer.close()?;
        }
        Ok(Recovered { result, times })
    }
}
