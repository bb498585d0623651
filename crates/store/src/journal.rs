//! The append-only event journal: one JSON object per line, synced before it is published. The events of a run are also in the run's own
//! folder.
//!
//! ```text
//! append ─> DATA/events.jsonl ─> DATA/runs/RUN/events.jsonl ─> the event is valid ─> index
//!               synced               synced, except views
//! ```
//! A crash between the two writes leaves the run's file one line short. A power loss may also remove views from it, which are synced there
//! with the next other event. The next start adds the missing lines.
//!
//! Ids increase strictly. If a start finds one that does not (an edited file, or a flipped bit), it keeps the file under another name and
//! renumbers the events from there. No event is lost, and the ids before the damage stay. A line that is no event is left out of the new
//! file in the same way. What it said is not known any more, so this is a fault.

use super::index::Index;
use super::lines::{EVENTS, Lines};
use super::{StoreError, durable};
use carved_records::{Event, EventBody, EventData, is_plain_name, kind};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Number of events that are read at a start, for readers that reconnect.
const TAIL: usize = 2000;

/// An event with the current time.
pub fn now(run: Option<&str>, well: Option<&str>, data: EventData) -> EventBody {
    EventBody { time: jiff::Timestamp::now().to_string(), run: run.map(str::to_owned), well: well.map(str::to_owned), data }
}

pub struct Journal {
    all: Lines,
    runs: PathBuf,
    /// The run of the newest event, and its file.
    of_run: Option<(String, Lines)>,
    next_id: u64,
    /// Sequence number of the newest fault.
    last_fault: u64,
    index: Arc<Index>,
}

impl Journal {
    /// Opens or creates the journal of a data folder and reads its end, of which every line is an event.
    pub(super) fn open(root: &Path, all: Lines, index: Arc<Index>) -> Result<(Self, Vec<Event>), StoreError> {
        let path = root.join(EVENTS);
        let lines = all.tail(TAIL)?;
        let tail: Vec<Event> = lines.iter().map(|line| parse(&path, line)).collect::<Result<_, _>>()?;
        let newest = tail.last().map_or(0, |e| e.id);
        let next_id = after(&path, newest)?;
        let last_fault = match index.last_fault() {
            Some(seq) => seq,
            None => last_fault(&path)?,
        };
        let mut journal = Self { all, runs: root.join("runs"), of_run: None, next_id, last_fault, index };
        journal.mend(&tail, &lines)?;
        Ok((journal, tail))
    }

    pub fn last_fault(&self) -> u64 {
        self.last_fault
    }

    /// Adds the newest events that a crash has kept from the file of their run. `lines` are those of `tail`.
    fn mend(&mut self, tail: &[Event], lines: &[Vec<u8>]) -> Result<(), StoreError> {
        let Some((last, run)) = tail.iter().rev().find_map(|event| Some((event, event.body.run.as_deref()?))) else { return Ok(()) };
        if !is_plain_name(run) {
            tracing::warn!(run, id = last.id, "the newest event of a run has no run's name, and is in no run's file");
            return Ok(());
        }
        let folder = self.runs.join(run);
        // Early versions wrote no file per run. The folder of a pruned run must not be created again.
        if !folder.is_dir() || !folder.join(EVENTS).exists() && !matches!(last.body.data, EventData::RunAccepted(_)) {
            return Ok(());
        }
        let kept = self.of_run(run)?.tail(TAIL)?;
        let kept: BTreeSet<u64> = kept.iter().filter_map(|line| serde_json::from_slice::<Id>(line).ok()).map(|line| line.id).collect();
        // Only events newer than the oldest event in the run's file are checked.
        let oldest = kept.first().copied().unwrap_or(0);
        let is_missing = |event: &Event| event.id > oldest && event.body.run.as_deref() == Some(run) && !kept.contains(&event.id);
        let missing: Vec<(&Event, &Vec<u8>)> = tail.iter().zip(lines).filter(|(event, _)| is_missing(event)).collect();
        let only_views = missing.iter().all(|(event, _)| event.body.data.kind() == kind::VIEW_TAKEN);
        for (event, line) in missing {
            let line = [line, &b"\n"[..]].concat();
            match self.append_of_run(event, &line) {
                // A start does not depend on views, and a full disk must not prevent it.
                Err(error) if only_views => {
                    tracing::warn!(%error, run, "views are missing in the run's file; the journal has them");
                    self.of_run = None;
                    return Ok(());
                }
                done => done?,
            }
        }
        Ok(())
    }

