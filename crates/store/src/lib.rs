//! The persistent state: self-contained run folders, the event journal, and an index of both.
//!
//! ```text
//! DATA/events.jsonl               append-only, synced line by line
//! DATA/index.sqlite               for lookups; rebuilt from the rest if it is missing (see `index`)
//! DATA/instrument.json            the uuid of the instrument (see `instrument`)
//! DATA/queue.json                 the plates that wait for their turn (see `queue`)
//! DATA/calibrations/              calibrations of the rig (see `calibrations`)
//! DATA/runs/RUN/run.json          plan, method, outcome, one entry per well
//! DATA/runs/RUN/events.jsonl      the events of this run, as in the journal
//! DATA/runs/RUN/A01/              a recording with its results (see `recording`)
//! DATA/runs/RUN/A01.attempt-1/    an earlier attempt (see `attempts`)
//! ARCHIVE/RUN/A01.tar             a recording of a packed copy, in one file (see `pack`)
//! ```

mod archive;
mod attempts;
mod budget;
pub mod calibrations;
pub mod columns;
mod disk;
pub mod durable;
mod error;
pub mod frames;
pub mod gates;
mod index;
mod instrument;
mod journal;
mod lines;
mod objects;
mod pack;
#[cfg(test)]
mod power_loss;
mod queue;
mod reader;
mod receipt;
mod recording;
mod remote;
mod replay;
mod run;
mod run_claim;
mod run_files;
mod schema;
mod software;
mod stored_run;
mod sums;
#[cfg(any(test, feature = "testing"))]
pub mod testing;

pub use archive::{CRATE, Packing, Pruned, RunContents, archive, archive_to_objects, cut_short, end_prune, prune, run_names};
pub use attempts::{seal_run, set_aside};
pub use budget::{Budget, bytes_per_specimen, size};
pub use disk::{DiskWatch, busy_for};
pub use error::StoreError;
pub use index::{Cursor, EventsAfter, RunRow, RunScan, RunsQuery, Unreadable, follow_run};
pub use instrument::instrument_uuid;
use journal::Repaired;
pub use journal::{Journal, now};
pub use lines::EVENTS;
pub use objects::{Objects, Reach, is_address};
pub use pack::{Pack, RecordingFiles};
pub use queue::{MOST_PLATES, PlateQueue, QueueError, QueuedPlate};
pub use reader::{SpecimenFile, StoreReader, StoredFile, StoredSpecimen};
pub use receipt::Receipt;
pub use recording::{MEASUREMENT, MeasurementFile, Recording, RecordingReader, RecordingWriter, RigRecord, SecondRecord, fluorescence};
pub use remote::{fetch, recordings_at};
pub use replay::{ReplayWriter, Replayed};
pub use run::RunRecord;
pub use run_claim::RunClaim;
pub use run_files::RunFiles;
pub use software::Software;
pub use stored_run::{Computation, StoredRun, StoredWell, place_among_references};
pub use sums::seal;

use carved_records::{Event, EventData, Fault, JournalRepaired, Mode, RunUnreadable, fault_table, kind};
use index::Index;
use lines::Lines;
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Name of the file that makes a folder a recording.
const RECORDING: &str = "recording.json";

/// Number of events, without views, that a start reads: about three plates of 96 wells.
const REMEMBERED: usize = 4000;

/// An exclusive lock of a data folder. Take it before any device is opened: another daemon on this folder uses the same instrument, and
/// opening a controller's port may reset the controller during a move.
pub struct Claim {
    root: PathBuf,
    lock: File,
}

/// Unlock explicitly. Closing the file is not enough, because a child process shares the open file until it calls `exec`.
impl Drop for Claim {
    fn drop(&mut self) {
        if let Err(error) = self.lock.unlock() {
            tracing::debug!(%error, "the data folder's lock ends with its file");
        }
    }
}

impl Claim {
    /// Locks the folder. Creates it if it does not exist.
    ///
    /// # Errors
    /// Another carved has the lock, or the folder cannot be written.
    pub fn on(root: &Path) -> Result<Self, StoreError> {
        let runs = root.join("runs");
        durable::create_folder(&runs)?;
        let found = runs.symlink_metadata().map_err(StoreError::io("look at", &runs))?.file_type();
        if !found.is_dir() {
            let way_out = if found.is_symlink() { "Name the folder that it leads to as data_dir" } else { "Move it away" };
            return Err(StoreError::Format {
                path: runs,
                expected: "a folder",
                found: format!("{}. {way_out}", carved_files::kind(found)),
            });
        }
        let path = root.join("lock");
        let lock = carved_files::open_own(&path, OpenOptions::new().write(true).create(true)).map_err(StoreError::io("create", &path))?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { root: root.to_owned(), lock }),
            Err(std::fs::TryLockError::WouldBlock) => Err(StoreError::Locked { path: root.to_owned() }),
            Err(std::fs::TryLockError::Error(e)) => Err(StoreError::io("lock", &path)(e)),
        }
    }

    /// The uuid of the instrument that has this folder. The first call makes it.
    ///
    /// # Errors
    /// The file of the uuid is damaged and the runs of the folder do not name one uuid, or it cannot be read or written.
    pub fn instrument_uuid(&self) -> Result<String, StoreError> {
        instrument::found_or_made(&self.root)
    }
}

