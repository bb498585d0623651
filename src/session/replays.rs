//! Measures stored wells again by another method, in the background of the daemon, and keeps the numbers beside the first ones. `carved
//! replay --method` does the same from the command line, with the same files.
//!
//! ```text
//! begin ─► thread "replays" ── well by well: frames ─ recording::compute ─ numbers::write_beside ─► RUN/WELL/replays/NAME/
//!              │                              │
//!              └─ threads of its own, of the  └─ before each frame: waits while a run is under way, ends when the daemon ends
//!                 lowest priority
//! ```
//! A run has the computer for itself: nothing begins while one is under way, and what is computed when one starts rests until it is over.

use super::numbers;
use super::{SessionHandle, Status};
use carved_offline::Stopped;
use carved_offline::recording::{self, Computed, NumbersError};
use carved_records::Method;
use carved_store::{RecordingReader, RunClaim};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::runtime::Handle;
use tokio::sync::watch;

/// Why the text of a method cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MethodError {
    #[error("not the keys of a `[methods.NAME]` table (docs/configuration.md)")]
    Keys(#[source] toml::de::Error),
    #[error("{} value(s) cannot be used:\n  {}", .0.len(), .0.join("\n  "))]
    Values(Vec<String>),
}

/// Reads a method from TOML with the keys of a `[methods.NAME]` table.
///
/// # Errors
/// Other keys, or values that cannot be used.
pub fn method(text: &str) -> Result<Method, MethodError> {
    let method: Method = toml::from_str(text).map_err(MethodError::Keys)?;
    let wrong = method.check();
    if wrong.is_empty() { Ok(method) } else { Err(MethodError::Values(wrong)) }
}

/// Wells to measure again, and by what.
#[derive(Debug, Clone)]
pub struct Replay {
    pub run: String,
    /// Name of the method and of the results.
    pub name: String,
    pub method: Method,
    /// The wells with the folders of their recordings.
    pub wells: VecDeque<(String, PathBuf)>,
}

/// Why wells are not measured again now.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NotNow {
    #[error("run {run} is under way; measure again when it is over")]
    UnderWay { run: String },
    #[error("run {run} is being measured again as {name}; wait until that is done")]
    Busy { run: String, name: String },
    #[error("no thread can be started: {why}")]
    NoThread { why: String },
    #[error("the instrument is shutting down")]
    ShuttingDown,
}

/// How far measuring again has come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Progress {
    pub run: String,
    pub name: String,
    /// All wells that were asked for.
    pub wells: usize,
    /// Wells that are done, also those that failed.
    pub done: usize,
    /// Wells that could not be measured, each with the reason.
    pub failed: Vec<(String, String)>,
    /// It rests, because a run is under way.
    pub waits: bool,
}

/// The wells that are measured again, and the thread that does it.
pub struct Replays {
    session: SessionHandle,
    closing: watch::Sender<bool>,
    job: Mutex<Option<Progress>>,
    thread: Mutex<Option<std::thread::JoinHandle<()>>>,
}

