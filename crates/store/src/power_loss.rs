//! Simulates a power loss after each file operation of a short use of the store, and a failure of each operation, as on a full disk.
//!
//! ```text
//! operations, recorded by `disk` ──> for each prefix and each kind of loss of unsynced data:
//!                                      a folder as the disk would have it ──> the store opens ──> what was acknowledged is there
//! ```

use super::*;
use crate::testing::{method, recording, trace};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_records::{EventData, Fault, LedgerEntry, Mode, RunAccepted, RunOutcome, RunPlan, fault_table};
use std::collections::{BTreeMap, BTreeSet};

/// A temporary folder in memory, if possible: thousands of files are written here.
fn scratch() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

pub(super) fn record(id: &str) -> RunRecord {
    let plan: RunPlan = serde_json::from_str(
        r#"{"plate_barcode": "P-1", "method": "m", "operator": "kim", "plate_map": [{"well": "A01", "dpf": 3}, {"well": "A02"}]}"#,
    )
    .unwrap();
    RunRecord::new(id, plan, method(), Mode::Simulated, None)
}

pub(super) fn frame(view: u32) -> RawFrame {
    RawFrame::new(16, 16, PixelFormat::Mono8, (0..=255u8).map(|p| p.wrapping_mul(7).wrapping_add(view as u8)).collect()).unwrap()
}

pub(super) fn entry(view: u32) -> LedgerEntry {
    let sha256 = carved_records::sha256_hex(frame(view).bytes());
    serde_json::from_value(serde_json::json!({
        "view": view, "commanded_steps": 0, "achieved_steps": 0, "epoch": 1, "omega": f64::from(view), "moved_ms": 0.0, "settle_ms": 0.0,
        "grab_ms": 0.0, "frame_id": view, "attempts": 1, "sha256": sha256, "closure": false
    }))
    .unwrap()
}

/// What was acknowledged to clients.
#[derive(Debug, Clone, Default, PartialEq)]
struct Acknowledged {
    events: usize,
    run: bool,
    outcome: Option<RunOutcome>,
    views: usize,
    closed: bool,
}

/// Data of an event. Only those of a fault and of an accepted run matter here.
fn event_data(kind: &str) -> EventData {
    match kind {
        "fault.raised" => EventData::FaultRaised(Fault::new(1, &fault_table::CAMERA_LOST, "gone".into(), "2026-01-01T00:00:00Z".into())),
        "run.accepted" => EventData::RunAccepted(RunAccepted { plate_barcode: "P".into(), method: "m".into(), ..RunAccepted::default() }),
        _ => EventData::of(kind, serde_json::Value::Null),
    }
}

/// A run of one specimen. Calls `acknowledge` after each acknowledgement.
fn life(root: &Path, mut acknowledge: impl FnMut(&Acknowledged)) -> Result<(), StoreError> {
    let (store, mut journal, _) = Claim::on(root).and_then(Store::open)?;
    let mut now = Acknowledged::default();
    let mut record = record("r1");
    store.save_run(&record)?;
    now.run = true;
    acknowledge(&now);
    let mut event = |now: &mut Acknowledged, kind: &str| {
        journal.append(Some("r1"), Some("A01"), event_data(kind))?;
        now.events += 1;
        Ok::<(), StoreError>(())
    };
    event(&mut now, "run.accepted")?;
    acknowledge(&now);
    let mut writer = RecordingWriter::create(&store.run_folder("r1").join("A01"), recording("r1", &record.plan.plate_map[0]), None)?;
    for view in 0..3 {
        writer.add_view(entry(view), &frame(view))?;
        now.views += 1;
        acknowledge(&now);
        event(&mut now, if view == 1 { "fault.raised" } else { "view.taken" })?;
        if view == 2 {
            event(&mut now, "view.taken")?;
            event(&mut now, "view.taken")?;
        }
        acknowledge(&now);
    }
    writer.close()?;
    now.closed = true;
    acknowledge(&now);
    record.end(RunOutcome::Partial);
    store.save_run(&record)?;
    now.outcome = Some(RunOutcome::Partial);
    acknowledge(&now);
    event(&mut now, "run.ended")?;
    acknowledge(&now);
    Ok(())
}

