//! Computes the numbers of specimens that were accepted and released, but whose numbers are missing after a crash or a fault. A background
//! thread computes them from the frames on disk ([`StoredNumbers`]), with a time limit and a limited number of attempts.
//!
//! ```text
//! take_up, proceed, end_run ──► recover ──► frames ─ numbers ─ files ──► recovered ──► the well's outcome ──┬─► the next such well
//!                                 │ none       │                                                          └─► finish or end_run, if
//!                                 │            └─ too slow, or 2 attempts failed: the well fails                one of them waits
//!                                 └─► nothing to wait for
//! ```
//! Each attempt is written to the journal before it begins, if the disk accepts it. This limits the number of attempts if the daemon
//! crashes in each of them.

use super::super::worker::{self, Overrun};
use super::released::{Recovered, StoredNumbers};
use carved_records::{Phase, PlannedWell, SpecimenOutcome, WellStatus, WellTimes};
use carved_store::StoreError;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::{Instant, timeout_at};

/// Maximum number of attempts for one specimen. The daemon crashed in each of them.
const ATTEMPTS: u32 = 2;

/// How the computation of a well's numbers ended.
pub(super) enum Made {
    Done(Box<Result<Recovered, StoreError>>),
    Overran(Overrun),
    Panicked,
}

/// The computation in progress, and the step that waits for it.
#[derive(Default)]
pub(super) struct Numbers {
    making: Option<Recovery>,
    continuation: Option<Continuation>,
}

/// What happens to a well without numbers.
pub(super) enum Attempt {
    /// The numbers are computed. The value is the number of the attempt, from 1.
    Begin(u32),
    /// There were too many attempts. The well fails.
    GiveUp(Box<Recovered>),
}

/// The next attempt for a well. `run`: the run's folder. `tried`: attempts in which the daemon crashed.
pub(super) fn attempt(run: &Path, planned: &PlannedWell, tried: u32) -> Attempt {
    if tried < ATTEMPTS {
        return Attempt::Begin(tried + 1);
    }
    let why = format!("the daemon has ended in each of {ATTEMPTS} attempts to make its numbers from its frames");
    Attempt::GiveUp(Box::new(without_numbers(run, planned, &why)))
}

impl Numbers {
    /// Whether a computation is in progress.
    pub fn are_being_made(&self) -> bool {
        self.making.is_some()
    }

    /// Begins with the first of `wells`. `run`: the run's folder. `allowed`: the time limit for each well.
    pub fn begin(&mut self, wells: VecDeque<PlannedWell>, run: &Path, allowed: Duration) {
        self.making = Recovery::begin(wells, run, allowed);
    }

    /// The wells whose numbers are missing.
    pub fn wells(&self) -> impl Iterator<Item = &str> {
        self.making.iter().flat_map(|recovery| &recovery.wells).map(|planned| planned.well.as_str())
    }

    /// Whether `then` must wait for numbers. If so, `then` is kept as the continuation.
    pub fn delay(&mut self, then: Continuation) -> bool {
        if self.making.is_some() {
            self.continuation = Some(then);
        }
        self.making.is_some()
    }

    /// Takes the step that waited for the numbers.
    pub fn take_continuation(&mut self) -> Option<Continuation> {
        self.continuation.take()
    }

    /// Drops the step that waits for the numbers.
    pub fn forget_continuation(&mut self) {
        self.continuation = None;
    }

    /// Waits for the current well. Pending forever if no computation is in progress. Cancel-safe: after a drop, call it again.
    pub async fn made(&mut self) -> Made {
        match &mut self.making {
            Some(recovery) => recovery.made().await,
            None => std::future::pending().await,
        }
    }

    /// Takes the result of the current well, and the wells behind it. `None` if no computation is in progress.
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

/// The wells whose numbers are computed from their frames, one after the other.
pub(super) struct Recovery {
    /// The first one is in progress.
    wells: VecDeque<PlannedWell>,
    run: PathBuf,
    done: oneshot::Receiver<Result<Recovered, StoreError>>,
    /// Set once, by the thread that writes the numbers or by the driver that gives up waiting.
    decided: Arc<AtomicBool>,
    until: Instant,
    allowed: Duration,
}

/// The step that waits for the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Continuation {
    Finish,
    End,
}

impl Recovery {
    /// Starts a thread for the first well. After a timeout the thread is detached, and its result is dropped.
    fn begin(wells: VecDeque<PlannedWell>, run: &Path, allowed: Duration) -> Option<Self> {
        let planned = wells.front()?.clone();
        let folder = run.join(&planned.well);
        let (tell, done) = oneshot::channel();
        let recovery = Self::awaited(wells, run, done, allowed);
        let decided = Arc::clone(&recovery.decided);
        let spawned = std::thread::Builder::new().name("numbers".into()).spawn(move || {
            let found = StoredNumbers::of_frames(&folder, &planned);
            if !decided.swap(true, Ordering::AcqRel) {
                // The receiver is dropped when the daemon ends.
                let _nobody = tell.send(found.and_then(StoredNumbers::keep));
            }
        });
        // The sender is dropped with the closure. The driver handles this like a panic of the thread.
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

    /// Waits for the numbers until the deadline.
    async fn made(&mut self) -> Made {
        let ended = |done: Result<_, _>| done.map_or(Made::Panicked, |made| Made::Done(Box::new(made)));
        if let Ok(done) = timeout_at(self.until, &mut self.done).await {
            return ended(done);
        }
        if !self.decided.swap(true, Ordering::AcqRel) {
            return Made::Overran(Overrun::new(Phase::Measure, self.allowed, self.allowed));
        }
        // The thread is writing the numbers. Wait for the end of this write.
        if let Ok(done) = timeout_at(self.until + worker::CLOSING, &mut self.done).await {
            return ended(done);
        }
        let path = self.wells.front().map_or_else(|| self.run.clone(), |planned| self.run.join(&planned.well));
        Made::Done(Box::new(Err(StoreError::Unclosed { path, waited_s: worker::CLOSING.as_secs_f64() })))
    }
}

/// The outcome of a well whose numbers were given up, with the command that computes them by hand.
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
    fn a_well_on_which_the_daemon_ended_twice_is_given_up() {
        let planned = PlannedWell::new("A01", carved_records::SpecimenKind::Larva, None);
        let next = |tried| attempt(Path::new("/data/runs/r1"), &planned, tried);
        assert!(matches!(next(0), Attempt::Begin(1)) && matches!(next(1), Attempt::Begin(2)));
        let Attempt::GiveUp(given_up) = next(2) else { panic!("it is tried for ever") };
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
