//! `carved measure --out`: the numbers of any number of recordings, into a folder, by several jobs and on several machines.
//!
//! ```text
//! PATH... ── recordings, sorted by name ── shard K/N ── J jobs ──┬─ done and intact: left out
//!                                                                ├─ OUT/RUN/WELL/{replay.json, measurement.json, SHA256SUMS}
//!                                                                └─ failed: reported at the end, the others go on
//! ```
//! The shards of one list are disjoint and hold all of it, so that shards need not know of each other. `SHA256SUMS` is written last: what an
//! interrupted job leaves is computed again. A recording, a method or a carved that has changed is computed again too.

use super::super::folders::HoldsRuns;
use super::super::signals::{INTERRUPTED, Signals};
use super::super::{replay, with_causes};
use super::source::{self, Source};
use super::{compute_with, each, outside};
use anyhow::{Context, ensure};
use carved_records::{Method, sha256_hex};
use carved_store::{MEASUREMENT, ReplayWriter, RunRecord, StoreError, durable};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeVal;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

#[derive(Debug, clap::Args)]
pub struct Options {
    /// With --out: only the K-th of N equal parts of the recordings, as in 3/16. Every part needs the same list of recordings.
    #[arg(long, value_name = "K/N", requires = "out", default_value = "1/1")]
    shard: Shard,
    /// With --out: number of processors to use, each for a recording of its own while there are enough [default: all processors]
    #[arg(long, value_name = "J", requires = "out")]
    jobs: Option<NonZeroUsize>,
    /// With --out: another method, a TOML file with the keys of a [methods.NAME] table [default: the method of each recording]
    #[arg(long, value_name = "FILE", requires = "out")]
    method: Option<String>,
}

/// The `number`-th of `of` parts, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Shard {
    number: usize,
    of: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let read = || {
            let (number, of) = text.split_once('/')?;
            Some(Self { number: number.parse().ok()?, of: of.parse().ok()? })
        };
        read()
            .filter(|s| (1..=s.of).contains(&s.number))
            .ok_or_else(|| format!("{text:?} is no part; expected K/N with K from 1 to N, as 3/16"))
    }
}

impl Shard {
    fn has(self, place: usize) -> bool {
        place % self.of == self.number - 1
    }
}

/// Exit code where recordings could not be measured. To repeat the command does not help. An error of the disk has exit code 1.
const SOME_FAILED: u8 = 3;

/// The printed result.
#[derive(serde::Serialize)]
struct Summary {
    /// Recordings of this shard.
    recordings: usize,
    measured: usize,
    /// Measured by an earlier call.
    left_out: usize,
    failed: usize,
    jobs: usize,
    threads_per_job: usize,
    elapsed_s: f64,
    /// Time that this program has spent on processors. `None` if the system refuses to say it.
    processor_s: Option<f64>,
    /// Plates of 96 wells that one processor measures in an hour of its work. `None` if nothing was measured.
    plates_per_core_hour: Option<f64>,
}

enum Done {
    Measured,
    LeftOut,
}

