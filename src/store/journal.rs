//! The append-only event journal: one JSON object per line, synced before anyone hears of it. What happens in a run stands in
//! the run's own folder as well.
//!
//! ```text
//! append ─> DATA/events.jsonl ─> DATA/runs/RUN/events.jsonl ─> the event counts ─> index
//!               synced               synced                                        follows by itself
//! ```
//! A crash between the two leaves the run's file one line short: the next start adds it.

use super::index::Index;
use super::lines::Lines;
use super::{StoreError, durable};
use crate::session::{Event, kind};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(super) const FILE: &str = "events.jsonl";

/// What still means something however long ago it was.
const LASTING: [&str; 8] = [
    kind::FAULT_RAISED,
    kind::FAULT_ACKNOWLEDGED,
    kind::FAULT_CLEARED,
    kind::PLATE_ANNOUNCED,
    kind::PLATE_LOADED,
    kind::PLATE_UNLOADED,
    kind::PLATE_HANDOFF_ABORTED,
    kind::RUN_ACCEPTED,
];

/// Events that are read at a start, for readers that come back.
const TAIL: usize = 2000;

/// What happened, as it is to be written; at its own time, not at the one when the disk took it.
#[derive(Debug, Clone, PartialEq)]
pub struct Happening {
    time: String,
    kind: String,
    run: Option<String>,
    well: Option<String>,
    data: serde_json::Value,
}

impl Happening {
    pub fn now(kind: &str, run: Option<&str>, well: Option<&str>, data: serde_json::Value) -> Self {
        let time = jiff::Timestamp::now().to_string();
        Self { time, kind: kind.to_owned(), run: run.map(str::to_owned), well: well.map(str::to_owned), data }
    }
}

pub struct Journal {
    all: Lines,
    runs: PathBuf,
    /// The run that was told of last, and its file.
    of_run: Option<(String, Lines)>,
    next_id: u64,
    /// Sequence number of the newest fault.
    last_fault: u64,
    index: Arc<Index>,
}

impl Journal {
    /// Opens or creates the journal of a data folder and reads its end. A line there that is not an event is an error, not
    /// skipped.
    pub(super) fn open(root: &Path, all: Lines, index: Arc<Index>) -> Result<(Self, Vec<Event>), StoreError> {
        let path = root.join(FILE);
        let tail: Vec<Event> = all.tail(TAIL)?.iter().map(|line| parse(&path, line)).collect::<Result<_, _>>()?;
        let next_id = tail.last().map_or(1, |e| e.id + 1);
        let last_fault = match index.last_fault() {
            Some(seq) => seq,
            None => last_fault(&path)?,
        };
        let mut journal = Self { all, runs: root.join("runs"), of_run: None, next_id, last_fault, index };
        if let Some(last) = tail.last() {
            journal.mend(last)?;
        }
        Ok((journal, tail))
    }

    pub fn last_fault(&self) -> u64 {
        self.last_fault
    }

    /// Adds the last event to its run's file where a crash came between the two.
    fn mend(&mut self, last: &Event) -> Result<(), StoreError> {
        let Some(run) = last.run.as_deref() else { return Ok(()) };
        let folder = self.runs.join(run);
        // Runs of before the files of runs have none; one that was taken away is not to come back.
        if !folder.is_dir() || !folder.join(FILE).exists() && last.kind != kind::RUN_ACCEPTED {
            return Ok(());
        }
        let newest = self.of_run(run)?.tail(1)?.first().and_then(|line| serde_json::from_slice::<Event>(line).ok());
        if newest.is_none_or(|e| e.id < last.id) { self.append_of_run(run, &line_of(last)?) } else { Ok(()) }
    }

    fn of_run(&mut self, run: &str) -> Result<&mut Lines, StoreError> {
        let folder = self.runs.join(run);
        // A run that was not accepted after all has taken its file with it.
        if self.of_run.as_ref().is_none_or(|(of, _)| of != run || !folder.join(FILE).exists()) {
            durable::create_folder(&folder)?;
            self.of_run = Some((run.to_owned(), Lines::open(&folder.join(FILE))?));
        }
        match &mut self.of_run {
            Some((_, lines)) => Ok(lines),
            None => Err(StoreError::Vanished { path: folder }),
        }
    }

    fn append_of_run(&mut self, run: &str, line: &[u8]) -> Result<(), StoreError> {
        let lines = self.of_run(run)?;
        lines.append(line)?;
        lines.keep(line);
        Ok(())
    }

    /// Writes what happens now, as [`Self::write`] does.
    pub fn append(&mut self, kind: &str, run: Option<&str>, well: Option<&str>, data: serde_json::Value) -> Result<Event, StoreError> {
        self.write(&Happening::now(kind, run, well, data))
    }

