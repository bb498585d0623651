//! Data folders that earlier builds wrote are read in full: by the types of the files, by the tables and by the index.

#![allow(clippy::unwrap_used)] // a test may panic

use carved_store::columns::{AFTER, BEFORE, Cell, Kind, OfRun, Row};
use carved_store::{Claim, MeasurementFile, Recording, RecordingReader, RunRecord, Store, StoredRun};
use rusqlite::Connection;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A folder of the project.
fn of_project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// The kept data folders.
const KEPT: &str = "crates/records/tests/data";

/// All files of this name below a folder.
fn files(folder: &Path, name: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path, name));
        } else if path.ends_with(name) {
            found.push(path);
        }
    }
    found
}

/// Removes the keys that the build of `was` did not know.
fn take_newer_keys(now: &mut Value, was: &Value) {
    match (now, was) {
        (Value::Object(now), Value::Object(was)) => {
            now.retain(|key, _| was.contains_key(key));
            now.iter_mut().for_each(|(key, value)| take_newer_keys(value, &was[key]));
        }
        (Value::Array(now), Value::Array(was)) => now.iter_mut().zip(was).for_each(|(now, was)| take_newer_keys(now, was)),
        _ => {}
    }
}

/// Keys of the segmentation that today's build accepts in a stored method, and that have no effect.
const RETIRED: [&str; 3] = ["mean_shift", "high_sigma", "low_sigma"];

/// Reads a file as a type, and compares what the type holds with the file: nothing is dropped, and no value changes.
fn is_kept_by<T: DeserializeOwned + Serialize>(path: &Path) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut was: Value = serde_json::from_str(&text).unwrap();
    if let Some(segment) = was.pointer_mut("/method/segment").and_then(Value::as_object_mut) {
        segment.retain(|key, _| !RETIRED.contains(&key.as_str()));
    }
    let read: T = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut now = serde_json::to_value(read).unwrap();
    take_newer_keys(&mut now, &was);
    assert!(now == was, "{}: {}", path.display(), difference("", &now, &was));
}

/// Where two values differ first.
fn difference(at: &str, now: &Value, was: &Value) -> String {
    let inner = match (now, was) {
        (Value::Object(now), Value::Object(was)) => {
            was.iter().find_map(|(key, was)| Some((format!("{at}/{key}"), now.get(key), was)).filter(|(_, now, was)| *now != Some(*was)))
        }
        (Value::Array(now), Value::Array(was)) => was
            .iter()
            .enumerate()
            .find_map(|(i, was)| Some((format!("{at}/{i}"), now.get(i), was)).filter(|(_, now, was)| *now != Some(*was))),
        _ => None,
    };
    match inner {
        Some((at, Some(now), was)) => difference(&at, now, was),
        Some((at, None, was)) => format!("{at} is dropped, it was {was}"),
        None => format!("{at} is {now}, it was {was}"),
    }
}

#[test]
fn the_types_of_the_files_keep_every_value() {
    let mut read = [0; 3];
    for folder in [KEPT, "tests/commands/data/parsers/records"].map(of_project) {
        for path in files(&folder, "run.json").into_iter().filter(|path| !path.ends_with("unreadable/run.json")) {
            is_kept_by::<RunRecord>(&path);
            read[0] += 1;
        }
        for path in files(&folder, "recording.json") {
            is_kept_by::<Recording>(&path);
            read[1] += 1;
        }
    }
    let numbers = files(&of_project(KEPT), "measurement.json");
    let examples = ["larva.json", "bead.json"].map(|name| of_project("tests/commands/data").join(name));
    for path in numbers.into_iter().chain(examples) {
        is_kept_by::<MeasurementFile>(&path);
        read[2] += 1;
    }
    assert_eq!(read, [7, 3, 3], "a kept file is not read");
}

