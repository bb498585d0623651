//! Updates the index from the folders. From an empty index this is a rebuild.

use super::{query, rows};
use crate::{RunRecord, StoreError, lines, run};
use carved_records::Event;
use rusqlite::Connection;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The result of a scan of the run folders.
#[derive(Debug, Default)]
pub struct RunScan {
    pub runs: usize,
    /// Runs without an outcome, oldest first.
    pub open: Vec<String>,
    pub unreadable: Vec<Unreadable>,
}

/// A run whose `run.json` cannot be read. It is not changed.
#[derive(Debug)]
pub struct Unreadable {
    pub run: String,
    pub why: String,
}

/// The run folders by name. Names that begin with a dot are skipped, and so are links to folders.
pub(super) fn folders(root: &Path) -> Result<BTreeMap<String, PathBuf>, StoreError> {
    let runs = root.join("runs");
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(&runs).map_err(StoreError::io("list", &runs))? {
        let entry = entry.map_err(StoreError::io("list", &runs))?;
        let file = entry.path().join(run::FILE);
        if let Ok(name) = entry.file_name().into_string()
            && !name.starts_with('.')
            && entry.file_type().is_ok_and(|kind| kind.is_dir())
            && file.symlink_metadata().is_ok()
        {
            found.insert(name, file);
        }
    }
    Ok(found)
}

/// Scans the run folders without an index.
pub(super) fn look(root: &Path) -> Result<RunScan, StoreError> {
    let (mut found, mut open) = (RunScan::default(), Vec::new());
    for (name, file) in folders(root)? {
        match RunRecord::read(&file) {
            Ok(record) => open.extend(record.outcome.is_none().then_some((record.started, name))),
            Err(why) => found.unreadable.push(Unreadable { run: name, why: why.to_string() }),
        }
        found.runs += 1;
    }
    open.sort();
    found.open = open.into_iter().map(|(_, name)| name).collect();
    Ok(found)
}

/// For `map_err`: an I/O error as an error of the index transaction.
fn unfit(why: impl std::error::Error + Send + Sync + 'static) -> rusqlite::Error {
    rusqlite::Error::ToSqlConversionFailure(Box::new(why))
}

/// Follows the journal and every changed `run.json`. Removes runs whose folders are missing.
pub(super) fn all(c: &Connection, root: &Path) -> rusqlite::Result<RunScan> {
    events(c, &root.join(lines::EVENTS))?;
    let mut known: BTreeMap<String, (i64, i64)> = c
        .prepare("SELECT id, run_json_ns, run_json_bytes FROM runs")?
        .query_map([], |row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?))))?
        .collect::<Result<_, _>>()?;
    let mut found = RunScan::default();
    for (name, file) in folders(root).map_err(unfit)? {
        found.runs += 1;
        if known.remove(&name) == Some(rows::stamp(&file)) {
            continue;
        }
        match RunRecord::read(&file) {
            Ok(record) => rows::put_run(c, root, &record, true)?,
            Err(why) => {
                rows::remove_run(c, &name)?;
                found.unreadable.push(Unreadable { run: name, why: why.to_string() });
            }
        }
    }
    for gone in known.keys() {
        rows::remove_run(c, gone)?;
    }
    found.open = query::open(c)?;
    Ok(found)
}

/// Reads the journal from the last position. If the journal is another one, all of it is read.
fn events(c: &Connection, path: &Path) -> rusqlite::Result<()> {
    let mut from: u64 = c.query_row("SELECT journal_bytes FROM place", [], |row| row.get(0))?;
    let newest: Option<u64> = c.query_row("SELECT MAX(id) FROM events", [], |row| row.get(0))?;
    if !goes_on(path, from, newest.unwrap_or(0)) {
        c.execute_batch("DELETE FROM events; DELETE FROM faults; UPDATE place SET journal_bytes = 0")?;
        from = 0;
    }
    let Ok(file) = carved_files::open_own_to_read(path) else { return Ok(()) };
    let mut reader = BufReader::new(file);
    reader.seek(SeekFrom::Start(from)).map_err(unfit)?;
    let mut line = Vec::new();
    loop {
        line.clear();
        if reader.read_until(b'\n', &mut line).map_err(unfit)? == 0 || line.last() != Some(&b'\n') {
            return Ok(());
        }
        from += line.len() as u64;
        match serde_json::from_slice::<Event>(&line) {
            Ok(event) => rows::put_event(c, &event, from)?,
            Err(error) => {
                tracing::warn!(%error, path = %path.display(), before_byte = from, "a line of the journal is no event and is passed over");
            }
        }
    }
}

/// Whether the line that ends at `from` is the last indexed event.
pub(super) fn goes_on(path: &Path, from: u64, newest: u64) -> bool {
    if from == 0 {
        return newest == 0;
    }
    let before = || {
        let mut file = carved_files::open_own_to_read(path).ok()?;
        let length = from.min(1024 * 1024);
        (file.metadata().ok()?.len() >= from).then_some(())?;
        file.seek(SeekFrom::Start(from - length)).ok()?;
        let mut text = vec![0; length as usize];
        std::io::Read::read_exact(&mut file, &mut text).ok()?;
        let line = text.strip_suffix(b"\n")?.rsplit(|&b| b == b'\n').next()?;
        serde_json::from_slice::<Event>(line).ok().map(|event| event.id)
    };
    before() == Some(newest)
}
