//! `DATA/index.sqlite`: an index of runs, specimens, faults and events. Lookups do not open every folder.
//!
//! ```text
//! run folders, events.jsonl ──── the source of truth
//!        │ each write is followed by a transaction here (WAL, synchronous NORMAL: a power loss may drop the newest ones)
//!        ▼
//!   index.sqlite ──── updated at a start by the length of the journal and the stamp of each run.json
//!        │            rebuilt from the folders if it is missing or broken
//!        ▼
//!   readers (`reader`), each with its own connection
//! ```
//! A write to the index that fails is logged and stops nothing. From then on the index is *behind* and reports this ([`Index::trouble`]).
//! Later writes first try to update it from the folders, at most once per [`AGAIN`].

mod cells;
mod query;
mod refresh;
mod rows;
mod tables;
#[cfg(test)]
mod tests;

pub use query::{Cursor, EventsAfter, RunRow, RunsQuery};
pub(super) use query::{events_after, events_of, runs, used_bytes, views, was_accepted};
pub use refresh::{RunScan, Unreadable};
pub(super) use rows::word;

use super::{RunRecord, StoreError, disk, durable};
use carved_records::Event;
use rusqlite::{Connection, Transaction, TransactionBehavior};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

const FILE: &str = "index.sqlite";

/// How long to wait for another program (`carved prune`) that locks the index, before the index counts as behind.
const BUSY: Duration = Duration::from_millis(500);

/// Interval of the attempts to update an index that is behind. Each attempt reads all run folders, and a run waits for it.
const AGAIN: Duration = Duration::from_secs(60);

/// The writer of the index. There is one per daemon.
pub struct Index {
    root: PathBuf,
    state: Mutex<State>,
}

struct State {
    connection: Option<Connection>,
    /// Why the index lacks something that is on disk. `None` if it is complete.
    behind: Option<String>,
    /// When the index is updated next. The first attempt is immediate.
    again: Instant,
}

impl Index {
    /// Opens the index and updates it from the folders, or rebuilds it.
    ///
    /// # Errors
    /// A newer carved wrote the index. This version must not work in a folder that it does not fully know.
    pub fn open(root: &Path) -> Result<(Self, RunScan), StoreError> {
        let path = root.join(FILE);
        let opened = if path.symlink_metadata().is_ok() {
            match existing(root) {
                Err(error @ (StoreError::Index { .. } | StoreError::Io { .. })) => {
                    tracing::warn!(%error, path = %path.display(), "the index is broken and is made anew from the run folders");
                    rebuild(root)
                }
                other => other,
            }
        } else {
            tracing::info!(path = %path.display(), "the index is made from the run folders");
            rebuild(root)
        };
        let (connection, found, behind) = match opened {
            Ok((connection, found)) => (Some(connection), found, None),
            Err(newer @ StoreError::Newer { .. }) => return Err(newer),
            Err(error) => {
                tracing::error!(%error, "no index; runs go on without it");
                (None, refresh::look(root)?, Some(error.to_string()))
            }
        };
        Ok((Self { root: root.to_owned(), state: Mutex::new(State { connection, behind, again: Instant::now() }) }, found))
    }

    /// Why the index lacks something that is on disk. `None` if it is complete.
    pub fn trouble(&self) -> Option<String> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).behind.clone()
    }

    /// Sequence number of the newest fault. `None` if the index is not usable.
    pub fn last_fault(&self) -> Option<u64> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let connection = state.connection.as_ref().filter(|_| state.behind.is_none())?;
        connection.query_row("SELECT COALESCE(MAX(seq), 0) FROM faults", [], |row| row.get(0)).ok()
    }

    /// The events that a start needs, with the newest `most` events of the journal. `None` if the index is not usable.
    pub fn remembered(&self, most: usize) -> Option<Vec<Event>> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let connection = state.connection.as_ref().filter(|_| state.behind.is_none())?;
        query::remembered(connection, most).inspect_err(|error| tracing::warn!(%error, "the index remembers nothing")).ok()
    }

    /// Adds an event that is on disk. `journal_bytes`: length of the journal including this event.
    pub fn event(&self, event: &Event, journal_bytes: u64) {
        self.follow(|tx, _| rows::put_event(tx, event, journal_bytes));
    }

    /// Adds or updates a run that is on disk. The folders of changed wells are read.
    pub fn run(&self, record: &RunRecord) {
        self.follow(|tx, root| rows::put_run(tx, root, record, false));
    }

    pub fn run_gone(&self, id: &str) {
        self.follow(|tx, _| rows::remove_run(tx, id));
    }

    fn follow(&self, work: impl FnOnce(&Transaction, &Path) -> rusqlite::Result<()>) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { connection, behind, again } = &mut *state;
        let Some(connection) = connection else { return };
        let was_behind = behind.is_some();
        if was_behind && Instant::now() < *again {
            return;
        }
        let update = |tx: &Transaction| {
            // The write is on disk already, so the refresh includes it.
            if was_behind { refresh::all(tx, &self.root).map(|_| ()) } else { work(tx, &self.root) }
        };
        let done = disk::watched(false, || in_one(connection, update));
        match done {
            Ok(()) if was_behind => {
                tracing::info!("the index is up to the run folders again");
                *behind = None;
            }
            Ok(()) => {}
            Err(error) if was_behind => {
                tracing::debug!(%error, "the index is still behind");
                *again = Instant::now() + AGAIN;
            }
            Err(error) => {
                tracing::error!(%error, "the index is behind; runs go on, and the next write or start brings it up again");
                *behind = Some(error.to_string());
            }
        }
    }
}

