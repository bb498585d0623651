//! A specimen that was let go and has no numbers yet, by a crash or a fault: its larva is gone and its frames are not, so its numbers
//! are made from them, off this thread.
//!
//! ```text
//! take_up, proceed, end_run ──► recover ──► frames ─ numbers ─ files ──► recovered ──► the well's outcome ──┬─► the next such well
//!                                 │ none                                                                  └─► finish or end_run, if
//!                                 └─► nothing to wait for                                                      they waited for it
//! ```

use super::super::worker::{self, WellTimes};
use super::super::{Phase, PlannedWell, SpecimenOutcome, WellStatus, gate, kind, numbers};
use super::Running;
use super::publish::run_status;
use crate::acquisition::LedgerEntry;
use crate::store::{RecordingReader, RecordingWriter, StoreError};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tokio::task::{JoinError, JoinHandle};

/// What is made of a well's frames, and how long it took.
pub(super) struct Recovered {
    result: WellStatus,
    times: WellTimes,
}

/// The wells whose numbers are made from their frames, one after the other.
pub(super) struct Recovery {
    /// The first is under way.
    wells: VecDeque<PlannedWell>,
    pub task: JoinHandle<Result<Recovered, StoreError>>,
}

/// What waits for the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Then {
    Finish,
    End,
}

impl Recovery {
    fn begin(wells: VecDeque<PlannedWell>, run: &Path) -> Option<Self> {
        let planned = wells.front()?.clone();
        let folder = run.join(&planned.well);
        Some(Self { wells, task: tokio::task::spawn_blocking(move || from_frames(&folder, &planned)) })
    }

    pub fn wells_left(&self) -> usize {
        self.wells.len()
    }
}

/// Numbers and files of a specimen that was accepted, as its live run would have left them.
///
/// # Errors
/// What cannot be written. Frames that give no number end the well instead.
fn from_frames(folder: &Path, planned: &PlannedWell) -> Result<Recovered, StoreError> {
    let began = Instant::now();
    let mut result = WellStatus::pending(planned);
    let mut times = WellTimes::default();
    let reader = RecordingReader::open(folder)?;
    // The run's record alone lacks them.
    if let Some(file) = reader.closed_numbers() {
        numbers::tell(&mut result, &file, reader.recording().method.asd);
        return Ok(Recovered { result, times });
    }
    let entries: Vec<&LedgerEntry> = reader.recording().ledger.counted().collect();
    let mut writer = RecordingWriter::resume(&reader);
    match numbers::of_recording(&reader, &reader.recording().method, &entries, || ()) {
        Ok((mesh, file)) => {
            numbers::keep(&mut writer, &mesh, &file)?;
            numbers::tell(&mut result, &file, reader.recording().method.asd);
        }
        Err(error) => result.end(SpecimenOutcome::Failed, Some(&error.to_string())),
    }
    times.phase(Phase::Measure, began.elapsed());
    worker::add_timings(&mut writer, &times)?;
    writer.close()?;
    Ok(Recovered { result, times })
}

impl Running {
    /// The wells without an end whose specimens were accepted: nobody is asked for these again.
    pub(super) fn accepted(&self) -> VecDeque<PlannedWell> {
        let Some(active) = &self.active else { return VecDeque::new() };
        let run: PathBuf = self.store.run_folder(&active.record.id);
        let open = active.record.plan.plate_map.iter().zip(&active.record.wells).filter(|(_, w)| w.outcome.is_none());
        let is_accepted = |planned: &PlannedWell| RecordingReader::open(&run.join(&planned.well)).is_ok_and(|r| r.is_accepted());
        open.map(|(planned, _)| planned).filter(|planned| is_accepted(planned)).cloned().collect()
    }

    /// Has their numbers made, where that is not under way. Not beside a worker, which may be at the same frames.
    pub(super) fn recover(&mut self) {
        if self.active.as_ref().is_none_or(|a| a.work.is_some() || a.recovery.is_some()) {
            return;
        }
        let wells = self.accepted();
        let lacks_gate = self.lacks_gate();
        let Some(active) = &mut self.active else { return };
        for planned in &wells {
            tracing::info!(well = %planned.well, "the numbers of a specimen that was let go are made from its frames");
        }
        active.lacks_gate = lacks_gate;
        active.recovery = Recovery::begin(wells, &self.store.run_folder(&active.record.id));
    }

    /// Whether `then` has to wait for numbers that are being made; it is done once they are there.
    pub(super) fn waits_for_numbers(&mut self, then: Then) -> bool {
        let Some(active) = self.active.as_mut().filter(|a| a.recovery.is_some()) else { return false };
        active.then = Some(then);
        true
    }

    pub(super) fn recovered(&mut self, ended: Result<Result<Recovered, StoreError>, JoinError>) {
        let Some(active) = &mut self.active else { return };
        let Some(mut recovery) = active.recovery.take() else { return };
        let Some(planned) = recovery.wells.pop_front() else { return };
        let found = ended.unwrap_or_else(|panicked| {
            let mut result = WellStatus::pending(&planned);
            let why = format!("its numbers could not be made from its frames ({panicked}); the log has more. `carved measure` tries again");
            result.end(SpecimenOutcome::Failed, Some(&why));
            Ok(Recovered { result, times: WellTimes::default() })
        });
        match found {
            Ok(found) => {
                active.recovery = Recovery::begin(recovery.wells, &self.store.run_folder(&active.record.id));
                self.well_recovered(found);
                if self.active.as_ref().is_some_and(|a| a.recovery.is_none()) {
                    self.go_on();
                }
            }
            // As where a live run cannot write them: it is held, and they are made when it goes on.
            Err(error) => {
                self.keep(Err(error));
                match self.active.as_mut().and_then(|a| a.then.take()) {
                    Some(Then::Finish) => self.rest(true),
                    Some(Then::End) => self.end_now(),
                    None => {}
                }
            }
        }
    }

    /// What has waited for the numbers is done.
    fn go_on(&mut self) {
        match self.active.as_mut().and_then(|a| a.then.take()) {
            Some(Then::Finish) => self.close(),
            Some(Then::End) => self.end_now(),
            None => {}
        }
    }

    fn well_recovered(&mut self, Recovered { mut result, times }: Recovered) {
        let Some(active) = &mut self.active else { return };
        gate::flag(&mut result, active.lacks_gate);
        if let Some(slot) = active.record.wells.iter_mut().find(|w| w.well == result.well) {
            slot.clone_from(&result);
        }
        active.resumed_by_itself = 0;
        let record = active.record.clone();
        let status = run_status(&record);
        self.save(record);
        self.publish(|s| s.run = Some(status));
        self.event(kind::SPECIMEN_RECOVERED, Some(&result.well), serde_json::Value::Null);
        let mut data = serde_json::to_value(&result).unwrap_or_default();
        data["times"] = serde_json::to_value(&times).unwrap_or_default();
        self.event(kind::SPECIMEN_DONE, Some(&result.well), data);
    }
}