fn is_under_way(status: &Status) -> bool {
    status.run.as_ref().is_some_and(|run| run.outcome.is_none())
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Replays {
    pub fn new(session: SessionHandle) -> Arc<Self> {
        Arc::new(Self { session, closing: watch::channel(false).0, job: Mutex::default(), thread: Mutex::default() })
    }

    /// The work that was begun last, whether or not it is done.
    pub fn progress(&self) -> Option<Progress> {
        let waits = is_under_way(&self.session.status());
        locked(&self.job).clone().map(|job| Progress { waits: waits && job.done < job.wells, ..job })
    }

    /// Begins to measure. It must be called on a thread of the runtime.
    ///
    /// # Errors
    /// A run is under way, or other wells are being measured again.
    pub fn begin(self: &Arc<Self>, replay: Replay) -> Result<(), NotNow> {
        let mut thread = locked(&self.thread);
        if *self.closing.borrow() {
            return Err(NotNow::ShuttingDown);
        }
        if let Some(run) = self.session.status().run.filter(|run| run.outcome.is_none()) {
            return Err(NotNow::UnderWay { run: run.id });
        }
        if let Some(job) = locked(&self.job).as_ref().filter(|_| thread.as_ref().is_some_and(|t| !t.is_finished())) {
            return Err(NotNow::Busy { run: job.run.clone(), name: job.name.clone() });
        }
        let no_thread = |why: String| NotNow::NoThread { why };
        let pool = background().map_err(|e| no_thread(e.to_string()))?;
        let progress = Progress {
            run: replay.run.clone(),
            name: replay.name.clone(),
            wells: replay.wells.len(),
            done: 0,
            failed: Vec::new(),
            waits: false,
        };
        let (this, runtime) = (Arc::clone(self), Handle::current());
        let work = move || this.work(replay, &pool, &runtime);
        *thread = Some(std::thread::Builder::new().name("replays".into()).spawn(work).map_err(|e| no_thread(e.to_string()))?);
        *locked(&self.job) = Some(progress);
        Ok(())
    }

    /// Ends what is being computed, and waits for its thread.
    pub async fn end(&self) {
        self.closing.send_replace(true);
        let thread = locked(&self.thread).take();
        let joined = tokio::task::spawn_blocking(move || thread.map(std::thread::JoinHandle::join)).await;
        if !matches!(joined, Ok(None | Some(Ok(())))) {
            tracing::error!("the thread that measured again panicked");
        }
    }

    fn work(&self, replay: Replay, pool: &ThreadPool, runtime: &Handle) {
        let Replay { name, method, wells, run } = replay;
        // For all wells, so that no prune takes away those that are done.
        let run_folder = wells.front().and_then(|(_, folder)| folder.parent()).map(Path::to_owned);
        let mut claim = None;
        for (well, folder) in wells {
            let measured = catch_unwind(AssertUnwindSafe(|| {
                if claim.is_none() {
                    claim = run_folder.as_deref().map(RunClaim::shared).transpose()?;
                }
                pool.install(|| self.measure(&folder, &name, &method, runtime))
            }));
            let why = match measured {
                Ok(Ok(())) => None,
                Ok(Err(NumbersError::Stopped(_))) => return,
                Ok(Err(error)) => Some(error.to_string()),
                Err(_) => Some("the computation panicked; the log has more".into()),
            };
            if let Some(why) = &why {
                tracing::warn!(run, well, name, why, "not measured again");
            }
            let why = why.map(|why| without_folder(&why, &folder, &well));
            if let Some(job) = locked(&self.job).as_mut() {
                job.done += 1;
                job.failed.extend(why.map(|why| (well, why)));
            }
        }
    }

    fn measure(&self, folder: &Path, name: &str, method: &Method, runtime: &Handle) -> Result<(), NumbersError> {
        runtime.block_on(self.rest())?;
        let reader = RecordingReader::open(folder)?;
        let entries = recording::views(&reader, method)?;
        let Computed { mesh, file, .. } = recording::compute(&reader, method, &entries, |_, _| runtime.block_on(self.rest()))?;
        numbers::write_beside(&reader, name, method, &mesh, &file)?;
        Ok(())
    }

    /// Waits while a run is under way.
    async fn rest(&self) -> Result<(), Stopped> {
        let mut closing = self.closing.subscribe();
        tokio::select! {
            biased;
            _ = closing.wait_for(|closing| *closing) => Err(Stopped),
            () = self.session.until(|status| !is_under_way(status)) => Ok(()),
        }
    }
}

/// The message without the folder of the recording, which says nothing to a client on another computer.
fn without_folder(message: &str, folder: &Path, well: &str) -> String {
    let folder = folder.display().to_string();
    let rest = message.strip_prefix(&folder).and_then(|rest| rest.strip_prefix(": ")).unwrap_or(message);
    rest.replace(&folder, well)
}

/// Threads for half of the processors, which give way to all others.
fn background() -> Result<ThreadPool, rayon::ThreadPoolBuildError> {
    const LOWEST_PRIORITY: i32 = 19;
    let give_way = |_| {
        // On Linux this is the priority of the calling thread.
        if let Err(error) = rustix::process::setpriority_process(None, LOWEST_PRIORITY) {
            tracing::warn!(%error, "measuring again has the priority of a run");
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    ThreadPoolBuilder::new().num_threads(cores.div_ceil(2)).thread_name(|i| format!("replay-{i}")).start_handler(give_way).build()
}

#[cfg(test)]
mod tests {
    use super::super::driver::Driver;
    use super::super::handle::{Publisher, channel};
    use super::*;
    use crate::api::{RunOutcome, RunStatus, WellCounts};
    use carved_records::Mode;
    use futures::FutureExt;

    fn replays() -> (Arc<Replays>, Publisher) {
        let (session, _mailbox, publisher) = channel(Driver::first_status(Mode::Simulated, String::new()), Vec::new());
        (Replays::new(session), publisher)
    }

    fn run(publisher: &Publisher, outcome: Option<RunOutcome>) {
        let run: RunStatus = serde_json::from_value(serde_json::json!({
            "id": "r-1", "external_id": null, "method": "m", "operator": "kim", "results": [], "started": "", "ended": null, "eta_s": null,
            "wells": WellCounts::default(), "outcome": outcome,
        }))
        .unwrap();
        publisher.publish(|status| status.run = Some(run));
    }

    #[test]
    fn a_well_that_cannot_be_measured_says_why_without_a_path_of_the_server() {
        let of = |message| without_folder(message, Path::new("/data/runs/r1/A02"), "A02");
        assert_eq!(of("/data/runs/r1/A02: 13 views are recorded"), "13 views are recorded");
        assert_eq!(of("cannot read /data/runs/r1/A02/recording.json"), "cannot read A02/recording.json");
        assert_eq!(of("too few views"), "too few views");
    }

    #[test]
    fn a_run_has_the_computer_for_itself() {
        let (replays, publisher) = replays();
        assert!(matches!(replays.rest().now_or_never(), Some(Ok(()))), "no run");
        run(&publisher, None);
        assert!(replays.rest().now_or_never().is_none(), "it waits while the run is under way");
        let method = method("asd = 21\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 14.0").unwrap();
        let nothing = Replay { run: "r-0".into(), name: "m".into(), method, wells: VecDeque::new() };
        assert_eq!(replays.begin(nothing), Err(NotNow::UnderWay { run: "r-1".into() }));
        run(&publisher, Some(RunOutcome::Succeeded));
        assert!(matches!(replays.rest().now_or_never(), Some(Ok(()))), "the run is over");
        run(&publisher, None);
        replays.closing.send_replace(true);
        assert!(matches!(replays.rest().now_or_never(), Some(Err(Stopped))), "the daemon ends");
    }
}
