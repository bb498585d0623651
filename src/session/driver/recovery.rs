//! A specimen that was let go and has no numbers yet, by a crash or a fault: its larva is gone and its frames are not, so its numbers
//! are made from them, off this thread.
//!
//! ```text
//! take_up, proceed, end_run ──► recover ──► frames ─ numbers ─ files ──► recovered ──► the well's outcome ──┬─► the next such well
//!                                 │ none       │                                                          └─► finish or end_run, if
//!                                 │            └─ too long, or for the fourth time: failed                     they waited for it
//!                                 └─► nothing to wait for
//! ```
//! Each attempt is journalled before it is made, where the disk takes it: one on which the daemon dies each time must not be made for ever.

use super::super::worker::{self, Overrun};
use super::super::{gate, numbers};
use super::Running;
use super::publish::run_status;
use carved_core::surface::Mesh;
use carved_records::{EventData, LedgerEntry, Phase, PlannedWell, RecoveryBegun, SpecimenDone, SpecimenOutcome, WellStatus, WellTimes};
use carved_store::{MeasurementFile, RecordingReader, RecordingWriter, StoreError};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::{Instant, timeout_at};

/// Attempts at the numbers of one specimen; who has died of so many is not tried once more.
const ATTEMPTS: u32 = 3;

/// What is made of a well's frames, and how long it took.
pub(super) struct Recovered {
    result: WellStatus,
    times: WellTimes,
}

/// How the making of a well's numbers has ended.
pub(super) enum Made {
    Done(Box<Result<Recovered, StoreError>>),
    Overran(Overrun),
    Panicked,
}

/// The wells whose numbers are made from their frames, one after the other.
pub(super) struct Recovery {
    /// The first is under way.
    wells: VecDeque<PlannedWell>,
    run: PathBuf,
    done: oneshot::Receiver<Result<Recovered, StoreError>>,
    /// Taken once: by the thread that has numbers to keep, or by who does not wait for them any more.
    decided: Arc<AtomicBool>,
    until: Instant,
    allowed: Duration,
}

/// What waits for the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Continuation {
    Finish,
    End,
}

impl Recovery {
    /// On a thread of its own: one that is given up is left to itself, and nothing waits for it.
    fn begin(wells: VecDeque<PlannedWell>, run: &Path, allowed: Duration) -> Option<Self> {
        let planned = wells.front()?.clone();
        let folder = run.join(&planned.well);
        let (tell, done) = oneshot::channel();
        let recovery = Self::awaited(wells, run, done, allowed);
        let decided = Arc::clone(&recovery.decided);
        let spawned = std::thread::Builder::new().name("numbers".into()).spawn(move || {
            let found = StoredNumbers::of_frames(&folder, &planned);
            if !decided.swap(true, Ordering::AcqRel) {
                // The driver is gone with the daemon.
                let _nobody = tell.send(found.and_then(StoredNumbers::keep));
            }
        });
        // Its end of the channel is gone with it, as if it had panicked.
        if let Err(error) = spawned {
            tracing::error!(%error, "no thread for the numbers of a specimen");
        }
        Some(recovery)
    }

    pub fn awaited(
        wells: VecDeque<PlannedWell>,
        run: &Path,
        done: oneshot::Receiver<Result<Recovered, StoreError>>,
        allowed: Duration,
    ) -> Self {
        Self { wells, run: run.to_owned(), done, decided: Arc::default(), until: Instant::now() + allowed, allowed }
    }

    /// The wells whose numbers are not there yet.
    pub fn wells(&self) -> impl Iterator<Item = &str> {
        self.wells.iter().map(|planned| planned.well.as_str())
    }

    /// Waits for the numbers, as long as they may take; may be asked again where it was given up half way.
    pub async fn made(&mut self) -> Made {
        let ended = |done: Result<_, _>| done.map_or(Made::Panicked, |made| Made::Done(Box::new(made)));
        if let Ok(done) = timeout_at(self.until, &mut self.done).await {
            return ended(done);
        }
        if !self.decided.swap(true, Ordering::AcqRel) {
            return Made::Overran(Overrun::new(Phase::Measure, self.allowed, self.allowed));
        }
        // They are there, and being written.
        if let Ok(done) = timeout_at(self.until + worker::CLOSING, &mut self.done).await {
            return ended(done);
        }
        let path = self.wells.front().map_or_else(|| self.run.clone(), |planned| self.run.join(&planned.well));
        Made::Done(Box::new(Err(StoreError::Unclosed { path, waited_s: worker::CLOSING.as_secs_f64() })))
    }
}

/// What the frames of a specimen say, before any of it is written.
struct StoredNumbers {
    result: WellStatus,
    reader: RecordingReader,
    numbers: Option<Box<(Mesh, MeasurementFile)>>,
    times: WellTimes,
    /// Its record was closed: the run's alone lacks it.
    closed: bool,
}

impl StoredNumbers {
    /// Numbers of a specimen that was accepted, as its live run would have made them.
    ///
    /// # Errors
    /// No record that can be read. Frames that give no number end the well instead.
    fn of_frames(folder: &Path, planned: &PlannedWell) -> Result<Self, StoreError> {
        let began = std::time::Instant::now();
        let reader = RecordingReader::open(folder)?;
        let mut found = Self { result: WellStatus::pending(planned), numbers: None, times: WellTimes::default(), closed: false, reader };
        let asd = found.reader.recording().method.asd;
        if let Some(file) = found.reader.closed_numbers() {
            numbers::tell(&mut found.result, &file, asd);
            return Ok(Self { closed: true, ..found });
        }
        let entries: Vec<&LedgerEntry> = found.reader.recording().ledger.counted().collect();
        match numbers::of_recording(&found.reader, &found.reader.recording().method, &entries, || ()) {
            Ok(made) => {
                numbers::tell(&mut found.result, &made.1, asd);
                found.numbers = Some(Box::new(made));
            }
            Err(error) => found.result.end(SpecimenOutcome::Failed, Some(&error.to_string())),
        }
        found.times.phase(Phase::Measure, began.elapsed());
        Ok(found)
    }

