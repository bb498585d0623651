use super::*;
use crate::power_loss::{entry, frame, record};
use crate::testing::recording;
use crate::{Claim, Journal, MEASUREMENT, RecordingWriter, Store, rebuild_index, set_aside};
use carved_core::flag::Flag;
use carved_records::{EventData, Fault, RunOutcome, SpecimenOutcome, fault_table};
use serde_json::json;

mod start;

/// Every row of every table, as text.
fn rows(root: &Path) -> Vec<String> {
    let c = connect(&root.join(FILE)).unwrap();
    let mut tables = c.prepare("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name").unwrap();
    let tables: Vec<String> = tables.query_map([], |row| row.get(0)).unwrap().map(Result::unwrap).collect();
    let mut all = Vec::new();
    for table in tables {
        let mut select = c.prepare(&format!("SELECT * FROM {table} ORDER BY 1, 2")).unwrap();
        let columns = select.column_count();
        let mut found = select.query([]).unwrap();
        while let Some(row) = found.next().unwrap() {
            let values: Vec<_> = (0..columns).map(|i| format!("{:?}", row.get_ref(i).unwrap())).collect();
            all.push(format!("{table}: {}", values.join(" ")));
        }
    }
    all.sort();
    all
}

fn count(root: &Path, table: &str) -> usize {
    rows(root).iter().filter(|row| row.starts_with(&format!("{table}:"))).count()
}

/// A recording of a well, with numbers.
fn measured(store: &Store, run: &RunRecord, well: usize, diameter_um: Option<f64>) {
    let folder = store.run_folder(&run.id).join(&run.plan.plate_map[well].well);
    let mut writer = RecordingWriter::create(&folder, recording(&run.id, &run.plan.plate_map[well]), None).unwrap();
    writer.add_view(entry(0), &frame(0)).unwrap();
    let numbers = json!({"mode": "simulated", "measurement": {"volume_um3": 2.5e8, "area_um2": 3.1e6, "estimator": "support",
        "views": 1, "diameter_um": diameter_um, "aspect_ratio": 1.002}});
    writer.add_json(MEASUREMENT, &numbers).unwrap();
    writer.close().unwrap();
}

fn say(journal: &mut Journal, kind: &str, run: Option<&str>, data: serde_json::Value) {
    journal.append(run, run.map(|_| "A01"), EventData::of(kind, data)).unwrap();
}

fn fault(seq: u64) -> serde_json::Value {
    json!(Fault::new(seq, &fault_table::CAMERA_LOST, "gone".into(), "2026-01-01T00:00:00Z".into()))
}

/// Two runs, one of them open, with cleared faults and an open one.
fn live(root: &Path) -> (Store, Journal) {
    let (store, mut journal, _) = Claim::on(root).and_then(Store::open).unwrap();
    let mut first = record("r1");
    store.save_run(&first).unwrap();
    say(&mut journal, "run.accepted", Some("r1"), json!({"plate_barcode": "P-1", "method": "m"}));
    measured(&store, &first, 0, None);
    first.wells[0].end(SpecimenOutcome::Succeeded, None);
    first.wells[0].volume_um3 = Some(2.5e8);
    store.save_run(&first).unwrap();
    for seq in 1..=3 {
        say(&mut journal, "fault.raised", Some("r1"), fault(seq));
    }
    say(&mut journal, "fault.cleared", None, json!({"seq": [1, 2], "why": "it is back"}));
    say(&mut journal, "fault.acknowledged", None, json!({"seq": 3}));
    measured(&store, &first, 1, Some(499.5));
    first.wells[1].end(SpecimenOutcome::Succeeded, None);
    first.wells[1].flags = vec![Flag::Moved.into()];
    first.end(RunOutcome::Succeeded);
    store.save_run(&first).unwrap();
    say(&mut journal, "run.ended", Some("r1"), json!({}));
    store.save_run(&record("r2")).unwrap();
    say(&mut journal, "run.accepted", Some("r2"), json!({"plate_barcode": "P-2", "method": "m"}));
    (store, journal)
}

#[test]
fn an_index_written_live_has_the_rows_of_one_made_from_the_folders() {
    let dir = tempfile::tempdir().unwrap();
    drop(live(dir.path()));
    let written = rows(dir.path());
    for (table, expected) in [("runs", 2), ("specimens", 4), ("specimen_cells", 4), ("faults", 3), ("events", 8)] {
        assert_eq!(count(dir.path(), table), expected, "{table}");
    }
    assert!(written.iter().any(|row| row.starts_with("specimen_cells") && row.contains("499.5")), "{written:#?}");
    let found = rebuild_index(dir.path()).unwrap();
    assert_eq!((found.runs, found.open), (2, vec!["r2".to_owned()]));
    assert_eq!(rows(dir.path()), written);
}

