//! The rig thread's handle of a specimen thread: what it sends, what it receives, and how long it waits for the end.

use super::clock::StageClock;
use super::estimator::LiveEstimator;
use super::optics::Blind;
use super::specimen::{Ended, Specimen, Work};
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
    told: Arc<AtomicBool>,
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
    pub fn start(context: &Arc<RunContext>, planned: &PlannedWell, pipeline: Pipeline, writer: RecordingWriter) -> Self {
        // Room for every view, so that the axis never waits for the computation.
        let (work, handed) = sync_channel(2 * context.method.asd as usize + WORDS);
        let (verdict, verdicts) = channel();
        let (living, alive) = channel();
        let [unwanted, told, enough] = std::array::from_fn(|_| Arc::new(AtomicBool::new(false)));
        let specimen = Specimen {
            context: Arc::clone(context),
            planned: planned.clone(),
            pipeline,
            writer,
            seconds: Vec::new(),
            stages: StageClock::default(),
            unwanted: Arc::clone(&unwanted),
            told: Arc::clone(&told),
            estimator: LiveEstimator::new(context.method.early_stop),
            enough: Arc::clone(&enough),
            blind: Blind::default(),
        };
        let thread = std::thread::spawn(move || {
            let _living = living;
            specimen.run(&handed, &verdict)
        });
        Self { context: Arc::clone(context), planned: planned.clone(), work, verdicts, alive, thread, unwanted, told, enough }
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
            self.told.store(true, Ordering::Release);
            let path = self.context.folder.join(&self.planned.well);
            return Err(StoreError::Unclosed { path, waited_s: allowed.as_secs_f64() }.into());
        }
        self.thread.join().map_err(|_| RunError::SpecimenThread)?
    }

    /// Waits for the numbers of a released specimen. If this takes longer than `allowed`, the well fails. The thread is detached and
    /// reports nothing any more.
    pub fn settle(self, allowed: Duration) -> Result<(), RunError> {
        let began = Instant::now();
        drop(self.work);
        if self.alive.recv_timeout(allowed) == Err(RecvTimeoutError::Timeout) && !self.told.swap(true, Ordering::AcqRel) {
            let overrun = Overrun::new(Phase::Measure, began.elapsed(), allowed);
            let mut result = WellStatus::pending(&self.planned);
            result.end(SpecimenOutcome::Failed, Some(&overrun.to_string()));
            let seconds = began.elapsed().as_secs_f64();
            self.context.tell(Progress::WellDone { result, seconds, times: WellTimes::default() });
            return Ok(());
        }
        match self.thread.join().map_err(|_| RunError::SpecimenThread)?? {
            Ended::Told => Ok(()),
            Ended::Failed(_) | Ended::Dropped => Err(RunError::SpecimenThread),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use carved_records::Mode;
    use std::path::Path;

    #[test]
    fn a_record_that_a_hanging_disk_keeps_open_is_not_waited_for_for_ever() {
        let config = Config::parse(include_str!("../../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
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
            progress: tokio::sync::mpsc::channel(1).0,
        };
        let ((work, _handed), (_verdict, verdicts), (living, alive)) = (sync_channel(1), channel(), channel());
        let (hang, hung) = channel::<()>();
        let [unwanted, told, enough] = std::array::from_fn(|_| Arc::new(AtomicBool::new(false)));
        let thread = std::thread::spawn(move || {
            let _living = living;
            let _until_the_test_ends = hung.recv();
            Ok(Ended::Dropped)
        });
        let planned = serde_json::from_str(r#"{"well": "A01"}"#).unwrap();
        let science =
            Science { context: Arc::new(context), planned, work, verdicts, alive, thread, unwanted, told: Arc::clone(&told), enough };
        let error = science.close_within(Duration::from_millis(10)).err().unwrap();
        assert!(matches!(&error, RunError::Store(StoreError::Unclosed { path, .. }) if path.ends_with("r1/A01")), "{error}");
        assert!(told.load(Ordering::Acquire), "its thread may still tell the well's result");
        drop(hang);
    }
}