/// Measures the recordings of this shard that are not in `out` yet.
///
/// # Errors
/// Two recordings of one name, a method that cannot be used, a folder that cannot be written or that holds stored recordings.
pub fn run(paths: &[PathBuf], out: &Path, options: &Options) -> anyhow::Result<ExitCode> {
    let method = options.method.as_deref().map(|file| replay::method(file, None)).transpose()?;
    let (named, mut failures) = named(paths)?;
    outside::check(out, &named)?;
    let mine: Vec<(&String, &PathBuf)> =
        named.iter().enumerate().filter(|(place, _)| options.shard.has(*place)).map(|(_, recording)| recording).collect();
    durable::create_folder(out)?;
    // A scheduler may have given this job fewer processors than the machine has.
    let processors = options.jobs.or_else(|| std::thread::available_parallelism().ok()).map_or(1, NonZeroUsize::get);
    let jobs = processors.min(mine.len().max(1));
    let threads_per_job = processors / jobs;
    let pools = (0..jobs).map(|_| ThreadPoolBuilder::new().num_threads(threads_per_job).build()).collect::<Result<Vec<_>, _>>();
    let pools = pools.context("cannot start the threads")?;
    let progress = Arc::new(Progress::new(mine.len()));
    let interrupted = Arc::clone(&progress);
    Signals::at_each_but_hangup(move |signal| {
        interrupted.interrupt(signal);
        std::process::exit(INTERRUPTED);
    })?;
    let (began, next) = (Instant::now(), AtomicUsize::new(0));
    let work = |pool: &ThreadPool| {
        let mut results = Vec::new();
        while let Some((name, path)) = mine.get(next.fetch_add(1, Ordering::Relaxed)) {
            let began = Instant::now();
            let done = pool.install(|| one(path, &out.join(name), method.as_ref()));
            // Nothing more can be written, so that no job needs to go on.
            if done.as_ref().is_err_and(anyhow::Error::is::<NotWritten>) {
                next.store(mine.len(), Ordering::Relaxed);
            }
            progress.report(name, &done, began);
            results.push(done.map_err(|error| (path.display().to_string(), error)));
        }
        results
    };
    let results: Vec<_> = std::thread::scope(|scope| {
        let workers: Vec<_> = pools.iter().map(|pool| scope.spawn(|| work(pool))).collect();
        workers.into_iter().map(|worker| worker.join().map_err(|_| anyhow::anyhow!("a job panicked"))).collect::<anyhow::Result<Vec<_>>>()
    })?
    .into_iter()
    .flatten()
    .collect();
    progress.bar.finish_and_clear();
    let (mut measured, mut left_out) = (0, 0);
    for result in results {
        match result {
            Ok(Done::Measured) => measured += 1,
            Ok(Done::LeftOut) => left_out += 1,
            Err((_, error)) if error.is::<NotWritten>() => return Err(error),
            Err((path, error)) => {
                let said = with_causes(&error);
                failures.push(if said.contains(&path) { said } else { format!("{path}: {said}") });
            }
        }
    }
    let elapsed_s = began.elapsed().as_secs_f64();
    let processor_s = processor_s();
    let core_hours = processor_s.unwrap_or(elapsed_s * (jobs * threads_per_job) as f64) / 3600.0;
    let plates_per_core_hour = (measured > 0).then(|| measured as f64 / 96.0 / core_hours);
    let recordings = mine.len();
    let failed = failures.len();
    let summary = Summary { recordings, measured, left_out, failed, jobs, threads_per_job, elapsed_s, processor_s, plates_per_core_hour };
    say!("{}", serde_json::to_string(&summary)?);
    if failures.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    note!("carved: {failed} recording(s) could not be measured:\n{}", failures.join("\n"));
    Ok(ExitCode::from(SOME_FAILED))
}

/// User and system time of this process.
fn processor_s() -> Option<f64> {
    let usage = getrusage(UsageWho::RUSAGE_SELF).ok()?;
    let seconds = |time: TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
    Some(seconds(usage.user_time()) + seconds(usage.system_time()))
}

