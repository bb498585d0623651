//! The rig thread's handle of a specimen thread: what it sends, what it receives, and how long it waits for the end.

use super::clock::StageClock;
use super::estimator::LiveEstimator;
use super::optics::Blind;
use super::specimen::{Decision, Ended, Specimen, Work};
use super::{Overrun, Progress, RunContext, RunError};
use carved_core::pipeline::{Pipeline, TurnVerdict};
use carved_devices::acquisition::SinkClosed;
use carved_devices::cancel::CancelToken;
use carved_records::{Phase, PlannedWell, SpecimenOutcome, WellStatus, WellTimes};
use carved_store::{RecordingWriter, StoreError};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Room in the queue for messages that are not views.
const WORDS: usize = 8;
/// Interval in which a wait checks whether the run was cancelled.
const CANCEL_CHECK: Duration = Duration::from_millis(20);
/// Maximum time to close a recording whose numbers are not needed: the step in progress, and the views in the queue. The end of the daemon
/// waits for it.
pub const CLOSING: Duration = Duration::from_secs(60);

/// The rig thread's handle of a specimen thread.
pub struct Science {
    context: Arc<RunContext>,
    planned: PlannedWell,
    work: SyncSender<Work>,
    verdicts: Receiver<TurnVerdict>,
    /// Disconnected when the thread has ended.
    alive: Receiver<()>,
    thread: JoinHandle<Result<Ended, RunError>>,
    unwanted: Arc<AtomicBool>,
    decision: Decision,
    enough: Arc<AtomicBool>,
}

/// Why there is no verdict.
pub enum NoVerdict {
    Overrun(Overrun),
    Cancelled,
    /// The thread has ended. Its result says why.
    Ended,
}

impl Science {
    /// Starts the thread.
    ///
    /// # Errors
    /// The computer starts no thread. The recording is left without its sums.
    pub fn start(context: &Arc<RunContext>, planned: &PlannedWell, pipeline: Pipeline, writer: RecordingWriter) -> Result<Self, RunError> {
        // Room for every view, so that the axis never waits for the computation.
        let (work, handed) = sync_channel(2 * context.method.asd as usize + WORDS);
        let (verdict, verdicts) = channel();
        let (living, alive) = channel();
        let [unwanted, enough] = std::array::from_fn(|_| Arc::new(AtomicBool::new(false)));
        let decision = Decision::default();
        let specimen = Specimen {
            context: Arc::clone(context),
            planned: planned.clone(),
            pipeline,
            writer,
            seconds: Vec::new(),
            stages: StageClock::default(),
            unwanted: Arc::clone(&unwanted),
            decision: decision.clone(),
            estimator: LiveEstimator::new(context.method.early_stop),
            enough: Arc::clone(&enough),
            blind: Blind::default(),
            drawn: None,
        };
        let work_through = move || {
            let _living = living;
            specimen.run(&handed, &verdict)
        };
        let thread = std::thread::Builder::new().name("specimen".into()).spawn(work_through).map_err(RunError::NoThread)?;
        Ok(Self { context: Arc::clone(context), planned: planned.clone(), work, verdicts, alive, thread, unwanted, decision, enough })
    }

    /// Sends work to the thread.
    ///
    /// # Errors
    /// The thread has ended. [`Self::close`] returns why.
    pub fn send(&self, work: Work) -> Result<(), SinkClosed> {
        self.work.send(work).map_err(|_| SinkClosed)
    }

    /// Has the specimen measured. Returns once its turn is durable, so that the specimen may be released.
    ///
    /// # Errors
    /// The thread has ended. [`Self::close`] returns why.
    pub fn accept(&self) -> Result<(), SinkClosed> {
        let (kept, is_kept) = channel();
        self.send(Work::Accepted { kept })?;
        is_kept.recv().map_err(|_| SinkClosed)
    }

    /// Whether the views so far are enough by the method's rule.
    pub fn has_enough(&self) -> bool {
        self.enough.load(Ordering::Acquire)
    }