    /// Writes an event and syncs it; the id it got comes back with it.
    pub fn write(&mut self, happening: &Happening) -> Result<Event, StoreError> {
        let Happening { time, kind, run, well, data } = happening.clone();
        let event = Event { id: self.next_id, time, kind, run, well, data };
        let run = event.run.as_deref();
        let line = line_of(&event)?;
        self.all.append(&line).and_then(|()| run.map_or(Ok(()), |run| self.append_of_run(run, &line))).inspect_err(|_| {
            // Not acknowledged, so it is better gone; where that fails too the next line takes its place.
            self.all.drop_rest();
            self.of_run.iter_mut().for_each(|(_, lines)| lines.drop_rest());
        })?;
        self.all.keep(&line);
        self.next_id += 1;
        self.index.event(&event, self.all.good_bytes());
        Ok(event)
    }
}

fn parse(path: &Path, line: &[u8]) -> Result<Event, StoreError> {
    serde_json::from_slice(line).map_err(|e| StoreError::Format {
        path: path.to_owned(),
        expected: "one event per line",
        found: format!("{:?}: {e}", String::from_utf8_lossy(&line[..line.len().min(80)])),
    })
}

fn line_of(event: &Event) -> Result<Vec<u8>, StoreError> {
    let mut line = serde_json::to_vec(event).map_err(|e| StoreError::Format {
        path: FILE.into(),
        expected: "an event JSON can hold",
        found: e.to_string(),
    })?;
    line.push(b'\n');
    Ok(line)
}

/// The events of a journal one by one, those that are whole; it may be longer than memory.
pub(super) fn each(path: &Path, mut take: impl FnMut(Event)) -> Result<(), StoreError> {
    let io = |what| StoreError::io(what, path);
    for line in BufReader::new(File::open(path).map_err(io("open"))?).split(b'\n') {
        if let Ok(event) = serde_json::from_slice(&line.map_err(io("read"))?) {
            take(event);
        }
    }
    Ok(())
}

/// Where the index cannot say it: the newest fault of the whole journal.
fn last_fault(path: &Path) -> Result<u64, StoreError> {
    let mut newest = 0;
    each(path, |e| newest = newest.max(if e.kind == kind::FAULT_RAISED { e.data["seq"].as_u64().unwrap_or(0) } else { 0 }))?;
    Ok(newest)
}

/// Where the index cannot say it: the newest `most` events without the views, and of before all on faults, plates and runs' beginnings.
pub(super) fn remembered(path: &Path, most: usize) -> Result<Vec<Event>, StoreError> {
    let (mut lasting, mut newest) = (Vec::new(), VecDeque::new());
    each(path, |event| {
        if event.kind == kind::VIEW_TAKEN {
            return;
        }
        if newest.len() == most {
            lasting.extend(newest.pop_front().filter(|e: &Event| LASTING.contains(&e.kind.as_str())));
        }
        newest.push_back(event);
    })?;
    lasting.extend(newest);
    Ok(lasting)
}

#[cfg(test)]
mod tests {
    use crate::store::{Claim, Store};
    use serde_json::{Value, json};
    use std::fs::OpenOptions;
    use std::io::Write;

    #[test]
    fn ids_last_across_restarts_and_a_torn_line_is_cut() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("events.jsonl");
        let (store, mut journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert!(events.is_empty());
        journal.append("a", None, None, json!({"x": 1})).unwrap();
        journal.append("b", Some("r"), Some("A01"), Value::Null).unwrap();
        drop((store, journal));
        OpenOptions::new().append(true).open(&path).unwrap().write_all(b"{\"id\": 3, \"tim").unwrap();

        let (store, mut journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!(events.iter().map(|e| e.id).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(journal.append("c", None, None, Value::Null).unwrap().id, 3);
        drop((store, journal));
        let (_store, _journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!(events.len(), 3);
        assert_eq!(events[2].kind, "c");
    }

    /// The newest fault may lie far before the tail.
    #[test]
    fn a_start_reads_the_end_of_a_long_journal_and_knows_its_newest_fault() {
        let dir = tempfile::tempdir().unwrap();
        let line = |id: u64, kind: &str| {
            format!("{}\n", json!({"id": id, "time": "2026-01-01T00:00:00Z", "kind": kind, "run": null, "well": null, "data": {"seq": 41}}))
        };
        let text: String = (1..=5000).map(|id| line(id, if id == 7 { "fault.raised" } else { "x" })).collect();
        std::fs::write(dir.path().join("events.jsonl"), &text).unwrap();
        drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
        // Indexed once, what lies before the tail is not looked at again.
        std::fs::write(dir.path().join("events.jsonl"), text.replacen("fault.raised", "xxxxx.xxxxxx", 1)).unwrap();
        let (_store, mut journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!((journal.last_fault(), events.len(), events[0].id), (41, 2000, 3001));
        assert_eq!(journal.append("y", None, None, Value::Null).unwrap().id, 5001);
    }

    #[test]
    fn a_broken_line_at_the_end_is_named() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("events.jsonl"), "nonsense\n").unwrap();
        let error = Claim::on(dir.path()).and_then(Store::open).err().unwrap().to_string();
        assert!(error.contains("events.jsonl") && error.contains("nonsense"), "{error}");
    }
}