/// Copies a kept data folder: a store writes into its folder.
fn copied(name: &str) -> tempfile::TempDir {
    fn copy(from: &Path, to: &Path) {
        std::fs::create_dir_all(to).unwrap();
        for entry in std::fs::read_dir(from).unwrap() {
            let entry = entry.unwrap();
            let to = to.join(entry.file_name());
            if entry.path().is_dir() { copy(&entry.path(), &to) } else { assert!(std::fs::copy(entry.path(), to).is_ok()) }
        }
    }
    let dir = tempfile::tempdir().unwrap();
    copy(&of_project(KEPT).join(name), dir.path());
    dir
}

/// The rows of `table.csv`, which the earlier build wrote (`carved export table`), by the names of their columns.
fn table(data: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(data.join("table.csv")).unwrap();
    reader.deserialize().map(Result::unwrap).collect()
}

/// Whether a cell has this text in `table.csv`.
fn is(cell: &Cell, text: &str) -> bool {
    match cell {
        Cell::Empty => text.is_empty(),
        Cell::Text(now) => now == text,
        Cell::Number(now) => text.parse() == Ok(*now),
        Cell::Integer(now) => text.parse() == Ok(*now),
        Cell::Truth(now) => text == if *now { "TRUE" } else { "FALSE" },
    }
}

#[test]
fn the_table_of_an_earlier_build_is_made_again() {
    let dir = copied("faults");
    for was in table(dir.path()) {
        let (run, well) = (&was["run"], &was["well"]);
        let stored = StoredRun::read(&dir.path().join("runs").join(run)).unwrap();
        let place = stored.record().plan.plate_map.iter().position(|planned| planned.well == *well).unwrap();
        let read = stored.well(&stored.record().plan.plate_map[place]).unwrap();
        let of_run = OfRun::new(stored.record());
        let row = Row { run: &of_run, place: place + 1, well: &read };
        // The hash covers the keys that a build knows. The earlier build also gave simulated larvae an exposure.
        let may_differ = ["method_sha256", "exposure_id"];
        for (name, text) in was.iter().filter(|(name, _)| !may_differ.contains(&name.as_str())) {
            let column = BEFORE.iter().chain(AFTER).find(|column| column.name == name);
            let cell = column.unwrap_or_else(|| panic!("no column {name}")).cell(&row);
            assert!(is(&cell, text), "{run} {well} {name}: {cell:?}, it was {text:?}");
        }
    }
}

#[test]
fn the_index_of_an_earlier_folder_has_its_numbers() {
    let dir = copied("faults");
    let (store, _journal, _events) = Claim::on(dir.path()).and_then(Store::open).unwrap();
    assert_eq!(store.index_trouble(), None);
    let index = Connection::open(dir.path().join("index.sqlite")).unwrap();
    let mut compared = 0;
    for was in table(dir.path()) {
        for column in BEFORE.iter().chain(AFTER).filter(|column| column.kind == Kind::Number) {
            let sql = format!("SELECT \"{}\" FROM specimen_table WHERE run = ? AND well = ?", column.name);
            let now: Option<f64> = index.query_row(&sql, [&was["run"], &was["well"]], |row| row.get(0)).unwrap();
            let Some(text) = was.get(column.name) else { continue };
            assert_eq!(now, text.parse().ok(), "{} of {} {}", column.name, was["run"], was["well"]);
            compared += u32::from(now.is_some());
        }
    }
    assert!(compared > 20, "only {compared} numbers");
}

/// A recording and its numbers as replay, `carved measure` and the page read them, verified against `SHA256SUMS`.
#[test]
fn a_recording_of_an_earlier_build_opens_with_its_numbers() {
    let folder = of_project(KEPT).join("faults/runs/held/A02");
    let reader = RecordingReader::open(&folder).unwrap();
    reader.require_finished().unwrap();
    let numbers = reader.closed_numbers().unwrap();
    let was: Value = serde_json::from_slice(&std::fs::read(folder.join("measurement.json")).unwrap()).unwrap();
    assert_eq!(Some(numbers.record.measurement.volume_um3), was["measurement"]["volume_um3"].as_f64());
    assert_eq!(numbers.record.measurement.diameter_um, was["measurement"]["diameter_um"].as_f64());
    let recording = reader.recording();
    assert!(recording.accepted && recording.rig.camera.width == 1024 && recording.method.asd == 21, "{recording:?}");
}
