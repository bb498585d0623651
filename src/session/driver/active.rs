//! A run from its acceptance to its outcome, and the work on it.

use super::super::eta::UnderWay;
use super::super::worker::{Instrument, Progress, RunEnd};
use super::recovery::{Made, Recovery, Then};
use crate::config::Resume;
use crate::store::RunRecord;
use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use std::collections::BTreeMap;
use tokio::sync::mpsc;
use tokio::task::{JoinError, JoinHandle};

/// A run that has gone on this often without finishing a well waits for a person: something is wrong that comes back.
const RESUMED_BY_ITSELF: u32 = 3;

/// What becomes of the run once its worker has ended; the later one wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Asked {
    Nothing,
    Hold,
    /// By a fault.
    Halt,
    Stop,
    Abort,
    ShutDown,
}

/// What holds a run.
pub(super) struct Cause {
    /// A fault's code, or one of those below.
    pub code: String,
    pub words: String,
}

impl Cause {
    pub fn operator() -> Self {
        Self { code: "operator".into(), words: "An operator asked for it.".into() }
    }

    pub fn restart() -> Self {
        Self { code: "restart".into(), words: "The daemon ended while the run was under way, and was started again.".into() }
    }
}

/// A run that has no outcome yet.
#[allow(clippy::struct_excessive_bools, reason = "four facts that do not exclude one another")]
pub(super) struct Active {
    pub record: RunRecord,
    /// None while it is held, or waits for a specimen to be taken out.
    pub work: Option<Work>,
    /// Numbers that are made from the frames of specimens that are gone.
    pub recovery: Option<Recovery>,
    /// How often the numbers of a well were begun to be made so since anything came of it.
    pub recoveries: BTreeMap<String, u32>,
    /// What waits for these numbers.
    pub then: Option<Then>,
    pub asked: Asked,
    /// An operator has held it, and nobody but an operator lets it go on, whatever else held it too.
    pub held_by_operator: bool,
    /// What else held it is over by itself: it goes on once an errand has brought the instrument back.
    pub may_go_on: bool,
    /// The well whose specimen the loader is asked for.
    pub waiting_for: Option<String>,
    /// The well whose specimen the loader has to take out before the run goes on.
    pub take_out: Option<String>,
    /// The well whose specimen a driven sampler takes out before the run goes on.
    pub eject_first: Option<String>,
    /// The wells whose specimens were begun and have no end, and what they take: one has the rig, another's numbers may be made.
    pub under_way: BTreeMap<String, UnderWay>,
    /// How often it has gone on by itself since a well was done.
    pub resumed_by_itself: u32,
    /// What has held it last.
    pub cause: Option<Cause>,
    /// How often each cause has held it since a well was done, by its code.
    pub holds: BTreeMap<String, u32>,
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
            recoveries: BTreeMap::new(),
            then: None,
            asked: Asked::Nothing,
            held_by_operator: false,
            may_go_on: false,
            waiting_for: None,
            take_out: None,
            eject_first: None,
            under_way: BTreeMap::new(),
            resumed_by_itself: 0,
            cause: None,
            holds: BTreeMap::new(),
            halted: false,
            lacks_gate: false,
        }
    }

    /// Whether its method lets it go on once what holds it is over; not for ever where no well gets done.
    pub fn resumes_by_itself(&self) -> bool {
        self.record.method.policy.resume == Resume::Automatic && self.resumed_by_itself < RESUMED_BY_ITSELF
    }
}

pub(super) enum Word {
    Progress(Progress),
    Ended(Result<(Instrument, RunEnd), JoinError>),
    Recovered(Made),
}

/// The worker's next word, its end only after everything it said before; or numbers that were made from frames.
pub(super) async fn word_of(active: &mut Option<Active>) -> Word {
    let Some(Active { work, recovery, .. }) = active else { return std::future::pending().await };
    let worker = async {
        let Some(work) = work else { return std::future::pending().await };
        tokio::select! {
            biased;
            Some(progress) = work.progress.recv() => Word::Progress(progress),
            ended = &mut work.worker => Word::Ended(ended),
        }
    };
    let numbers = async {
        match recovery {
            Some(recovery) => Word::Recovered(recovery.made().await),
            None => std::future::pending().await,
        }
    };
    tokio::select! {
        word = worker => word,
        word = numbers => word,
    }
}