    /// The files that its live run would have left.
    ///
    /// # Errors
    /// What cannot be written.
    fn keep(self) -> Result<Recovered, StoreError> {
        let Self { result, reader, numbers: made, times, closed } = self;
        if !closed {
            let mut writer = RecordingWriter::resume(&reader);
            if let Some((mesh, file)) = made.as_deref() {
                numbers::keep(&mut writer, mesh, file)?;
            }
            worker::add_timings(&mut writer, &times)?;
            writer.close()?;
        }
        Ok(Recovered { result, times })
    }
}

/// The end of a well whose numbers are not made any more, with what a person can do about it.
fn without_numbers(run: &Path, planned: &PlannedWell, why: &str) -> Recovered {
    let mut result = WellStatus::pending(planned);
    let why = format!("{why}. Its frames are kept; to measure them by hand: carved measure {}", run.join(&planned.well).display());
    result.end(SpecimenOutcome::Failed, Some(&why));
    Recovered { result, times: WellTimes::default() }
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
        active.lacks_gate = lacks_gate;
        self.recover_next(wells);
    }

    /// Begins with the first of them that was not tried too often; the others fail.
    fn recover_next(&mut self, mut wells: VecDeque<PlannedWell>) {
        while let Some(planned) = wells.front() {
            let well = planned.well.clone();
            let Some(active) = &self.active else { return };
            let tried = self.state().run.as_ref().map_or(0, |run| run.recoveries_of(&well));
            if tried >= ATTEMPTS {
                let why = format!("the daemon has ended in each of {ATTEMPTS} attempts to make its numbers from its frames");
                let failed = without_numbers(&self.store.run_folder(&active.record.id), planned, &why);
                wells.pop_front();
                self.well_recovered(failed);
                continue;
            }
            let attempt = tried + 1;
            let allowed = active.record.method.policy.deadlines_s.of(Phase::Measure);
            tracing::info!(well, attempt, "the numbers of a specimen that was let go are made from its frames");
            // Of an end that was asked for nobody dies, however short the time that is left.
            if !self.stopping {
                self.event(Some(&well), EventData::SpecimenRecovering(RecoveryBegun { attempt }));
            }
            let Some(active) = &mut self.active else { return };
            active.recovery = Recovery::begin(wells, &self.store.run_folder(&active.record.id), allowed);
            return;
        }
    }

    /// Whether `then` has to wait for numbers that are being made; it is done once they are there.
    pub(super) fn waits_for_numbers(&mut self, then: Continuation) -> bool {
        let Some(active) = self.active.as_mut().filter(|a| a.recovery.is_some()) else { return false };
        active.continuation = Some(then);
        true
    }

    pub(super) fn recovered(&mut self, made: Made) {
        let Some(active) = &mut self.active else { return };
        let Some(mut recovery) = active.recovery.take() else { return };
        let Some(planned) = recovery.wells.pop_front() else { return };
        let found = match made {
            Made::Done(found) => *found,
            Made::Overran(overrun) => Ok(without_numbers(&recovery.run, &planned, &overrun.to_string())),
            Made::Panicked => {
                Ok(without_numbers(&recovery.run, &planned, "its numbers could not be made from its frames; the log has more"))
            }
        };
        match found {
            Ok(found) => {
                self.well_recovered(found);
                self.recover_next(recovery.wells);
                if self.active.as_ref().is_some_and(|a| a.recovery.is_none()) {
                    self.go_on();
                }
            }
            // As where a live run cannot write them: it is held, and they are made when it goes on.
            Err(error) => {
                self.keep(Err(error));
                match self.active.as_mut().and_then(|a| a.continuation.take()) {
                    Some(Continuation::Finish) => self.rest(true),
                    Some(Continuation::End) => self.end_now(),
                    None => {}
                }
            }
        }
    }

    /// What has waited for the numbers is done.
    fn go_on(&mut self) {
        match self.active.as_mut().and_then(|a| a.continuation.take()) {
            Some(Continuation::Finish) => self.close(),
            Some(Continuation::End) => self.end_now(),
            None => {}
        }
    }

    fn well_recovered(&mut self, Recovered { mut result, times }: Recovered) {
        let Some(active) = &mut self.active else { return };
        gate::flag(&mut result, active.lacks_gate);
        if let Some(slot) = active.record.wells.iter_mut().find(|w| w.well == result.well) {
            slot.clone_from(&result);
        }
        let record = active.record.clone();
        // Closed already where it has numbers.
        self.seal_well(&record.id, &result.well);
        let status = run_status(&record);
        self.save(record);
        let well = result.well.clone();
        self.event(Some(&well), EventData::SpecimenRecovered);
        let done = SpecimenDone { result, times: Some(times), seconds: None };
        self.event_shown(Some(&well), EventData::SpecimenDone(Box::new(done)), |d| d.publish(|s| s.run = Some(status)));
    }
}
