//! Bringing the index up to what is on disk; from an empty one that is a rebuild.

use super::rows;
use crate::{RunRecord, StoreError, journal, run};
use carved_records::Event;
use rusqlite::Connection;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// What a look at the run folders found.
#[derive(Debug, Default)]
pub struct Found {
    pub runs: usize,
    /// Runs without an outcome, oldest first.
    pub open: Vec<String>,
    pub unreadable: Vec<Unreadable>,
}

/// A run whose `run.json` cannot be read. It is left alone.
#[derive(Debug)]
pub struct Unreadable {
    pub run: String,
    pub why: String,
}

/// The run folders by name; what begins with a dot is none.
pub(super) fn folders(root: &Path) -> Result<BTreeMap<String, PathBuf>, StoreError> {
    let runs = root.join("runs");
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(&runs).map_err(StoreError::io("list", &runs))? {
        let entry = entry.map_err(StoreError::io("list", &runs))?;
        let file = entry.path().join(run::FILE);
        if let Ok(name) = entry.file_name().into_string()
            && !name.starts_with('.')
            && file.exists()
        {
            found.insert(name, file);
        }
    }
    Ok(found)
}

/// As a refresh finds it, without an index.
pub(super) fn look(root: &Path) -> Result<Found, StoreError> {
    let (mut found, mut open) = (Found::default(), Vec::new());
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

/// For `map_err`: a folder or file that cannot be read, as the index' transaction reports it.
fn unfit(why: impl std::error::Error + Send + Sync + 'static) -> rusqlite::Error {
    rusqlite::Error::ToSqlConversionFailure(Box::new(why))
}

/// Follows the journal and every `run.json` that is not the one that was indexed; forgets runs that are gone.
pub(super) fn all(c: &Connection, root: &Path) -> rusqlite::Result<Found> {
    events(c, &root.join(journal::FILE))?;
    let mut known: BTreeMap<String, (i64, i64)> = c
        .prepare("SELECT id, run_json_ns, run_json_bytes FROM runs")?
        .query_map([], |row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?))))?
        .collect::<Result<_, _>>()?;
    let mut found = Found::default();
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
    found.open = c
        .prepare("SELECT id FROM runs WHERE outcome IS NULL ORDER BY started_us, id")?
        .query_map([], |row| row.get(0))?
        .collect::<Result<_, _>>()?;
    Ok(found)
}

/// The journal from where it was left. Where it does not go on from there it is another one, and all of it is read.
fn events(c: &Connection, path: &Path) -> rusqlite::Result<()> {
    let mut from: u64 = c.query_row("SELECT journal_bytes FROM place", [], |row| row.get(0))?;
    let newest: Option<u64> = c.query_row("SELECT MAX(id) FROM events", [], |row| row.get(0))?;
    if !goes_on(path, from, newest.unwrap_or(0)) {
        c.execute_batch("DELETE FROM events; DELETE FROM faults; UPDATE place SET journal_bytes = 0")?;
        from = 0;
    }
    let Ok(file) = carved_files::open(path) else { return Ok(()) };
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

/// Whether the line that ends at `from` is the event that was indexed last.
pub(super) fn goes_on(path: &Path, from: u64, newest: u64) -> bool {
    if from == 0 {
        return newest == 0;
    }
    let before = || {
        let mut file = carved_files::open(path).ok()?;
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