/// The folder for results cannot be written.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
struct NotWritten(#[from] StoreError);

/// The recordings by their names `RUN/WELL`, and the names on the command line that have none.
fn named(paths: &[PathBuf]) -> anyhow::Result<(BTreeMap<String, PathBuf>, Vec<String>)> {
    let (mut named, mut failures) = (BTreeMap::<String, PathBuf>::new(), Vec::new());
    // The folders by their names, which the numbers go to, and by the run that they hold, which a table names.
    let (mut runs, mut ids) = (BTreeMap::<String, PathBuf>::new(), BTreeMap::<String, PathBuf>::new());
    for (path, found) in each(paths) {
        let whole = found.and_then(|()| match source::address(&path) {
            Some(_) => Ok(path.clone()),
            None => path.canonicalize().with_context(|| format!("{}: no recording", path.display())),
        });
        let whole = match whole {
            Ok(whole) => whole,
            // The wrong list, not a recording that fails: no shard may succeed.
            Err(error) if error.is::<HoldsRuns>() => return Err(error),
            Err(error) => {
                failures.push(with_causes(&error));
                continue;
            }
        };
        let part = |path: Option<&Path>| path.and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
        // A pack stands for the folder of its recording.
        let folder = if whole.extension().is_some_and(|e| e == "tar") { whole.with_extension("") } else { whole.clone() };
        let run = part(folder.parent());
        let name = format!("{run}/{}", part(Some(&folder)));
        if let Some(parent) = folder.parent().filter(|parent| runs.get(&run).is_none_or(|known| known != parent)) {
            once(&mut runs, run.clone(), parent)?;
            if let Ok(record) = RunRecord::of_folder(parent) {
                once(&mut ids, record.id, parent)?;
            }
        }
        if let Some(other) = named.insert(name.clone(), whole.clone()) {
            ensure!(
                other == whole,
                "{} and {} would both be written to {name}; measure them into two folders",
                other.display(),
                whole.display()
            );
        }
    }
    Ok((named, failures))
}

/// Notes the folder of a run. A table has each run once.
fn once(known: &mut BTreeMap<String, PathBuf>, run: String, folder: &Path) -> anyhow::Result<()> {
    if let Some(other) = known.get(&run) {
        anyhow::bail!("{} and {} are two runs of the name {run}; measure them into two folders", other.display(), folder.display());
    }
    known.insert(run, folder.to_owned());
    Ok(())
}

/// Measures a recording, unless its numbers are there.
fn one(path: &Path, folder: &Path, other: Option<&(String, Method)>) -> anyhow::Result<Done> {
    let source = Source::open(path)?;
    let reader = &source.reader;
    let recording_sha256 = sha256_hex(&reader.files().require("recording.json")?);
    let recorded = &reader.recording().method;
    let (name, method) = other.map_or((None, recorded), |(name, method)| (Some(name.as_str()), method));
    let writer = ReplayWriter::outside(folder.to_owned(), name);
    if writer.is_done(method, &recording_sha256) {
        return Ok(Done::LeftOut);
    }
    // Where this fails, the numbers of an earlier method must not stand in the table.
    writer.forget().map_err(NotWritten)?;
    let file = compute_with(reader, method, &ProgressBar::hidden())?.file;
    let numbers = durable::json_text(Path::new(MEASUREMENT), &file)?;
    writer.write(method, Some(recording_sha256), &[(MEASUREMENT, numbers)]).map_err(NotWritten)?;
    Ok(Done::Measured)
}

/// A bar on a terminal, lines elsewhere.
struct Progress {
    bar: ProgressBar,
    is_terminal: bool,
    count: Mutex<Count>,
    of: usize,
}

#[derive(Default)]
struct Count {
    done: usize,
    failed: usize,
}

impl Progress {
    fn new(of: usize) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let style =
            ProgressStyle::with_template("{bar:30} {pos}/{len} recordings, {eta} left").unwrap_or_else(|_| ProgressStyle::default_bar());
        let target = if is_terminal { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        Self { bar: ProgressBar::with_draw_target(Some(of as u64), target).with_style(style), is_terminal, count: Mutex::default(), of }
    }

    fn report(&self, name: &str, done: &anyhow::Result<Done>, began: Instant) {
        let mut count = self.count();
        *(if done.is_ok() { &mut count.done } else { &mut count.failed }) += 1;
        self.bar.inc(1);
        if self.is_terminal {
            return;
        }
        let said = match done {
            Ok(Done::Measured) => format!("measured in {:.1} s", began.elapsed().as_secs_f64()),
            Ok(Done::LeftOut) => "was measured before".into(),
            Err(_) => "failed".into(),
        };
        note!("carved: {} of {}, {name}: {said}", count.done + count.failed, self.of);
    }

    /// Tells how far the command has come when a signal ends it.
    fn interrupt(&self, signal: &str) {
        self.bar.finish_and_clear();
        let Count { done, failed } = *self.count();
        note!(
            "carved: {signal}: {done} of {} recordings are done, {failed} failed. Start the same command again: it leaves out what is done",
            self.of
        );
    }

    fn count(&self) -> MutexGuard<'_, Count> {
        self.count.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shards_of_a_list_are_disjoint_and_hold_all_of_it() {
        for of in 1..=7 {
            let shards: Vec<Shard> = (1..=of).map(|number| format!("{number}/{of}").parse().unwrap()).collect();
            for place in 0..40 {
                assert_eq!(shards.iter().filter(|shard| shard.has(place)).count(), 1, "place {place} of {of} shards");
            }
        }
    }

    #[test]
    fn what_is_no_shard_is_refused_with_an_example() {
        for wrong in ["0/4", "5/4", "1", "1/0", "a/b", "", "-1/4"] {
            assert!(wrong.parse::<Shard>().unwrap_err().contains("3/16"), "{wrong}");
        }
    }
}