/// Kinds of loss of unsynced data.
#[derive(Debug, Clone, Copy)]
enum Loss {
    /// All unsynced names and contents are lost.
    Everything,
    /// New names are there without their contents, as with a file system that does not order both.
    Contents,
    /// New names are there with half of the unsynced contents.
    Torn,
}

#[derive(Default)]
struct Disk {
    /// For each file: its content on disk, and its content as the running system reads it.
    files: Vec<(Vec<u8>, Vec<u8>)>,
    kept: BTreeMap<PathBuf, usize>,
    names: BTreeMap<PathBuf, usize>,
    kept_folders: BTreeSet<PathBuf>,
    folders: BTreeSet<PathBuf>,
}

impl Disk {
    fn content(&mut self, path: &Path) -> &mut (Vec<u8>, Vec<u8>) {
        &mut self.files[self.names[path]]
    }

    fn play(&mut self, op: &trace::Op) {
        use trace::Op::*;
        match op {
            Create(path, bytes) => {
                self.files.push((Vec::new(), bytes.clone()));
                self.names.insert(path.clone(), self.files.len() - 1);
            }
            Append(path, bytes) => self.content(path).1.extend(bytes),
            Cut(path, length) => self.content(path).1.truncate(*length as usize),
            // A control run of `make qa` syncs nothing, so that the test must fail.
            Sync(_) if std::env::var_os("CARVED_CONTROL").is_some() => {}
            Sync(path) => {
                let content = self.content(path);
                content.0 = content.1.clone();
            }
            Rename(from, to) => {
                let file = self.names.remove(from).unwrap();
                self.names.insert(to.clone(), file);
            }
            Remove(path) => drop(self.names.remove(path)),
            CreateFolder(path) => drop(self.folders.insert(path.clone())),
            SyncFolder(folder) => {
                let here = |path: &PathBuf| path.parent() == Some(folder);
                self.kept.retain(|path, _| !here(path));
                self.kept.extend(self.names.iter().filter(|(path, _)| here(path)).map(|(path, file)| (path.clone(), *file)));
                self.kept_folders.extend(self.folders.iter().filter(|path| here(path)).cloned());
            }
        }
    }

    /// Writes what is left of `from` after the power loss into `to`.
    fn lose(&self, loss: Loss, from: &Path, to: &Path) {
        let (names, folders) = match loss {
            Loss::Everything => (&self.kept, &self.kept_folders),
            Loss::Contents | Loss::Torn => (&self.names, &self.folders),
        };
        let at = |path: &Path| to.join(path.strip_prefix(from).unwrap());
        for folder in folders {
            // Fails if the parent folder was lost. Then this folder is lost too.
            let _ = std::fs::create_dir(at(folder));
        }
        for (path, file) in names {
            let (kept, now) = &self.files[*file];
            let half = now.len().max(kept.len()).midpoint(kept.len()).min(now.len());
            let bytes = if matches!(loss, Loss::Torn) && now.starts_with(kept) { &now[..half] } else { kept };
            let _ = std::fs::write(at(path), bytes);
        }
    }
}

