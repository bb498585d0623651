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

use super::super::numbers;
use super::super::worker::{self, Overrun};
use carved_core::surface::Mesh;
use carved_records::LedgerEntry;
use carved_records::{Phase, PlannedWell, SpecimenOutcome, WellStatus, WellTimes};
use carved_store::{MeasurementFile, RecordingReader, RecordingWriter, RunRecord, StoreError};
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
    pub result: WellStatus,
    pub times: WellTimes,
}

/// How the making of a well's numbers has ended.
pub(super) enum Made {
    Done(Box<Result<Recovered, StoreError>>),
    Overran(Overrun),
    Panicked,
}

/// Numbers that are made from the frames of specimens that are gone, and what waits for them.
#[derive(Default)]
pub(super) struct Numbers {
    making: Option<Recovery>,
    continuation: Option<Continuation>,
}

/// What is done about a well without numbers.
pub(super) enum Attempt {
    /// They are made; the attempt, from 1.
    Begin(u32),
    /// It was tried too often. The well ends so.
    GiveUp(Box<Recovered>),
}

/// The next attempt at the numbers of a well of the run in this folder. `tried`: attempts that the daemon did not survive.
pub(super) fn attempt(run: &Path, planned: &PlannedWell, tried: u32) -> Attempt {
    if tried < ATTEMPTS {
        return Attempt::Begin(tried + 1);
    }
    let why = format!("the daemon has ended in each of {ATTEMPTS} attempts to make its numbers from its frames");
    Attempt::GiveUp(Box::new(without_numbers(run, planned, &why)))
}

/// The wells without outcome whose specimens were accepted. Nobody is asked for these specimens again. `run`: the run's folder.
pub(super) fn accepted(run: &Path, record: &RunRecord) -> VecDeque<PlannedWell> {
    let open = record.plan.plate_map.iter().zip(&record.wells).filter(|(_, w)| w.outcome.is_none());
    let is_accepted = |planned: &PlannedWell| RecordingReader::open(&run.join(&planned.well)).is_ok_and(|r| r.is_accepted());
    open.map(|(planned, _)| planned).filter(|planned| is_accepted(planned)).cloned().collect()
}

impl Numbers {
    /// Whether the numbers of any well are being made.
    pub fn are_being_made(&self) -> bool {
        self.making.is_some()
    }

    /// Begins with the first of `wells`. `run`: the run's folder.
    pub fn begin(&mut self, wells: VecDeque<PlannedWell>, run: &Path, allowed: Duration) {
        self.making = Recovery::begin(wells, run, allowed);
    }

    /// The wells whose numbers are not there yet.
    pub fn wells(&self) -> impl Iterator<Item = &str> {
        self.making.iter().flat_map(|recovery| &recovery.wells).map(|planned| planned.well.as_str())
    }

    /// Whether `then` has to wait for numbers; it is done once they are there.
    pub fn delay(&mut self, then: Continuation) -> bool {
        if self.making.is_some() {
            self.continuation = Some(then);
        }
        self.making.is_some()
    }

    /// What has waited for the numbers, and does not any more.
    pub fn take_continuation(&mut self) -> Option<Continuation> {
        self.continuation.take()
    }

    /// Nothing waits for the numbers.
    pub fn forget_continuation(&mut self) {
        self.continuation = None;
    }

    /// The end of the well that is under way; never, where none is. It may be asked again where it was given up half way.
    pub async fn made(&mut self) -> Made {
        match &mut self.making {
            Some(recovery) => recovery.made().await,
            None => std::future::pending().await,
        }
    }

    /// Takes what has become of the well under way, and the wells behind it; `None` where nothing is under way.
    pub fn take(&mut self, made: Made) -> Option<(Result<Recovered, StoreError>, VecDeque<PlannedWell>)> {
        let Recovery { mut wells, run, .. } = self.making.take()?;
        let planned = wells.pop_front()?;
        let found = match made {
            Made::Done(found) => *found,
            Made::Overran(overrun) => Ok(without_numbers(&run, &planned, &overrun.to_string())),
            Made::Panicked => Ok(without_numbers(&run, &planned, "its numbers could not be made from its frames; the log has more")),
        };
        Some((found, wells))
    }

    #[cfg(test)]
    pub fn awaited(making: Recovery, then: Continuation) -> Self {
        Self { making: Some(making), continuation: Some(then) }
    }
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

    /// Waits for the numbers, as long as they may take.
    async fn made(&mut self) -> Made {
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
        match numbers::of_recording(&found.reader, &found.reader.recording().method, &entries, |_, _| ()) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_well_on_which_the_daemon_ended_three_times_is_given_up() {
        let planned = PlannedWell::new("A01", carved_records::SpecimenKind::Larva, None);
        let next = |tried| attempt(Path::new("/data/runs/r1"), &planned, tried);
        assert!(matches!(next(0), Attempt::Begin(1)) && matches!(next(2), Attempt::Begin(3)));
        let Attempt::GiveUp(given_up) = next(3) else { panic!("it is tried for ever") };
        assert!(given_up.result.outcome == Some(SpecimenOutcome::Failed), "{:?}", given_up.result);
        assert!(given_up.result.reason.unwrap().contains("carved measure /data/runs/r1/A01"));
    }

    #[test]
    fn nothing_waits_for_numbers_that_nobody_makes() {
        let mut numbers = Numbers::default();
        assert!(!numbers.delay(Continuation::Finish) && numbers.take_continuation().is_none());
        assert!(numbers.take(Made::Panicked).is_none());
    }
}