/// Whether there is a folder, and no link to one. No link is followed below the data folder.
fn is_own_folder(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|found| found.is_dir())
}

/// Whether there is a regular file, and no link to one.
fn is_own_file(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|found| found.is_file())
}

/// The data folder. One daemon at a time has it open.
pub struct Store {
    root: PathBuf,
    index: Arc<Index>,
    /// Runs without an outcome when the folder was opened.
    open: Vec<String>,
    _claim: Claim,
}

/// Rebuilds the index of a data folder from its run folders. No daemon may use the folder.
pub fn rebuild_index(root: &Path) -> Result<RunScan, StoreError> {
    let _claim = Claim::on(root)?;
    index::rebuild(root).map(|(_, found)| found)
}

impl Store {
    /// Opens or creates the journal and the index of the data folder. A run whose `run.json` cannot be read is reported in the log and as
    /// an event, and is not changed.
    pub fn open(claim: Claim) -> Result<(Self, Journal, Vec<Event>), StoreError> {
        let root = claim.root.as_path();
        for run in cut_short(root)? {
            tracing::warn!(
                run,
                "an earlier carved prune --all was cut short: what is left of the run takes up room in runs/.{run}.pruned. It was archived; \
                 carved prune {} --yes removes it",
                root.display()
            );
        }
        let path = root.join(lines::EVENTS);
        let mut lines = Lines::open(&path)?;
        let (from_byte, newest) = index::followed(root);
        let repaired = if journal::is_in_order(&path, from_byte, newest)? && journal::is_sound(&lines)? {
            None
        } else {
            let repaired = journal::repair(root)?;
            // The index contains the old ids.
            index::remove(root)?;
            lines = Lines::open(&path)?;
            Some(repaired)
        };
        let (index, found) = Index::open(root)?;
        let index = Arc::new(index);
        let (mut journal, mut events) = Journal::open(root, lines, index.clone())?;
        if let Some(Repaired { kept, renumbered, set_aside }) = repaired {
            tracing::error!(renumbered, set_aside, kept = %kept.display(), "the journal was damaged: its events were numbered on, and lines that are no events were left out");
            let name = kept.file_name().unwrap_or_default().to_string_lossy().into_owned();
            events.push(journal.append(None, None, EventData::JournalRepaired(JournalRepaired { renumbered, set_aside, kept: name }))?);
            if set_aside > 0 {
                let lines = if set_aside == 1 { "1 line was" } else { &format!("{set_aside} lines were") };
                let message = format!("{lines} no event and left out of the journal; {} has the journal as it was", kept.display());
                let (seq, since) = (journal.last_fault() + 1, jiff::Timestamp::now().to_string());
                let fault = Fault::new(seq, &fault_table::JOURNAL_DAMAGED, message, since);
                events.push(journal.append(None, None, EventData::FaultRaised(fault))?);
            }
        }
        for Unreadable { run, why } in found.unreadable {
            tracing::error!(run, why, "a run cannot be read; it is left alone");
            events.push(journal.append(None, None, EventData::RunUnreadable(RunUnreadable { run, why }))?);
        }
        Ok((Self { root: root.to_owned(), index, open: found.open, _claim: claim }, journal, events))
    }

    /// The events that a start needs, oldest first: the newest events without views, and the earlier events that are still valid.
    pub fn remembered(&self) -> Result<Vec<Event>, StoreError> {
        let indexed = self.index.remembered(REMEMBERED);
        indexed.map_or_else(|| journal::remembered(&self.root.join(lines::EVENTS), REMEMBERED), Ok)
    }

    /// All events of a run except its views.
    pub fn events_of(&self, run: &str) -> Result<Vec<Event>, StoreError> {
        self.long_work(|| self.read_events_of(run))
    }

    fn read_events_of(&self, run: &str) -> Result<Vec<Event>, StoreError> {
        let own = self.run_folder(run).join(lines::EVENTS);
        let mut events = Vec::new();
        // Early versions wrote no file per run.
        let path = if own.exists() { own } else { self.root.join(lines::EVENTS) };
        journal::each(&path, |event| {
            let is_meant = event.body.run.as_deref() == Some(run) && event.body.data.kind() != kind::VIEW_TAKEN;
            events.extend(is_meant.then_some(event));
        })?;
        Ok(events)
    }