/// Opens the store on what is left, and checks that everything acknowledged is there.
fn check(root: &Path, known: &Acknowledged, when: &str) {
    let (store, journal, events) = Claim::on(root).and_then(Store::open).unwrap_or_else(|e| panic!("{when}: {e}"));
    let ids: Vec<u64> = events.iter().filter(|e| e.body.data.kind() != "run.unreadable").map(|e| e.id).collect();
    assert!(ids.len() >= known.events && ids.iter().zip(1..).all(|(id, n)| *id == n), "{when}: {ids:?}, known {known:?}");
    assert_eq!(journal.last_fault(), u64::from(events.iter().any(|e| e.body.data.kind() == "fault.raised")), "{when}");
    if known.run {
        let run = store.run("r1").unwrap_or_else(|e| panic!("{when}: {e}")).unwrap_or_else(|| panic!("{when}: the run is gone"));
        assert!(known.outcome.is_none() || run.outcome == known.outcome, "{when}: {:?}", run.outcome);
        let of_run = std::fs::read_to_string(root.join("runs/r1/events.jsonl")).unwrap_or_default();
        assert!(of_run.lines().count() >= known.events, "{when}: {of_run}");
        let lines = |text: &str| text.lines().filter(|line| line.contains("\"run\":\"r1\"")).map(str::to_owned).collect::<Vec<_>>();
        let journal = std::fs::read_to_string(root.join("events.jsonl")).unwrap_or_default();
        assert!(of_run.is_empty() || lines(&of_run) == lines(&journal), "{when}: {of_run} is not {journal}");
    }
    let folder = root.join("runs/r1/A01");
    if known.views > 0 {
        let reader = RecordingReader::open(&folder).unwrap_or_else(|e| panic!("{when}: {e}"));
        let ledger = reader.recording().ledger.entries();
        assert!(ledger.len() >= known.views, "{when}: {} of {} views", ledger.len(), known.views);
        for entry in ledger {
            assert_eq!(reader.frame(entry).unwrap_or_else(|e| panic!("{when}: {e}")), frame(entry.view), "{when}");
        }
    }
    if known.closed {
        let sums = std::fs::read_to_string(folder.join(sums::FILE)).unwrap();
        assert_eq!(sums.lines().count(), 4, "{when}: {sums}");
    }
}

#[test]
fn what_was_acknowledged_outlives_a_power_loss_after_any_operation() {
    let dir = scratch();
    let root = dir.path().join("data");
    let mut acknowledged = vec![(0, Acknowledged::default())];
    trace::begin(None);
    life(&root, |known| acknowledged.push((trace::count(), known.clone()))).unwrap();
    let ops = trace::end();
    assert!(ops.len() > 60, "{} operations", ops.len());
    for done in 0..=ops.len() {
        let known = &acknowledged.iter().rfind(|(count, _)| *count <= done).unwrap().1;
        let mut disk = Disk::default();
        ops[..done].iter().for_each(|op| disk.play(op));
        for loss in [Loss::Everything, Loss::Contents, Loss::Torn] {
            let after = scratch();
            disk.lose(loss, dir.path(), after.path());
            let root = after.path().join("data");
            check(&root, known, &format!("{loss:?} after operation {done} of {}, {:?}", ops.len(), ops.get(done.wrapping_sub(1))));
        }
    }
    println!("figure: {} power losses in a life of {} file operations, nothing lost", 3 * (ops.len() + 1), ops.len());
}

/// One operation fails on a full disk. The same event and the same run are accepted once there is room, and neither is doubled.
#[test]
fn any_operation_may_fail_once_and_nothing_is_lost_or_doubled() {
    for fails in 0.. {
        let dir = scratch();
        let (store, mut journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        let mut record = record("r1");
        trace::begin(Some(fails));
        let mut again = 0;
        let mut until_taken = |mut work: Box<dyn FnMut() -> Result<(), StoreError> + '_>| {
            while let Err(error) = work() {
                assert!(error.is_full(), "{error}");
                again += 1;
            }
        };
        until_taken(Box::new(|| store.save_run(&record)));
        for _ in 0..3 {
            until_taken(Box::new(|| journal.append(Some("r1"), None, event_data("view.taken")).map(|_| ())));
        }
        record.end(RunOutcome::Failed);
        until_taken(Box::new(|| store.save_run(&record)));
        until_taken(Box::new(|| journal.append(Some("r1"), None, event_data("run.ended")).map(|_| ())));
        let operations = trace::end().len();
        drop((store, journal));
        let text = std::fs::read_to_string(dir.path().join("events.jsonl")).unwrap();
        assert_eq!(text, std::fs::read_to_string(dir.path().join("runs/r1/events.jsonl")).unwrap(), "operation {fails} failed");
        let (store, journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!(events.iter().map(|e| e.id).collect::<Vec<_>>(), [1, 2, 3, 4], "operation {fails} failed");
        assert_eq!(store.run("r1").unwrap().unwrap(), record, "operation {fails} failed");
        drop(journal);
        if again == 0 {
            assert!(fails >= operations, "operation {fails} of {operations} could not fail");
            return;
        }
    }
}