    /// Asks for the verdict on the turn, and waits for it.
    pub fn verdict(&self, allowed: Duration, cancel: &CancelToken) -> Result<TurnVerdict, NoVerdict> {
        let began = Instant::now();
        self.send(Work::Turned).map_err(|SinkClosed| NoVerdict::Ended)?;
        loop {
            match self.verdicts.recv_timeout(CANCEL_CHECK) {
                Ok(verdict) => return Ok(verdict),
                Err(RecvTimeoutError::Disconnected) => return Err(NoVerdict::Ended),
                Err(RecvTimeoutError::Timeout) if cancel.is_cancelled() => return Err(NoVerdict::Cancelled),
                Err(RecvTimeoutError::Timeout) if began.elapsed() >= allowed => {
                    self.unwanted.store(true, Ordering::Release);
                    return Err(NoVerdict::Overrun(Overrun::new(Phase::Reconstruct, began.elapsed(), allowed)));
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Drops the numbers, lets the thread store the views in its queue and close its recording, and returns its result. A thread that hangs
    /// on the disk is detached.
    pub fn close(self) -> Result<Ended, RunError> {
        self.close_within(CLOSING)
    }

    fn close_within(self, allowed: Duration) -> Result<Ended, RunError> {
        self.unwanted.store(true, Ordering::Release);
        drop(self.work);
        if self.alive.recv_timeout(allowed) == Err(RecvTimeoutError::Timeout) {
            // The detached thread must not report the well's result later.
            self.decision.silence();
            return Err(unclosed(&self.context, &self.planned, allowed));
        }
        self.thread.join().map_err(|_| RunError::SpecimenThread)?
    }

    /// Waits for the numbers of a released specimen. If this takes longer than `allowed`, the well fails: the thread is detached, and writes
    /// and reports nothing any more. Numbers that are being written by then are waited for.
    pub fn settle(self, allowed: Duration) -> Result<(), RunError> {
        self.settle_within(allowed, CLOSING)
    }

    fn settle_within(self, allowed: Duration, closing: Duration) -> Result<(), RunError> {
        let began = Instant::now();
        drop(self.work);
        if self.alive.recv_timeout(allowed) == Err(RecvTimeoutError::Timeout) {
            if self.decision.give_up() {
                let overrun = Overrun::new(Phase::Measure, began.elapsed(), allowed);
                let mut result = WellStatus::pending(&self.planned);
                result.end(SpecimenOutcome::Failed, Some(&overrun.to_string()));
                let seconds = began.elapsed().as_secs_f64();
                self.context.report(Progress::WellDone { result, seconds, times: WellTimes::default() });
                return Ok(());
            }
            if self.alive.recv_timeout(closing) == Err(RecvTimeoutError::Timeout) {
                self.decision.silence();
                return Err(unclosed(&self.context, &self.planned, closing));
            }
        }
        match self.thread.join().map_err(|_| RunError::SpecimenThread)?? {
            Ended::Told => Ok(()),
            Ended::Failed(_) | Ended::Dropped => Err(RunError::SpecimenThread),
        }
    }
}

fn unclosed(context: &RunContext, planned: &PlannedWell, waited: Duration) -> RunError {
    StoreError::Unclosed { path: context.folder.join(&planned.well), waited_s: waited.as_secs_f64() }.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use carved_records::Mode;
    use std::path::Path;
    use std::sync::mpsc::Sender;

    /// The handle of a thread that works until the sender is dropped, and what it tells.
    fn hanging() -> (Science, Sender<()>, tokio::sync::mpsc::Receiver<Progress>) {
        let config = Config::parse(include_str!("../../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
        let (progress, told) = tokio::sync::mpsc::channel(4);
        let context = RunContext {
            identity: config.identity(String::new()),
            mode: Mode::Simulated,
            run: "r1".into(),
            plate: "P1".into(),
            wells: Vec::new(),
            eject_first: None,
            inside: None,
            asked_before: None,
            method_name: "standard".into(),
            method: config.methods["standard"].clone(),
            config: Arc::new(config),
            folder: "/data/runs/r1".into(),
            cancel: CancelToken::new(),
            pause: CancelToken::new(),
            specimen_out: CancelToken::new(),
            progress,
            pictures: Arc::default(),
            opacities: Arc::default(),
        };
        let ((work, _handed), (_verdict, verdicts), (living, alive)) = (sync_channel(1), channel(), channel());
        let (hang, hung) = channel::<()>();
        let [unwanted, enough] = std::array::from_fn(|_| Arc::new(AtomicBool::new(false)));
        let thread = std::thread::spawn(move || {
            let _living = living;
            let _until_the_test_ends = hung.recv();
            Ok(Ended::Told)
        });
        let planned = serde_json::from_str(r#"{"well": "A01"}"#).unwrap();
        let decision = Decision::default();
        let science = Science { context: Arc::new(context), planned, work, verdicts, alive, thread, unwanted, decision, enough };
        (science, hang, told)
    }

    const SOON: Duration = Duration::from_millis(10);

    fn is_unclosed(ended: Result<(), RunError>) -> bool {
        matches!(ended, Err(RunError::Store(StoreError::Unclosed { path, .. })) if path.ends_with("r1/A01"))
    }

    #[test]
    fn a_record_that_a_hanging_disk_keeps_open_is_not_waited_for_for_ever() {
        let (science, hang, _told) = hanging();
        let decision = science.decision.clone();
        assert!(is_unclosed(science.close_within(SOON).map(|_| ())));
        assert!(!decision.begin_to_write() && !decision.is_to_write(), "its thread may still tell the well's result");
        drop(hang);
    }

    #[test]
    fn numbers_that_were_given_up_are_not_written_afterwards() {
        let (science, hang, mut told) = hanging();
        let decision = science.decision.clone();
        science.settle_within(SOON, SOON).unwrap();
        let Ok(Progress::WellDone { result, .. }) = told.try_recv() else { panic!("the well has no result") };
        assert_eq!(result.outcome, Some(SpecimenOutcome::Failed));
        assert!(!decision.begin_to_write(), "a failed well gets numbers");
        drop(hang);
    }

    #[test]
    fn numbers_that_are_being_written_at_the_deadline_are_not_given_up() {
        let (science, hang, mut told) = hanging();
        let decision = science.decision.clone();
        assert!(decision.begin_to_write());
        // Its last file is written while the rig thread waits.
        drop(hang);
        science.settle_within(Duration::ZERO, CLOSING).unwrap();
        assert!(told.try_recv().is_err() && decision.is_to_write(), "the thread itself reports the well");

        let (science, hang, mut told) = hanging();
        let decision = science.decision.clone();
        assert!(decision.begin_to_write());
        assert!(is_unclosed(science.settle_within(SOON, SOON)));
        assert!(told.try_recv().is_err() && !decision.is_to_write(), "it may still tell the well's result");
        drop(hang);
    }
}