    fn of_run(&mut self, run: &str) -> Result<&mut Lines, StoreError> {
        let folder = self.runs.join(run);
        // If the run was not accepted, its file was removed.
        if self.of_run.as_ref().is_none_or(|(of, _)| of != run || !folder.join(EVENTS).exists()) {
            durable::create_folder(&folder)?;
            self.of_run = Some((run.to_owned(), Lines::open(&folder.join(EVENTS))?));
        }
        match &mut self.of_run {
            Some((_, lines)) => Ok(lines),
            None => Err(StoreError::Vanished { path: folder }),
        }
    }

    fn append_of_run(&mut self, event: &Event, line: &[u8]) -> Result<(), StoreError> {
        let Some(run) = event.body.run.as_deref() else { return Ok(()) };
        let lines = self.of_run(run)?;
        // Views are not synced: there is one per second, and a restart does not depend on them.
        if event.body.data.kind() == kind::VIEW_TAKEN {
            lines.append_unsynced(line)?;
        } else {
            lines.append(line)?;
        }
        lines.keep(line);
        Ok(())
    }

    /// Writes an event with the current time, as [`Self::write`] does.
    pub fn append(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) -> Result<Event, StoreError> {
        self.write(&now(run, well, data))
    }

    /// Syncs the journal again, to see how fast the disk is.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn probe(&mut self) -> Result<(), StoreError> {
        self.all.append(b"")
    }

    /// Writes and syncs an event. Returns it with its id.
    pub fn write(&mut self, body: &EventBody) -> Result<Event, StoreError> {
        let event = Event { id: self.next_id, body: body.clone() };
        let line = line_of(&event)?;
        self.all.append(&line).and_then(|()| self.append_of_run(&event, &line)).inspect_err(|_| {
            // The event is not acknowledged, so remove it. If this fails too, the next line overwrites it.
            self.all.drop_rest();
            self.of_run.iter_mut().for_each(|(_, lines)| lines.drop_rest());
        })?;
        self.all.keep(&line);
        if let EventData::FaultRaised(fault) = &event.body.data {
            self.last_fault = self.last_fault.max(fault.seq);
        }
        self.next_id = event.id.saturating_add(1);
        self.index.event(&event, self.all.good_bytes());
        Ok(event)
    }
}

/// Maximum step between two ids of one journal. Normally ids increase by one.
const JUMP: u64 = 1 << 32;

/// Whether `id` may follow `before`.
fn rises(before: u64, id: u64) -> bool {
    id > before && id - before <= JUMP
}

/// The id that follows `id`.
fn after(path: &Path, id: u64) -> Result<u64, StoreError> {
    id.checked_add(1).ok_or_else(|| StoreError::Format {
        path: path.to_owned(),
        expected: "an id that another can follow",
        found: id.to_string(),
    })
}

/// The part of an event that defines its order.
#[derive(serde::Deserialize)]
struct Id {
    id: u64,
}

/// Whether the ids of a journal increase from this byte on, after the id `newest`. Lines that are not events are skipped.
pub(super) fn is_in_order(path: &Path, from_byte: u64, mut newest: u64) -> Result<bool, StoreError> {
    let io = |what| StoreError::io(what, path);
    let mut file = carved_files::open_own_to_read(path).map_err(io("open"))?;
    file.seek(SeekFrom::Start(from_byte)).map_err(io("read"))?;
    for line in BufReader::new(file).split(b'\n') {
        let Ok(Id { id }) = serde_json::from_slice(&line.map_err(io("read"))?) else { continue };
        if !rises(newest, id) {
            return Ok(false);
        }
        newest = id;
    }
    Ok(true)
}

/// The result of a repair.
#[derive(Debug)]
pub(super) struct Repaired {
    /// The journal before the repair.
    pub kept: PathBuf,
    /// Number of events with a new id.
    pub renumbered: usize,
    /// Number of lines that are no events.
    pub set_aside: usize,
}

/// Whether every line at the end of a journal, which a start reads, is an event.
pub(super) fn is_sound(lines: &Lines) -> Result<bool, StoreError> {
    Ok(lines.tail(TAIL)?.iter().all(|line| serde_json::from_slice::<Event>(line).is_ok()))
}