    /// The plates that wait for their turn.
    pub fn queue(&self) -> PlateQueue {
        PlateQueue::open(&self.root)
    }

    /// Why the index lacks something that is on disk. `None` if it is complete. Runs continue in any case.
    pub fn index_trouble(&self) -> Option<String> {
        self.index.trouble()
    }

    /// A reader for use beside the daemon.
    pub fn reader(&self) -> StoreReader {
        StoreReader::new(&self.root)
    }

    pub fn run_folder(&self, run: &str) -> PathBuf {
        self.root.join("runs").join(run)
    }

    /// Work that reads, or writes many files: a thread that waits for it does not hang.
    pub fn long_work<T>(&self, work: impl FnOnce() -> T) -> T {
        disk::watched(false, work)
    }

    pub fn save_run(&self, record: &RunRecord) -> Result<(), StoreError> {
        let folder = self.run_folder(&record.id);
        durable::create_folder(&folder)?;
        durable::write_json(&folder.join(run::FILE), record)?;
        self.index.run(record);
        Ok(())
    }

    /// Removes a run that was not accepted.
    pub fn forget_run(&self, id: &str) -> Result<(), StoreError> {
        let folder = self.run_folder(id);
        for file in [run::FILE, lines::EVENTS].map(|name| folder.join(name)) {
            match disk::remove(&file) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(StoreError::io("remove", &file)(e)),
                _ => {}
            }
        }
        self.index.run_gone(id);
        if folder.is_dir() { durable::sync_folder(&folder) } else { Ok(()) }
    }

    /// The run of this name. `None` if there is none.
    pub fn run(&self, id: &str) -> Result<Option<RunRecord>, StoreError> {
        self.long_work(|| self.reader().run(id))
    }

    /// The runs without an outcome after a crash, oldest first.
    pub fn open_runs(&self) -> Result<Vec<RunRecord>, StoreError> {
        let mut open = Vec::new();
        for id in &self.open {
            open.extend(self.run(id)?.filter(|run| run.outcome.is_none()));
        }
        Ok(open)
    }

    /// The newest run of this mode.
    pub fn newest_run(&self, mode: Mode) -> Result<Option<RunRecord>, StoreError> {
        let query = RunsQuery { limit: 1, mode: index::word(&mode), ..RunsQuery::default() };
        let newest = self.long_work(|| self.reader().runs(&query))?;
        newest.first().map_or(Ok(None), |row| self.run(&row.id))
    }

    /// Free space on the disk of the data folder, bytes.
    pub fn free_bytes(&self) -> Option<u64> {
        // A mount that hangs answers late.
        let s = self.long_work(|| nix::sys::statvfs::statvfs(&self.root)).ok()?;
        Some(s.blocks_available() * s.fragment_size())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_free_at_once_whoever_has_the_lock_open_still() {
        let dir = tempfile::tempdir().unwrap();
        let claim = Claim::on(dir.path()).unwrap();
        assert!(matches!(Claim::on(dir.path()), Err(StoreError::Locked { .. })));
        // As in a child process before it calls `exec`.
        let inherited = claim.lock.try_clone().unwrap();
        drop(claim);
        assert!(Claim::on(dir.path()).is_ok());
        drop(inherited);
    }

    /// A thread that waits for a read does not hang.
    #[test]
    fn what_the_driver_reads_is_watched() {
        let dir = tempfile::tempdir().unwrap();
        let (store, _journal, _events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        let reads: [(&str, &(dyn Fn() + Sync)); 4] = [
            ("free_bytes", &|| assert!(store.free_bytes().is_some())),
            ("run", &|| drop(store.run("r1").unwrap())),
            ("events_of", &|| drop(store.events_of("r1"))),
            ("newest_run", &|| drop(store.newest_run(Mode::Hardware).unwrap())),
        ];
        for (name, read) in reads {
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    let watch = DiskWatch::default();
                    watch.of_this_thread();
                    assert!(watch.idle().is_none());
                    read();
                    assert!(watch.idle().is_some(), "{name}");
                });
            });
        }
    }

    #[test]
    fn what_stands_in_the_place_of_the_runs_is_named() {
        let make = |of: &str, runs: &Path| match of {
            "a link" => std::os::unix::fs::symlink("/tmp", runs).unwrap(),
            "a pipe" => nix::unistd::mkfifo(runs, nix::sys::stat::Mode::S_IRWXU).unwrap(),
            _ => std::fs::write(runs, "").unwrap(),
        };
        for what in ["a link", "a pipe", "a file"] {
            let dir = tempfile::tempdir().unwrap();
            make(what, &dir.path().join("runs"));
            let said = Claim::on(dir.path()).err().unwrap().to_string();
            assert!(said.contains(&format!("found: {what}. ")), "{said}");
        }
    }
}
