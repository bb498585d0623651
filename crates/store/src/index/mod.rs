//! `DATA/index.sqlite`: runs, wells, specimens, numbers, beads, faults and events, to be looked up without opening every folder.
//!
//! ```text
//! run folders, events.jsonl ──── the truth
//!        │ each write is followed here, in one transaction (WAL, synchronous NORMAL: after a power loss it may lack the newest)
//!        ▼
//!   index.sqlite ──── refreshed at a start: what was written since, by length of the journal and stamp of each run.json
//!        │            missing or broken: made anew from the folders
//!        ▼
//!   readers (`reader`), each with a connection of its own
//! ```
//! It is an index: a write to it that fails is told in the log and stops nothing. From then on it is *behind*, says so
//! ([`Index::trouble`]), and further writes try to bring it up to the folders first, each [`AGAIN`] at most.

mod query;
mod refresh;
mod rows;
mod tables;
#[cfg(test)]
mod tests;

pub use query::{Cursor, EventsAfter, RunRow, RunsQuery};
pub(super) use query::{events_after, runs, used_bytes, views, was_accepted};
pub use refresh::{Found, Unreadable};
pub(super) use rows::word;

use super::{RunRecord, StoreError, durable};
use carved_records::Event;
use rusqlite::{Connection, Transaction, TransactionBehavior};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

const FILE: &str = "index.sqlite";

/// How long another program (`carved prune`) may hold the index before it is told to be behind.
const BUSY: Duration = Duration::from_millis(500);

/// How often it is tried to bring up an index that is behind: all run folders are looked at for it, and a run waits.
const AGAIN: Duration = Duration::from_secs(60);

/// The writing end; one per daemon.
pub struct Index {
    root: PathBuf,
    state: Mutex<State>,
}

struct State {
    connection: Option<Connection>,
    /// Why what is on disk is not all in it, if so.
    behind: Option<String>,
    /// When it is brought up the next time; the first try comes at once.
    again: Instant,
}

impl Index {
    /// Opens the index and brings it up to the folders, or makes it anew from them.
    ///
    /// # Errors
    /// Only where a newer carved made it: this one must not work in a folder of which it does not know all.
    pub fn open(root: &Path) -> Result<(Self, Found), StoreError> {
        let path = root.join(FILE);
        let opened = if path.exists() {
            match existing(root) {
                Err(StoreError::Index { source, .. }) => {
                    tracing::warn!(error = %source, path = %path.display(), "the index is broken and is made anew from the run folders");
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

    /// Why it does not hold all that is on disk, where it does not.
    pub fn trouble(&self) -> Option<String> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).behind.clone()
    }

    /// Sequence number of the newest fault; none where the index cannot say.
    pub fn last_fault(&self) -> Option<u64> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let connection = state.connection.as_ref().filter(|_| state.behind.is_none())?;
        connection.query_row("SELECT COALESCE(MAX(seq), 0) FROM faults", [], |row| row.get(0)).ok()
    }

    /// What of the journal a start has to know, its newest `most` events among it; nothing where the index cannot say.
    pub fn remembered(&self, most: usize) -> Option<Vec<Event>> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let connection = state.connection.as_ref().filter(|_| state.behind.is_none())?;
        query::remembered(connection, most).inspect_err(|error| tracing::warn!(%error, "the index remembers nothing")).ok()
    }

    /// An event that is on disk; the journal is so long with it.
    pub fn event(&self, event: &Event, journal_bytes: u64) {
        self.follow(|tx, _| rows::put_event(tx, event, journal_bytes));
    }

    /// A run that is on disk: what of its wells changed is read from their folders.
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
        let done = in_one(connection, |tx| {
            // What is to be written is on disk already, so that the refresh has it too.
            if was_behind { refresh::all(tx, &self.root).map(|_| ()) } else { work(tx, &self.root) }
        });
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

fn connect(path: &Path) -> Result<Connection, StoreError> {
    let prepare = || {
        let connection = Connection::open(path)?;
        connection.busy_timeout(BUSY)?;
        connection.pragma_update(None, "journal_mode", "WAL")?;
        connection.pragma_update(None, "synchronous", "NORMAL")?;
        Ok(connection)
    };
    prepare().map_err(failed("open", path))
}

fn existing(root: &Path) -> Result<(Connection, Found), StoreError> {
    let path = root.join(FILE);
    let mut connection = connect(&path)?;
    tables::migrate(&mut connection, &path)?;
    let found = in_one(&mut connection, |tx| refresh::all(tx, root)).map_err(failed("be brought up to the run folders", &path))?;
    Ok((connection, found))
}

/// How far the index has followed the journal: to which byte, and to which event. Nowhere where it cannot say, or where the journal does
/// not go on from there.
pub(super) fn followed(root: &Path) -> (u64, u64) {
    let (bytes, newest) = query::followed(root).unwrap_or_default();
    if refresh::goes_on(&root.join(super::journal::FILE), bytes, newest) { (bytes, newest) } else { (0, 0) }
}

/// Removes the index; the next that opens it makes it anew.
pub(super) fn remove(root: &Path) -> Result<(), StoreError> {
    removed(&root.join(FILE))
}

/// A database with its log, where it is there.
fn removed(path: &Path) -> Result<(), StoreError> {
    for end in ["", "-wal", "-shm"] {
        let path = path.with_file_name(format!("{}{end}", path.file_name().unwrap_or_default().display()));
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

/// A run that another program than the daemon has added, has taken files of, or has removed: its rows follow, where there is an index.
///
/// # Errors
/// The index or the run's record cannot be read. The folder is as it was.
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

/// Makes the index from the folders, beside its place, and puts it there whole.
pub(super) fn rebuild(root: &Path) -> Result<(Connection, Found), StoreError> {
    let path = root.join(FILE);
    let new = root.join("index.sqlite.new");
    removed(&new)?;
    let mut connection = connect(&new)?;
    tables::migrate(&mut connection, &new)?;
    let found = in_one(&mut connection, |tx| refresh::all(tx, root)).map_err(failed("be made", &new))?;
    // Closing it takes its log in.
    connection.close().map_err(|(_, e)| failed("be closed", &new)(e))?;
    removed(&path)?;
    std::fs::rename(&new, &path).map_err(StoreError::io("rename", &new))?;
    durable::sync_folder(root)?;
    Ok((connect(&path)?, found))
}