fn damaged(number: u32) -> String {
    format!("{EVENTS}.damaged-{number}")
}

/// Renumbers the events whose ids do not increase, in the journal and in the files of their runs. Lines that are no events are left out. A copy of the old journal is kept. The
/// journal is written last, so that a start after a crash repeats the repair.
pub(super) fn repair(root: &Path) -> Result<Repaired, StoreError> {
    let path = root.join(EVENTS);
    let text = carved_files::read_own(&path).map_err(StoreError::io("read", &path))?;
    let (mut lines, mut changed, mut newest) = (Vec::new(), BTreeMap::<String, Vec<(&[u8], Vec<u8>)>>::new(), 0);
    let (mut renumbered, mut set_aside) = (0, 0);
    for line in text.split_inclusive(|&b| b == b'\n') {
        let Ok(event) = serde_json::from_slice::<Event>(line) else {
            set_aside += usize::from(!line.trim_ascii().is_empty());
            continue;
        };
        if rises(newest, event.id) {
            newest = event.id;
            lines.extend_from_slice(line);
            continue;
        }
        newest = after(&path, newest)?;
        renumbered += 1;
        let new = with_id(line, newest)?;
        lines.extend_from_slice(&new);
        if let Some(run) = event.body.run.filter(|run| is_plain_name(run)) {
            changed.entry(run).or_default().push((line, new));
        }
    }
    let mut number = 1;
    while root.join(damaged(number)).exists() {
        number += 1;
    }
    let kept = root.join(damaged(number));
    durable::write(&kept, &text)?;
    for (run, mut changes) in changed {
        let of_run = root.join("runs").join(run).join(EVENTS);
        let Ok(old) = carved_files::read_own(&of_run) else { continue };
        let mut new = Vec::with_capacity(old.len());
        for line in old.split_inclusive(|&b| b == b'\n') {
            // The same line may occur twice. The first change belongs to the first line.
            let at = changes.iter().position(|(from, _)| *from == line);
            let to = at.map(|at| changes.remove(at).1);
            new.extend_from_slice(to.as_deref().unwrap_or(line));
        }
        durable::write(&of_run, &new)?;
    }
    durable::write(&path, &lines)?;
    Ok(Repaired { kept, renumbered, set_aside })
}

fn parse(path: &Path, line: &[u8]) -> Result<Event, StoreError> {
    serde_json::from_slice(line).map_err(|e| StoreError::Format {
        path: path.to_owned(),
        expected: "one event per line",
        found: format!("{:?}: {e}", String::from_utf8_lossy(&line[..line.len().min(80)])),
    })
}

/// The same line with another id. All other fields stay, also unknown ones.
fn with_id(line: &[u8], id: u64) -> Result<Vec<u8>, StoreError> {
    let format = |e: serde_json::Error| StoreError::Format { path: EVENTS.into(), expected: "one event per line", found: e.to_string() };
    let mut event: serde_json::Map<String, serde_json::Value> = serde_json::from_slice(line).map_err(format)?;
    event.insert("id".into(), id.into());
    let mut line = serde_json::to_vec(&event).map_err(format)?;
    line.push(b'\n');
    Ok(line)
}

fn line_of(event: &Event) -> Result<Vec<u8>, StoreError> {
    let mut line = serde_json::to_vec(event).map_err(|e| StoreError::Format {
        path: EVENTS.into(),
        expected: "an event JSON can hold",
        found: e.to_string(),
    })?;
    line.push(b'\n');
    Ok(line)
}

/// Calls `take` with each complete event of a journal. The journal may be larger than the memory.
pub(super) fn each(path: &Path, mut take: impl FnMut(Event)) -> Result<(), StoreError> {
    let io = |what| StoreError::io(what, path);
    for line in BufReader::new(carved_files::open_own_to_read(path).map_err(io("open"))?).split(b'\n') {
        if let Ok(event) = serde_json::from_slice(&line.map_err(io("read"))?) {
            take(event);
        }
    }
    Ok(())
}

/// The newest fault of the whole journal, for use without an index.
fn last_fault(path: &Path) -> Result<u64, StoreError> {
    let mut newest = 0;
    each(path, |e| {
        if let EventData::FaultRaised(fault) = e.body.data {
            newest = newest.max(fault.seq);
        }
    })?;
    Ok(newest)
}

