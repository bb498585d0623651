//! What outlives the daemon: run folders that are sufficient by themselves, the event journal, and an index over both.
//!
//! ```text
//! DATA/events.jsonl               append-only, synced line by line
//! DATA/index.sqlite               to look things up; made anew from the rest whenever it is missing (see `index`)
//! DATA/calibrations/              what is known of the rig's size (see `calibrations`)
//! DATA/runs/RUN/run.json          plan, method, outcome, one entry per well
//! DATA/runs/RUN/events.jsonl      what happened in this run, as in the journal
//! DATA/runs/RUN/A01/              a recording with its results (see `recording`)
//! DATA/runs/RUN/A01.attempt-1/    an earlier attempt at it (see `attempts`)
//! ```

mod archive;
mod attempts;
mod budget;
pub mod calibrations;
mod disk;
pub mod durable;
mod error;
pub mod frames;
pub mod gates;
mod index;
mod journal;
mod lines;
#[cfg(test)]
mod power_loss;
mod reader;
mod recording;
mod replay;
mod run;
mod schema;
mod sums;
#[cfg(any(test, feature = "testing"))]
pub mod testing;

pub use archive::{Pruned, Receipt, archive, cut_short, end_prune, prune, run_names};
pub use attempts::set_aside;
pub use budget::{Budget, bytes_per_specimen, size};
pub use error::StoreError;
pub use index::{Cursor, EventsAfter, Found, RunRow, RunsQuery, Unreadable, follow_run};
use journal::Repaired;
pub use journal::{Journal, now};
pub use reader::{SpecimenFile, StoreReader, StoredFile, StoredSpecimen};
pub use recording::{
    MEASUREMENT, MeasurementFile, Recording, RecordingReader, RecordingWriter, RigRecord, SecondRecord, Software, fluorescence,
};
pub use replay::ReplayWriter;
pub use run::RunRecord;
pub use sums::{seal, seal_run};

use carved_records::{Event, EventData, JournalRepaired, Mode, RunUnreadable, kind};
use index::Index;
use lines::Lines;
use recording::RECORDING;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Events that are remembered at a start, without the views: those of some three plates of 96 wells.
const REMEMBERED: usize = 4000;

/// A data folder that nobody else uses while this lives. Whoever drives devices takes it before the first of them is opened: another
/// daemon on the same folder has the same instrument, and merely opening a controller's port may reset it in the middle of a move.
pub struct Claim {
    root: PathBuf,
    lock: File,
}

/// Not only by closing it: a child process that is just being started has the open file too, until it becomes its own program.
impl Drop for Claim {
    fn drop(&mut self) {
        if let Err(error) = self.lock.unlock() {
            tracing::debug!(%error, "the data folder's lock ends with its file");
        }
    }
}

impl Claim {
    /// Takes the folder, which is created where it is not there.
    ///
    /// # Errors
    /// Another carved has it, or it cannot be written.
    pub fn on(root: &Path) -> Result<Self, StoreError> {
        durable::create_folder(&root.join("runs"))?;
        let path = root.join("lock");
        let lock = File::create(&path).map_err(StoreError::io("create", &path))?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { root: root.to_owned(), lock }),
            Err(std::fs::TryLockError::WouldBlock) => Err(StoreError::Locked { path: root.to_owned() }),
            Err(std::fs::TryLockError::Error(e)) => Err(StoreError::io("lock", &path)(e)),
        }
    }
}

/// The data folder, held by one daemon at a time.
pub struct Store {
    root: PathBuf,
    index: Arc<Index>,
    /// Runs that were found without an outcome when the folder was opened.
    open: Vec<String>,
    _claim: Claim,
}

/// Makes the index of a data folder that no daemon uses anew from its run folders.
pub fn rebuild_index(root: &Path) -> Result<Found, StoreError> {
    let _claim = Claim::on(root)?;
    index::rebuild(root).map(|(_, found)| found)
}