impl Drop for Index {
    /// The database syncs when it is closed, which can take as long as any other write.
    fn drop(&mut self) {
        let state = self.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        disk::watched(false, || drop(state.connection.take()));
    }
}

fn in_one<T>(connection: &mut Connection, work: impl FnOnce(&Transaction) -> rusqlite::Result<T>) -> rusqlite::Result<T> {
    let tx = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    let done = work(&tx)?;
    tx.commit()?;
    Ok(done)
}

/// For `map_err`.
fn failed(what: &'static str, path: &Path) -> impl Fn(rusqlite::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::Index { what, path: path.clone(), source }
}

/// Checks that neither the database nor its log is a pipe, which `SQLite` would wait for, or a link.
fn check_own(path: &Path) -> Result<(), StoreError> {
    for path in ends(path) {
        match path.symlink_metadata() {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            found => found.and_then(|found| carved_files::check(found.file_type())).map_err(StoreError::io("open", &path))?,
        }
    }
    Ok(())
}

/// A database and its log.
fn ends(path: &Path) -> [PathBuf; 3] {
    ["", "-wal", "-shm"].map(|end| path.with_file_name(format!("{}{end}", path.file_name().unwrap_or_default().display())))
}

fn connect(path: &Path) -> Result<Connection, StoreError> {
    check_own(path)?;
    let prepare = || {
        let connection = Connection::open(path)?;
        connection.busy_timeout(BUSY)?;
        connection.pragma_update(None, "journal_mode", "WAL")?;
        connection.pragma_update(None, "synchronous", "NORMAL")?;
        Ok(connection)
    };
    prepare().map_err(failed("open", path))
}

fn existing(root: &Path) -> Result<(Connection, RunScan), StoreError> {
    let path = root.join(FILE);
    let mut connection = connect(&path)?;
    tables::migrate(&mut connection, &path)?;
    let found = in_one(&mut connection, |tx| refresh::all(tx, root)).map_err(failed("be brought up to the run folders", &path))?;
    Ok((connection, found))
}

/// How far the index has followed the journal: the byte, and the id of the event. Both are 0 if the index is not usable or belongs to
/// another journal.
pub(super) fn followed(root: &Path) -> (u64, u64) {
    let (bytes, newest) = query::followed(root).unwrap_or_default();
    if refresh::goes_on(&root.join(super::lines::EVENTS), bytes, newest) { (bytes, newest) } else { (0, 0) }
}

/// Removes the index. It is rebuilt when it is opened next.
pub(super) fn remove(root: &Path) -> Result<(), StoreError> {
    removed(&root.join(FILE))
}

/// Removes a database with its log, if it exists.
fn removed(path: &Path) -> Result<(), StoreError> {
    for path in ends(path) {
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(StoreError::io("remove", &path)(e)),
            _ => {}
        }
    }
    Ok(())
}

/// Names of the run folders.
pub(super) fn run_names(root: &Path) -> Result<Vec<String>, StoreError> {
    Ok(refresh::folders(root)?.into_keys().collect())
}

/// Updates the rows of a run that another program has added, pruned or removed. Does nothing without an index.
///
/// # Errors
/// The index or the run's record cannot be read. The index is unchanged.
pub fn follow_run(root: &Path, id: &str) -> Result<(), StoreError> {
    let path = root.join(FILE);
    if !path.exists() {
        return Ok(());
    }
    let mut connection = connect(&path)?;
    tables::migrate(&mut connection, &path)?;
    let file = root.join("runs").join(id).join(super::run::FILE);
    let record = if file.exists() { Some(RunRecord::read(&file)?) } else { None };
    let follow = |tx: &Transaction| match &record {
        Some(record) => rows::put_run(tx, root, record, true),
        None => rows::remove_run(tx, id),
    };
    in_one(&mut connection, follow).map_err(failed("follow the run's folder; carved index rebuild makes it anew", &path))
}

/// Rebuilds the index from the folders in a temporary file, then renames it.
pub(super) fn rebuild(root: &Path) -> Result<(Connection, RunScan), StoreError> {
    let path = root.join(FILE);
    let new = root.join("index.sqlite.new");
    removed(&new)?;
    let mut connection = connect(&new)?;
    tables::migrate(&mut connection, &new)?;
    let found = in_one(&mut connection, |tx| refresh::all(tx, root)).map_err(failed("be made", &new))?;
    // Closing the connection writes its log into the database.
    connection.close().map_err(|(_, e)| failed("be closed", &new)(e))?;
    removed(&path)?;
    std::fs::rename(&new, &path).map_err(StoreError::io("rename", &new))?;
    durable::sync_folder(root)?;
    Ok((connect(&path)?, found))
}