/// The newest `most` events without views, and all earlier events about faults, plates and starts of runs. For use without an index.
pub(super) fn remembered(path: &Path, most: usize) -> Result<Vec<Event>, StoreError> {
    let (mut lasting, mut newest) = (Vec::new(), VecDeque::new());
    each(path, |event| {
        if event.body.data.kind() == kind::VIEW_TAKEN {
            return;
        }
        if newest.len() == most {
            lasting.extend(newest.pop_front().filter(|e: &Event| e.body.data.is_lasting()));
        }
        newest.push_back(event);
    })?;
    lasting.extend(newest);
    Ok(lasting)
}

#[cfg(test)]
mod tests {
    use crate::{Claim, Store};
    use carved_records::{Event, EventData, Fault, fault_table};
    use serde_json::json;
    use std::fs::OpenOptions;
    use std::io::Write;

    /// An event of an unknown kind.
    fn other(kind: &str) -> EventData {
        EventData::of(kind, json!({"x": 1}))
    }

    #[test]
    fn ids_last_across_restarts_and_a_torn_line_is_cut() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("events.jsonl");
        let (store, mut journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert!(events.is_empty());
        journal.append(None, None, other("a")).unwrap();
        journal.append(Some("r"), Some("A01"), other("b")).unwrap();
        drop((store, journal));
        OpenOptions::new().append(true).open(&path).unwrap().write_all(b"{\"id\": 3, \"tim").unwrap();

        let (store, mut journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!(events.iter().map(|e| e.id).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(journal.append(None, None, other("c")).unwrap().id, 3);
        drop((store, journal));
        let (_store, _journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!(events.len(), 3);
        assert_eq!(events[2].body.data.kind(), "c");
    }

    /// The newest fault may be far before the tail.
    #[test]
    fn a_start_reads_the_end_of_a_long_journal_and_knows_its_newest_fault() {
        let dir = tempfile::tempdir().unwrap();
        let fault = Fault::new(41, &fault_table::CAMERA_LOST, "gone".into(), "2026-01-01T00:00:00Z".into());
        let line = |id: u64, kind: &str| {
            format!("{}\n", json!({"id": id, "time": "2026-01-01T00:00:00Z", "kind": kind, "run": null, "well": null, "data": fault}))
        };
        let text: String = (1..=5000).map(|id| line(id, if id == 7 { "fault.raised" } else { "x" })).collect();
        std::fs::write(dir.path().join("events.jsonl"), &text).unwrap();
        drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
        // Events before the tail are indexed, and are not read again.
        std::fs::write(dir.path().join("events.jsonl"), text.replacen("fault.raised", "xxxxx.xxxxxx", 1)).unwrap();
        let (_store, mut journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!((journal.last_fault(), events.len(), events[0].id), (41, 2000, 3001));
        assert_eq!(journal.append(None, None, other("y")).unwrap().id, 5001);
    }

    fn line(id: u64, kind: &str, run: Option<&str>) -> String {
        format!("{}\n", json!({"id": id, "time": "2026-01-01T00:00:00Z", "kind": kind, "run": run, "well": null, "data": null}))
    }

    /// For any ids in the file: after a start every event is there in its order, and the next id is above all of them.
    #[test]
    fn ids_that_do_not_rise_are_numbered_on_and_nothing_is_lost() {
        let max = u64::MAX;
        for (ids, expected) in [
            (&[1, 2, max][..], [1, 2, 3].as_slice()),
            (&[1, 2, 2, 3], &[1, 2, 3, 4]),
            (&[1, 9, 3, 4], &[1, 9, 10, 11]),
            (&[1, max, 3, 4], &[1, 2, 3, 4]),
            (&[max], &[1]),
            (&[0, 1, 2], &[1, 2, 3]),
            (&[1, i64::MAX as u64, 3], &[1, 2, 3]),
        ] {
            for has_index in [false, true] {
                let dir = tempfile::tempdir().unwrap();
                let path = dir.path().join("events.jsonl");
                if has_index && super::rises(0, ids[0]) {
                    // The index contains the part that was in order.
                    std::fs::write(&path, line(ids[0], "k0", Some("r1"))).unwrap();
                    drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
                }
                let text: String = ids.iter().enumerate().map(|(at, &id)| line(id, &format!("k{at}"), Some("r1"))).collect();
                std::fs::create_dir_all(dir.path().join("runs/r1")).unwrap();
                for file in [path.clone(), dir.path().join("runs/r1/events.jsonl")] {
                    std::fs::write(file, &text).unwrap();
                }
                let (store, mut journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
                let next = journal.append(Some("r1"), None, other("next")).unwrap().id;
                let read = |path: &std::path::Path| -> Vec<(u64, String)> {
                    let events = std::fs::read_to_string(path).unwrap();
                    let events = events.lines().map(|l| serde_json::from_str::<Event>(l).unwrap());
                    events.map(|e| (e.id, e.body.data.kind().to_owned())).collect()
                };
                let mut all: Vec<(u64, String)> = expected.iter().enumerate().map(|(at, &id)| (id, format!("k{at}"))).collect();
                let repaired = *all.last().map(|(id, _)| id).unwrap() + 1;
                all.extend([(repaired, "journal.repaired".into()), (repaired + 1, "next".into())]);
                assert_eq!((read(&path), next), (all.clone(), repaired + 1), "{ids:?}");
                all.retain(|(_, kind)| kind != "journal.repaired");
                assert_eq!(read(&dir.path().join("runs/r1/events.jsonl")), all, "{ids:?}");
                assert_eq!(std::fs::read_to_string(dir.path().join("events.jsonl.damaged-1")).unwrap(), text, "{ids:?}");
                assert_eq!(store.index_trouble(), None, "{ids:?}");
                drop((store, journal));
                let (store, _journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
                assert_eq!(store.index_trouble(), None);
                assert!(!dir.path().join("events.jsonl.damaged-2").exists(), "{ids:?}: it is repaired once");
            }
        }
    }

    /// A flipped bit, or a text that somebody has put there, among the newest lines. An older line was read when it was new.
    #[test]
    fn a_line_that_is_no_event_is_set_aside_and_the_start_goes_on_under_a_fault() {
        for has_index in [false, true] {
            for bad in ["{\"id\": 2, \"time\": 7}", "\u{0}\u{0}\u{0}", "not json", "\u{fffd}"] {
                let dir = tempfile::tempdir().unwrap();
                let path = dir.path().join("events.jsonl");
                let good = [line(1, "a", None), line(2, "b", None), line(3, "c", None)];
                if has_index {
                    std::fs::write(&path, good.concat()).unwrap();
                    drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
                }
                let damaged = format!("{}{bad}\n{}", good[0], good[2]);
                std::fs::write(&path, &damaged).unwrap();
                let (store, mut journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
                let found: Vec<(u64, &str)> = events.iter().map(|e| (e.id, e.body.data.kind())).collect();
                assert_eq!(found, [(1, "a"), (3, "c"), (4, "journal.repaired"), (5, "fault.raised")], "{bad:?}");
                let EventData::FaultRaised(fault) = &events[3].body.data else { panic!("no fault") };
                assert_eq!((fault.code.as_str(), fault.seq, journal.last_fault()), ("journal_damaged", 1, 1));
                assert!(fault.message.contains("events.jsonl.damaged-1") && fault.message.contains("1 line"), "{}", fault.message);
                assert_eq!(std::fs::read_to_string(dir.path().join("events.jsonl.damaged-1")).unwrap(), damaged);
                assert_eq!(journal.append(None, None, other("next")).unwrap().id, 6);
                assert_eq!(store.index_trouble(), None);
                drop((store, journal));
                let (_store, _journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
                assert_eq!(events.len(), 5, "{bad:?}");
                assert!(!dir.path().join("events.jsonl.damaged-2").exists(), "{bad:?}: it is set aside once");
            }
        }
    }

    #[test]
    fn an_event_of_a_run_outside_the_data_folder_is_written_nowhere_else() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("x")).unwrap();
        std::fs::write(dir.path().join("x/events.jsonl"), "").unwrap();
        let data = dir.path().join("data");
        std::fs::create_dir_all(data.join("runs")).unwrap();
        std::fs::write(data.join("events.jsonl"), line(1, "a", Some("../../x"))).unwrap();
        let (_store, _journal, events) = Claim::on(&data).and_then(Store::open).unwrap();
        assert_eq!(events.len(), 1);
        assert_eq!(std::fs::read_to_string(dir.path().join("x/events.jsonl")).unwrap(), "");
    }
}
