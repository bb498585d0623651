//! A run from its acceptance to its outcome, and the work on it.

use super::super::worker::{Instrument, Progress, RunEnd};
use super::recovery::{Continuation, Made, Recovery};
use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use carved_store::RunRecord;
use tokio::sync::mpsc;
use tokio::task::{JoinError, JoinHandle};

/// What becomes of the run once its worker has ended; the later one wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Request {
    Nothing,
    Hold,
    /// By a fault.
    Halt,
    Stop,
    Abort,
    ShutDown,
}

/// The work on a run that has no outcome yet. What its events say of it is in [`RunState`](carved_records::RunState).
pub(super) struct Active {
    pub record: RunRecord,
    /// None while it is held, or waits for a specimen to be taken out.
    pub work: Option<Work>,
    /// Numbers that are made from the frames of specimens that are gone.
    pub recovery: Option<Recovery>,
    /// What waits for these numbers.
    pub continuation: Option<Continuation>,
    pub request: Request,
    /// What else held it is over by itself: it goes on once a background task has brought the instrument back.
    pub may_go_on: bool,
    /// The well whose specimen the loader is asked for.
    pub waiting_for: Option<String>,
    /// The well whose specimen the loader has to take out before the run goes on.
    pub take_out: Option<String>,
    /// The well whose specimen a driven sampler takes out before the run goes on.
    pub eject_first: Option<String>,
    /// A fault has cancelled its worker, whatever else was asked for since.
    pub halted: bool,
    /// Its larvae are measured without a bead gate that stands.
    pub lacks_gate: bool,
}

/// The worker of a run, as the driver holds it.
pub(super) struct Work {
    pub cancel: CancelToken,
    pub pause: CancelToken,
    pub stop: StopHandle,
    pub worker: JoinHandle<(Instrument, RunEnd)>,
    pub progress: mpsc::Receiver<Progress>,
}

/// However the driver ends, a panic included: motors first, and the worker then ends by itself.
impl Drop for Work {
    fn drop(&mut self) {
        self.cancel.cancel();
        if !self.worker.is_finished() {
            self.stop.stop();
        }
    }
}

impl Active {
    pub fn new(record: RunRecord) -> Self {
        Self {
            record,
            work: None,
            recovery: None,
            continuation: None,
            request: Request::Nothing,
            may_go_on: false,
            waiting_for: None,
            take_out: None,
            eject_first: None,
            halted: false,
            lacks_gate: false,
        }
    }
}

pub(super) enum Message {
    Progress(Progress),
    Ended(Result<(Instrument, RunEnd), JoinError>),
    Recovered(Made),
}

/// The worker's next word, its end only after everything it said before; or numbers that were made from frames.
pub(super) async fn next_message(active: &mut Option<Active>) -> Message {
    let Some(Active { work, recovery, .. }) = active else { return std::future::pending().await };
    let worker = async {
        let Some(work) = work else { return std::future::pending().await };
        tokio::select! {
            biased;
            Some(progress) = work.progress.recv() => Message::Progress(progress),
            ended = &mut work.worker => Message::Ended(ended),
        }
    };
    let numbers = async {
        match recovery {
            Some(recovery) => Message::Recovered(recovery.made().await),
            None => std::future::pending().await,
        }
    };
    tokio::select! {
        word = worker => word,
        word = numbers => word,
    }
}
