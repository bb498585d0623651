//! The append-only event journal: one JSON object per line, synced before anyone hears of it.

use super::{StoreError, durable};
use crate::session::Event;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

pub struct Journal {
    file: File,
    path: PathBuf,
    next_id: u64,
    /// Length up to which every line is whole and synced.
    good_bytes: u64,
    /// Sequence number of the newest fault.
    last_fault: u64,
}

impl Journal {
    /// Opens or creates the journal and reads what it holds. A last line that a crash tore is cut off: it was never
    /// acknowledged. Any other line that is not an event is an error, not skipped.
    pub fn open(path: &Path) -> Result<(Self, Vec<Event>), StoreError> {
        let io = |what| move |source| StoreError::Io { what, path: path.to_owned(), source };
        let mut file = OpenOptions::new().read(true).append(true).create(true).open(path).map_err(io("open"))?;
        let mut text = Vec::new();
        file.read_to_end(&mut text).map_err(io("read"))?;
        let whole = text.iter().rposition(|&b| b == b'\n').map_or(0, |i| i + 1);
        if whole < text.len() {
            file.set_len(whole as u64).map_err(io("cut the torn last line of"))?;
            file.seek(SeekFrom::End(0)).map_err(io("seek"))?;
        }
        let mut events = Vec::new();
        for (i, line) in text[..whole].split(|&b| b == b'\n').enumerate().filter(|(_, l)| !l.is_empty()) {
            events.push(serde_json::from_slice::<Event>(line).map_err(|e| StoreError::Format {
                path: path.to_owned(),
                expected: "one event per line",
                found: format!("line {}: {e}", i + 1),
            })?);
        }
        durable::sync_folder(durable::folder_of(path))?;
        let next_id = events.last().map_or(1, |e| e.id + 1);
        let faults = events.iter().filter(|e| e.kind == "fault.raised").filter_map(|e| e.data["seq"].as_u64());
        let last_fault = faults.max().unwrap_or(0);
        Ok((Self { file, path: path.to_owned(), next_id, good_bytes: whole as u64, last_fault }, events))
    }

    pub fn last_fault(&self) -> u64 {
        self.last_fault
    }

    /// Writes an event and syncs it; the id it got comes back with it.
    pub fn append(&mut self, kind: &str, run: Option<&str>, well: Option<&str>, data: serde_json::Value) -> Result<Event, StoreError> {
        let event = Event {
            id: self.next_id,
            time: jiff::Timestamp::now().to_string(),
            kind: kind.to_owned(),
            run: run.map(str::to_owned),
            well: well.map(str::to_owned),
            data,
        };
        let io = |what| StoreError::io(what, &self.path);
        let mut line = serde_json::to_vec(&event).map_err(|e| StoreError::Format {
            path: self.path.clone(),
            expected: "an event JSON can hold",
            found: e.to_string(),
        })?;
        line.push(b'\n');
        // What an earlier failure left behind the last good line must not become the beginning of this one.
        self.file.set_len(self.good_bytes).map_err(io("cut the torn last line of"))?;
        self.file.write_all(&line).map_err(io("append to"))?;
        self.file.sync_data().map_err(io("sync"))?;
        self.good_bytes += line.len() as u64;
        self.next_id += 1;
        Ok(event)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_last_across_restarts_and_a_torn_line_is_cut() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("events.jsonl");
        let (mut journal, events) = Journal::open(&path).unwrap();
        assert!(events.is_empty());
        journal.append("a", None, None, serde_json::json!({"x": 1})).unwrap();
        journal.append("b", Some("r"), Some("A01"), serde_json::Value::Null).unwrap();
        drop(journal);
        OpenOptions::new().append(true).open(&path).unwrap().write_all(b"{\"id\": 3, \"tim").unwrap();

        let (mut journal, events) = Journal::open(&path).unwrap();
        assert_eq!(events.iter().map(|e| e.id).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(journal.append("c", None, None, serde_json::Value::Null).unwrap().id, 3);
        let (_, events) = Journal::open(&path).unwrap();
        assert_eq!(events.len(), 3);
        assert_eq!(events[2].kind, "c");
    }

    /// A write that failed half way is not there for the next one.
    #[test]
    fn a_torn_append_is_cut_before_the_next() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("events.jsonl");
        let (mut journal, _) = Journal::open(&path).unwrap();
        journal.append("a", None, None, serde_json::Value::Null).unwrap();
        OpenOptions::new().append(true).open(&path).unwrap().write_all(b"{\"id\": 2, \"kind\": \"run.").unwrap();
        assert_eq!(journal.append("b", None, None, serde_json::Value::Null).unwrap().id, 2);
        let (_, events) = Journal::open(&path).unwrap();
        assert_eq!(events.iter().map(|e| e.kind.as_str()).collect::<Vec<_>>(), ["a", "b"]);
    }

    #[test]
    fn a_broken_line_in_the_middle_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("events.jsonl");
        std::fs::write(&path, "nonsense\n").unwrap();
        let error = Journal::open(&path).err().unwrap().to_string();
        assert!(error.contains("events.jsonl") && error.contains("line 1"), "{error}");
    }
}