/// The clock of the instrument was set back between two runs, and one run is imported. The pages of the list have the same order.
#[test]
fn runs_have_the_order_of_the_journal_whatever_the_clock_said() {
    let dir = tempfile::tempdir().unwrap();
    let (store, mut journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
    let accepted = [("b", "12:00"), ("d", "11:00"), ("a", "11:30"), ("c", "11:30"), ("e", "14:00")];
    for (id, time) in accepted {
        let run = RunRecord { started: format!("2026-01-01T{time}:00Z"), ..record(id) };
        store.save_run(&run).unwrap();
        say(&mut journal, "run.accepted", Some(id), json!({"plate_barcode": "P-1", "method": "m"}));
    }
    store.save_run(&RunRecord { started: "2026-01-01T13:00:00Z".into(), ..record("imported") }).unwrap();
    let listed = |limit: usize| {
        let (mut found, mut after) = (Vec::new(), None);
        loop {
            let page = store.reader().runs(&RunsQuery { limit, after, ..RunsQuery::default() }).unwrap();
            let Some(last) = page.last() else { return found };
            after = Some(last.cursor());
            found.extend(page.into_iter().map(|row| row.id));
        }
    };
    for limit in [1, 2, 10] {
        assert_eq!(listed(limit), ["e", "imported", "c", "a", "d", "b"], "{limit} per page");
    }
    drop((store, journal));
    std::fs::remove_file(dir.path().join(FILE)).unwrap();
    let (store, _journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
    let open: Vec<String> = store.open_runs().unwrap().into_iter().map(|run| run.id).collect();
    assert_eq!(open, ["b", "d", "a", "c", "imported", "e"], "oldest first, also after a rebuild");
}

#[test]
fn what_the_index_missed_is_found_at_the_next_start() {
    let dir = tempfile::tempdir().unwrap();
    let (store, journal) = live(dir.path());
    drop((store, journal));
    let expected = rows(dir.path());
    // As after a crash between a file and its row, and as after the removal of a run.
    let c = connect(&dir.path().join(FILE)).unwrap();
    c.execute_batch(
        "DELETE FROM specimens WHERE well = 'A02'; UPDATE runs SET run_json_ns = 1 WHERE id = 'r1'; DELETE FROM runs WHERE id = 'r2'",
    )
    .unwrap();
    let keep: i64 = c.query_row("SELECT journal_bytes FROM place", [], |row| row.get(0)).unwrap();
    let text = std::fs::read(dir.path().join("events.jsonl")).unwrap();
    assert_eq!(text.len() as i64, keep);
    let last = text[..text.len() - 1].iter().rposition(|&b| b == b'\n').unwrap() + 1;
    c.execute("DELETE FROM events WHERE id = 8", []).unwrap();
    c.execute("UPDATE place SET journal_bytes = ?", [last]).unwrap();
    drop(c);
    drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
    assert_eq!(rows(dir.path()), expected);
    std::fs::remove_dir_all(dir.path().join("runs/r1")).unwrap();
    drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
    assert_eq!((count(dir.path(), "runs"), count(dir.path(), "specimens"), count(dir.path(), "events")), (1, 2, 8));
}

#[test]
fn a_missing_or_broken_index_is_made_anew() {
    let dir = tempfile::tempdir().unwrap();
    drop(live(dir.path()));
    let expected = rows(dir.path());
    let path = dir.path().join(FILE);
    let whole = std::fs::read(&path).unwrap();
    let mut torn = whole.clone();
    torn[100..].fill(0xa5);
    for broken in [None, Some(b"no database at all, whatever its name says".to_vec()), Some(torn), Some(Vec::new())] {
        std::fs::remove_file(&path).unwrap();
        if let Some(bytes) = broken {
            std::fs::write(&path, bytes).unwrap();
        }
        let (store, journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        assert_eq!((journal.last_fault(), events.len(), store.index_trouble()), (3, 8, None));
        drop((store, journal));
        assert_eq!(rows(dir.path()), expected);
    }
}

#[test]
fn a_journal_of_another_folder_is_not_taken_for_the_rest_of_this_one() {
    let dir = tempfile::tempdir().unwrap();
    drop(live(dir.path()));
    let line = json!({"id": 1, "time": "2026-01-01T00:00:00Z", "kind": "other", "run": null, "well": null, "data": null});
    std::fs::write(dir.path().join("events.jsonl"), format!("{line}\n")).unwrap();
    drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
    assert_eq!((count(dir.path(), "events"), count(dir.path(), "faults")), (1, 0));
}

#[test]
fn an_index_that_fails_stops_no_run_and_catches_up() {
    let dir = tempfile::tempdir().unwrap();
    let (store, mut journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
    store.save_run(&record("r1")).unwrap();
    let other = connect(&dir.path().join(FILE)).unwrap();
    other.execute_batch("ALTER TABLE events RENAME TO elsewhere").unwrap();
    assert_eq!(journal.append(Some("r1"), None, EventData::of("a", json!(null))).unwrap().id, 1);
    assert!(store.index_trouble().unwrap().contains("events"), "{:?}", store.index_trouble());
    let mut run = record("r1");
    run.end(RunOutcome::Failed);
    store.save_run(&run).unwrap();
    assert!(store.index_trouble().is_some());
    other.execute_batch("ALTER TABLE elsewhere RENAME TO events").unwrap();
    store.index.state.lock().unwrap().again = std::time::Instant::now();
    assert_eq!(journal.append(Some("r1"), None, EventData::of("b", json!(null))).unwrap().id, 2);
    assert_eq!(store.index_trouble(), None);
    drop((store, journal, other));
    let caught_up = rows(dir.path());
    rebuild_index(dir.path()).unwrap();
    assert_eq!(rows(dir.path()), caught_up);
}

#[test]
fn a_newer_index_is_refused_with_both_versions() {
    let dir = tempfile::tempdir().unwrap();
    drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
    connect(&dir.path().join(FILE)).unwrap().pragma_update(None, "user_version", 99).unwrap();
    let error = Claim::on(dir.path()).and_then(Store::open).err().unwrap().to_string();
    let known = format!("index version {}", tables::STEPS.len());
    assert!(error.contains("index.sqlite") && error.contains("index version 99") && error.contains(&known), "{error}");
}

#[test]
fn a_run_that_cannot_be_read_is_reported_and_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    drop(live(dir.path()));
    let runs = dir.path().join("runs");
    let newer = std::fs::read_to_string(runs.join("r1/run.json")).unwrap().replace("carved.run/1", "carved.run/77");
    for (name, text) in [("broken", "{\"schema\": \"carved.run/1\", \"id\": \"bro"), ("newer", newer.as_str())] {
        std::fs::create_dir(runs.join(name)).unwrap();
        std::fs::write(runs.join(name).join("run.json"), text).unwrap();
    }
    for _ in 0..2 {
        let (store, journal, events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
        let told: Vec<String> =
            events[events.len() - 2..].iter().map(|e| format!("{} {}", e.body.data.kind(), e.body.data.to_json())).collect();
        assert!(told[0].starts_with("run.unreadable") && told[0].contains("broken/run.json"), "{told:?}");
        assert!(told[1].contains("carved.run/77") && told[1].contains("carved.run/1"), "{told:?}");
        assert!(store.run("newer").unwrap_err().to_string().contains("carved.run/77"));
        let mut open = store.open_runs().unwrap();
        assert_eq!(open.iter().map(|r| r.id.as_str()).collect::<Vec<_>>(), store_open(&store));
        for run in &mut open {
            run.end_interrupted();
            store.save_run(run).unwrap();
        }
        drop((store, journal));
        assert_eq!(count(dir.path(), "runs"), 2);
    }
    assert!(std::fs::read_to_string(runs.join("broken/run.json")).unwrap().ends_with("bro"));
}

/// The open runs at the first of two starts. At the second start there are none.
fn store_open(store: &Store) -> Vec<&str> {
    store.open.iter().map(String::as_str).collect()
}

/// The columns of a table that both version 1 and the newest one have.
fn columns(old: &Connection, table: &str) -> String {
    let of = |schema: &str| format!("SELECT name FROM pragma_table_info('{table}', '{schema}')");
    let mut select = old.prepare(&format!("{} INTERSECT {}", of("main"), of("newest"))).unwrap();
    let names: Vec<String> = select.query_map([], |row| row.get(0)).unwrap().map(Result::unwrap).collect();
    names.join(", ")
}

#[test]
fn an_index_of_version_1_is_brought_up_with_all_its_rows() {
    let dir = tempfile::tempdir().unwrap();
    drop(live(dir.path()));
    let expected = rows(dir.path());
    let (path, newest) = (dir.path().join(FILE), dir.path().join("newest"));
    std::fs::rename(&path, &newest).unwrap();
    let old = Connection::open(&path).unwrap();
    old.execute_batch(tables::STEPS[0]).unwrap();
    old.execute("ATTACH ? AS newest", [newest.to_str().unwrap()]).unwrap();
    for (table, added, values) in [
        ("runs", "schema, wells", "'carved.run/1', 2"),
        ("specimens", "views", "1"),
        ("events", "", ""),
        ("faults", "raised", "'2026-01-01T00:00:00Z'"),
    ] {
        // Of the newest version, and those that version 1 had as well and required.
        let shared = columns(&old, table);
        let [added, values] = [added, values].map(|more| if more.is_empty() { String::new() } else { format!(", {more}") });
        old.execute(&format!("INSERT INTO main.{table} ({shared}{added}) SELECT {shared}{values} FROM newest.{table}"), []).unwrap();
    }
    old.execute_batch("UPDATE main.place SET journal_bytes = (SELECT journal_bytes FROM newest.place)").unwrap();
    old.pragma_update(None, "user_version", 1).unwrap();
    drop(old);
    drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
    assert_eq!(rows(dir.path()), expected);
    let version: usize = connect(&path).unwrap().pragma_query_value(None, "user_version", |row| row.get(0)).unwrap();
    assert_eq!(version, tables::STEPS.len());
}

#[test]
fn an_earlier_attempt_is_kept_beside_the_newest_and_known() {
    let dir = tempfile::tempdir().unwrap();
    let (store, journal) = live(dir.path());
    let run = store.run("r1").unwrap().unwrap();
    let first = std::fs::read(store.run_folder("r1").join("A02/measurement.json")).unwrap();
    assert_eq!(set_aside(&store.run_folder("r1"), "A02").unwrap(), Some(1));
    assert_eq!(set_aside(&store.run_folder("r1"), "A02").unwrap(), None, "there is nothing more to keep");
    measured(&store, &run, 1, Some(501.0));
    assert_eq!(set_aside(&store.run_folder("r1"), "A02").unwrap(), Some(2));
    measured(&store, &run, 1, Some(502.0));
    let mut again = run;
    again.wells[1].diameter_um = Some(502.0);
    store.save_run(&again).unwrap();
    drop((store, journal));
    let written = rows(dir.path());
    assert_eq!(
        (count(dir.path(), "specimens"), count(dir.path(), "specimen_cells")),
        (6, 4),
        "two wells of two runs, and two earlier attempts"
    );
    let has = |diameter: &str| written.iter().any(|row| row.starts_with("specimen_cells") && row.contains(diameter));
    assert!(has("Real(502.0)") && !has("Real(501.0)") && !has("Real(499.5)"), "{written:#?}");
    assert_eq!(std::fs::read(dir.path().join("runs/r1/A02.attempt-1/measurement.json")).unwrap(), first);
    rebuild_index(dir.path()).unwrap();
    assert_eq!(rows(dir.path()), written);
}

#[test]
fn an_index_with_other_columns_is_filled_anew_and_one_with_the_same_is_not() {
    let dir = tempfile::tempdir().unwrap();
    drop(live(dir.path()));
    let expected = rows(dir.path());
    assert_eq!((count(dir.path(), "run_cells"), count(dir.path(), "specimen_cells")), (2, 4));
    let change = |sql: &str| connect(&dir.path().join(FILE)).unwrap().execute_batch(sql).unwrap();
    let open = || drop(Claim::on(dir.path()).and_then(Store::open).unwrap());
    change("UPDATE specimen_cells SET place = 4711");
    open();
    assert!(rows(dir.path()).iter().any(|row| row.contains("4711")), "runs that have not changed are not read");
    change("DROP VIEW specimen_table; CREATE VIEW specimen_table AS SELECT 1");
    open();
    assert_eq!(rows(dir.path()), expected);
    change("DELETE FROM specimen_cells WHERE (SELECT count(*) FROM specimen_table) <> 4");
    assert_eq!(rows(dir.path()), expected, "the view has a row per well");
}

#[test]
fn runs_are_found_by_a_part_of_the_name_of_a_compound() {
    let dir = tempfile::tempdir().unwrap();
    let (store, _journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
    for (id, compound) in [("treated", Some("Valproic acid")), ("plain", None)] {
        let mut run = record(id);
        run.plan.plate_map[1].compound = compound.map(str::to_owned);
        store.save_run(&run).unwrap();
    }
    let found = |compound: &str| {
        let query = RunsQuery { limit: 10, compound: Some(compound.into()), ..RunsQuery::default() };
        store.reader().runs(&query).unwrap().into_iter().map(|run| run.id).collect::<Vec<_>>()
    };
    assert_eq!((found("valPRO"), found("50%"), found("ethanol")), (vec!["treated".to_owned()], vec![], vec![]));
}