impl Store {
    /// Opens or creates what the data folder holds: its journal and its index. A run whose `run.json` cannot be read is told, in the log
    /// and as an event, and left alone.
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
        let path = root.join(journal::FILE);
        let mut lines = Lines::open(&path)?;
        let (from_byte, newest) = index::followed(root);
        let repaired = if journal::is_in_order(&path, from_byte, newest)? {
            None
        } else {
            let repaired = journal::repair(root)?;
            // It has the ids of before.
            index::remove(root)?;
            lines = Lines::open(&path)?;
            Some(repaired)
        };
        let (index, found) = Index::open(root)?;
        let index = Arc::new(index);
        let (mut journal, mut events) = Journal::open(root, lines, index.clone())?;
        if let Some(Repaired { kept, renumbered }) = repaired {
            tracing::error!(renumbered, kept = %kept.display(), "ids in the journal did not rise; its events were numbered on, none is lost");
            let kept = kept.file_name().unwrap_or_default().to_string_lossy().into_owned();
            events.push(journal.append(None, None, EventData::JournalRepaired(JournalRepaired { renumbered, kept }))?);
        }
        for Unreadable { run, why } in found.unreadable {
            tracing::error!(run, why, "a run cannot be read; it is left alone");
            events.push(journal.append(None, None, EventData::RunUnreadable(RunUnreadable { run, why }))?);
        }
        Ok((Self { root: root.to_owned(), index, open: found.open, _claim: claim }, journal, events))
    }

    /// What of the journal a start has to know, oldest first: of the newest events all but the views, of before what still means
    /// something.
    pub fn remembered(&self) -> Result<Vec<Event>, StoreError> {
        let indexed = self.index.remembered(REMEMBERED);
        indexed.map_or_else(|| journal::remembered(&self.root.join(journal::FILE), REMEMBERED), Ok)
    }

    /// All that happened in a run but its views.
    pub fn events_of(&self, run: &str) -> Result<Vec<Event>, StoreError> {
        let own = self.run_folder(run).join(journal::FILE);
        let mut events = Vec::new();
        // Runs of before the files of runs have none.
        let path = if own.exists() { own } else { self.root.join(journal::FILE) };
        journal::each(&path, |event| {
            let is_meant = event.body.run.as_deref() == Some(run) && event.body.data.kind() != kind::VIEW_TAKEN;
            events.extend(is_meant.then_some(event));
        })?;
        Ok(events)
    }

    /// Why the index does not hold all that is on disk, where it does not. Runs go on all the same.
    pub fn index_trouble(&self) -> Option<String> {
        self.index.trouble()
    }

    /// For everyone who reads beside the daemon.
    pub fn reader(&self) -> StoreReader {
        StoreReader::new(&self.root)
    }

    pub fn run_folder(&self, run: &str) -> PathBuf {
        self.root.join("runs").join(run)
    }

    pub fn save_run(&self, record: &RunRecord) -> Result<(), StoreError> {
        let folder = self.run_folder(&record.id);
        durable::create_folder(&folder)?;
        durable::write_json(&folder.join(run::FILE), record)?;
        self.index.run(record);
        Ok(())
    }

    /// Takes back a run that was not accepted after all.
    pub fn forget_run(&self, id: &str) -> Result<(), StoreError> {
        let folder = self.run_folder(id);
        for file in [run::FILE, journal::FILE].map(|name| folder.join(name)) {
            match disk::remove(&file) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(StoreError::io("remove", &file)(e)),
                _ => {}
            }
        }
        self.index.run_gone(id);
        if folder.is_dir() { durable::sync_folder(&folder) } else { Ok(()) }
    }

    /// The run of this name, if there is one.
    pub fn run(&self, id: &str) -> Result<Option<RunRecord>, StoreError> {
        self.reader().run(id)
    }

    /// What a crash left open, oldest first.
    pub fn open_runs(&self) -> Result<Vec<RunRecord>, StoreError> {
        let mut open = Vec::new();
        for id in &self.open {
            open.extend(self.run(id)?.filter(|run| run.outcome.is_none()));
        }
        open.sort_by(|a, b| a.started.cmp(&b.started));
        Ok(open)
    }

    /// The run of instruments, or of simulations, that was started last.
    pub fn newest_run(&self, mode: Mode) -> Result<Option<RunRecord>, StoreError> {
        let newest = self.reader().runs(&RunsQuery { limit: 1, mode: index::word(&mode), ..RunsQuery::default() })?;
        newest.first().map_or(Ok(None), |row| self.run(&row.id))
    }

    /// Free space where the data are, bytes.
    pub fn free_bytes(&self) -> Option<u64> {
        let s = nix::sys::statvfs::statvfs(&self.root).ok()?;
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
        // As a child process does until it becomes its own program.
        let inherited = claim.lock.try_clone().unwrap();
        drop(claim);
        assert!(Claim::on(dir.path()).is_ok());
        drop(inherited);
    }
}
