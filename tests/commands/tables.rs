//! `carved export table` and `statistics`, on runs with the numbers of a larva and of a bead.
//!
//! The numbers in `data/` are those of specimens that were simulated once. A test compares them with the types of today, so that a key that is
//! renamed cannot leave a column empty.

use crate::common::{carved, generated, json, stderr, strict, venv};
use carved_core::flag::Flag;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::Mask;
use carved_records::{InstrumentIdentity, Mode, RunOutcome, SpecimenOutcome, WellNote, WellStatus, sha256_hex};
use carved_store::columns::{AFTER, BEFORE, Source};
use carved_store::{Claim, MEASUREMENT, MeasurementFile, Recording, RecordingWriter, RunRecord, Store, frames};
use rusqlite::types::ValueRef::{Blob, Integer, Null, Real, Text};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub fn example(name: &str) -> Value {
    json(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/commands/data").join(name))
}

/// Wells of a plate of 384 in their order.
fn wells() -> impl Iterator<Item = String> {
    ('A'..='P').flat_map(|row| (1..=24).map(move |column| format!("{row}{column:02}")))
}

/// A run: A01 a larva and A02 a bead with numbers, A03 and the further wells skipped.
pub fn plate(data: &Path, id: &str, barcode: &str, size: usize) -> PathBuf {
    plate_of(data, id, barcode, size, Some(instrument("vast-1", "0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11")))
}

fn instrument(name: &str, uuid: &str) -> InstrumentIdentity {
    InstrumentIdentity { name: name.into(), serial: Some("0042".into()), location: Some("room 2.17".into()), uuid: uuid.into() }
}

/// A run of this instrument. `None`: as a version wrote it that did not write the instrument.
fn plate_of(data: &Path, id: &str, barcode: &str, size: usize, instrument: Option<InstrumentIdentity>) -> PathBuf {
    let mut map: Vec<Value> = wells().take(size).map(|well| json!({"well": well, "dpf": 4})).collect();
    map[0] = json!({"well": "A01", "dpf": 4, "compound": "DMSO, \"<dry>\"", "concentration": 0.1, "concentration_unit": "% v/v",
        "strain": "ABxTL", "treatment": "none", "control": "negative", "replicate": 2});
    map[1] = json!({"well": "A02", "specimen": "bead"});
    let plan = json!({"plate_barcode": barcode, "method": "standard", "operator": "kim", "external_id": "lims-7", "plate_map": map,
        "metadata": {"columns": {"Clutch, ID": {"A01": "c \"1\"", "A03": "7"}}}});
    let method = json!({"asd": 21, "order": "sequential", "epsilon": 0.05, "voxel_um": 6.93, "version": "2"});
    let (plan, method) = (serde_json::from_value(plan).unwrap(), serde_json::from_value(method).unwrap());
    let (store, _journal, _) = Claim::on(data).and_then(Store::open).unwrap();
    let mut record = RunRecord { instrument, ..RunRecord::new(id, plan, method, Mode::Simulated, None) };
    for (well, file) in [(0, "larva.json"), (1, "bead.json")] {
        measured(&store, &record, well, &example(file));
        record.wells[well].end(SpecimenOutcome::Succeeded, None);
    }
    record.wells[1].flags = vec![Flag::Moved.into(), Flag::Residual.into()];
    let note = WellNote {
        by: "kim".into(),
        time: "2026-03-05T09:30:00Z".into(),
        excluded: true,
        comment: "an air bubble, \"large\"".into(),
        tags: vec!["bubble".into(), "again".into()],
    };
    record.wells.iter_mut().skip(2).take(1).for_each(|well| well.set_note(Some(Box::new(note.clone()))));
    for well in &mut record.wells[2..] {
        well.end(SpecimenOutcome::Skipped, Some("empty"));
    }
    record.end(RunOutcome::Succeeded);
    store.save_run(&record).unwrap();
    store.run_folder(id)
}

fn measured(store: &Store, run: &RunRecord, well: usize, numbers: &Value) {
    let rig = json!({
        "name": "rig", "pixel_format": "Mono8", "steps_per_revolution": [500, 1], "sense": 1,
        "camera": {"f": 60000.0, "kx": 0.18, "ky": 0.18, "ux": 8.0, "uy": 8.0, "width": 16, "height": 16},
        "rotation_identity": "axis", "camera_identity": "camera"
    });
    let planned = run.plan.plate_map[well].clone();
    let folder = store.run_folder(&run.id).join(&planned.well);
    let mut recording =
        Recording::new(&run.id, planned, Mode::Simulated, serde_json::from_value(rig).unwrap(), "standard", run.method.clone());
    recording.software.commit = "0123456789abcdef".into();
    recording.software.dirty = Some(false);
    recording.ended_after_views = Some(21);
    let mut writer = RecordingWriter::create(&folder, recording, None).unwrap();
    let truth = json!({"volume_um3": 3e8, "area_um2": 3.6e6, "hull_volume_um3": 3.1e8, "hull_area_um2": 3.9e6, "length_um": 4e3, "diameter_um": 500.0});
    writer.add_detection(&RawFrame::new(16, 16, PixelFormat::Mono8, vec![3; 256]).unwrap(), Some(truth)).unwrap();
    for view in pictured(numbers) {
        let frame = RawFrame::new(16, 16, PixelFormat::Mono8, vec![180; 256]).unwrap();
        writer.add_file(&format!("frames/view_{view:03}.png"), &frames::encode(&frame).unwrap()).unwrap();
        let inside = (0..256).map(|i| if (4..12).contains(&(i / 16)) { 255 } else { 0 }).collect();
        writer
            .add_file(&format!("profiles/view_{view:03}.png"), &frames::encode_mask(&Mask::from_coverage(16, 16, inside).unwrap()).unwrap())
            .unwrap();
    }
    writer.add_json(MEASUREMENT, numbers).unwrap();
    writer.add_json("timings.json", &json!({"phases_s": {"revolve": 26.5}, "devices_s": 30.25, "own_s": 4.5, "attempts": 1})).unwrap();
    writer.close().unwrap();
}

/// The views that a report shows of a larva.
fn pictured(numbers: &Value) -> Vec<u64> {
    let facing = &numbers["facing"];
    [&facing["lateral_views"][0], &facing["dorsal_view"]].into_iter().filter_map(Value::as_u64).collect()
}

fn export(args: &[&str], paths: &[&Path]) -> Output {
    carved().arg("export").args(args).args(paths).output().unwrap()
}

pub fn done(output: &Output) {
    assert!(output.status.success(), "{}", stderr(output));
}

/// The rows of a CSV by column.
fn rows(file: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let headings = reader.headers().unwrap().clone();
    let row = |row: csv::StringRecord| headings.iter().map(str::to_owned).zip(row.iter().map(str::to_owned)).collect();
    reader.records().map(|record| row(record.unwrap())).collect()
}

/// A text of the plate map that Excel would run as a command.
#[test]
fn a_file_for_a_spreadsheet_has_no_formula_and_one_for_programs_has_every_text_as_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path(), "r1", "=cmd|'/C calc'!A0", 3);
    let table = |more: &[&str]| {
        let file = dir.path().join("table.csv");
        let output = carved().args(["export", "table"]).arg(&run).arg("--out").arg(&file).args(more).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        std::fs::read_to_string(file).unwrap()
    };
    let (programs, spreadsheet) = (table(&[]), table(&["--spreadsheet"]));
    let marked = "'=cmd|'/C calc'!A0";
    assert!(programs.contains(",=cmd|") && !programs.contains(marked) && !programs.starts_with('\u{feff}'), "{programs}");
    assert_eq!(spreadsheet.matches(",'=cmd|").count(), spreadsheet.matches("=cmd|").count(), "{spreadsheet}");
    assert!(spreadsheet.starts_with('\u{feff}') && spreadsheet.contains(marked), "{spreadsheet}");
    let output = carved().args(["export", "table"]).arg(&run).arg("--spreadsheet").output().unwrap();
    assert!(String::from_utf8(output.stdout).unwrap().contains(marked), "standard output too");
    // Statistics have the texts of the plate map too.
    let mut record = json(&run.join("run.json"));
    record["plan"]["plate_map"][0]["compound"] = "=1+1".into();
    std::fs::write(run.join("run.json"), record.to_string()).unwrap();
    let statistics = |name: &str| {
        let file = dir.path().join(name);
        let output = carved().args(["export", "statistics", "--spreadsheet"]).arg(&run).arg("--out").arg(&file).output().unwrap();
        (output.status.success(), std::fs::read_to_string(file).unwrap_or_default())
    };
    let (is_written, text) = statistics("s.csv");
    assert!(is_written && text.starts_with('\u{feff}') && text.contains(",'=1+1,") && !text.contains(",=1+1,"), "{text}");
    assert_eq!(statistics("s.json"), (false, String::new()));
}

#[test]
fn the_examples_are_numbers_of_today() {
    for name in ["larva.json", "bead.json"] {
        let example = example(name);
        let typed: MeasurementFile = serde_json::from_value(example.clone()).unwrap();
        assert_eq!(serde_json::to_value(typed).unwrap(), example, "{name} has another key than the type");
    }
}

#[test]
fn a_row_has_the_plate_map_the_numbers_and_where_they_come_from() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "0017", 4);
    let (out, shape) = (dir.path().join("table.csv"), dir.path().join("shape.csv"));
    done(&carved().args(["export", "table"]).arg(&run).arg("--out").arg(&out).arg("--shape").arg(&shape).output().unwrap());
    let rows = rows(&out);
    let (larva, bead, empty) = (&rows[0], &rows[1], &rows[2]);
    let numbers = example("larva.json");
    let number = |pointer: &str| numbers.pointer(pointer).unwrap().as_f64().unwrap();
    for (column, expected) in [
        ("run", "r1"),
        ("external_id", "lims-7"),
        ("plate_barcode", "0017"),
        ("mode", "simulated"),
        ("instrument", "vast-1"),
        ("instrument_serial", "0042"),
        ("instrument_location", "room 2.17"),
        ("instrument_uuid", "0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11"),
        ("well", "A01"),
        ("compound", "DMSO, \"<dry>\""),
        ("concentration", "0.1"),
        ("concentration_unit", "% v/v"),
        ("control", "negative"),
        ("replicate", "2"),
        ("meta_clutch__id", "c \"1\""),
        ("outcome", "succeeded"),
        ("flag_count", "0"),
        // It has not lived.
        ("taxon_id", ""),
        ("stage_id", ""),
        ("estimator", "support"),
        ("qc_passed", "TRUE"),
        ("views", "21"),
        ("software_commit", "0123456789abcdef"),
        ("software_dirty", "FALSE"),
        ("method", "standard"),
        ("method_version", "2"),
        ("turn_s", "26.5"),
    ] {
        assert_eq!(larva[column], expected, "{column}");
    }
    for (column, pointer) in [
        ("volume_um3", "/measurement/volume_um3"),
        ("volume_sd_um3", "/measurement/volume_sd_um3"),
        ("area_um2", "/measurement/area_um2"),
        ("body_length_um", "/shape/body/length_um"),
        ("signal_grey_px_per_nl", "/fluorescence/signal_per_nl"),
    ] {
        assert_eq!(larva[column].parse::<f64>().unwrap().to_bits(), number(pointer).to_bits(), "{column}");
    }
    assert_eq!((bead["flags"].as_str(), bead["flag_count"].as_str(), bead["specimen"].as_str()), ("moved;residual", "2", "bead"));
    assert!((bead["diameter_um"].parse::<f64>().unwrap() - 500.0).abs() < 5.0, "{}", bead["diameter_um"]);
    assert_eq!((empty["outcome"].as_str(), empty["reason"].as_str(), empty["volume_um3"].as_str()), ("skipped", "empty", ""));
    // That it is excluded is a flag.
    assert_eq!((empty["meta_clutch__id"].as_str(), empty["flag_count"].as_str()), ("7", "1"));
    // The hashes, computed here in another way: the method from the file, the numbers from SHA256SUMS.
    let method = json(&run.join("A01/recording.json"))["method"].to_string();
    assert_eq!(larva["method_sha256"], sha256_hex(method.as_bytes()));
    let sums = std::fs::read_to_string(run.join("A01/SHA256SUMS")).unwrap();
    assert!(sums.contains(&format!("{}  measurement.json", larva["measurement_sha256"])), "{sums}");
    // The slices of the larva and of the bead.
    let stations = self::rows(&shape);
    let expected = ["larva.json", "bead.json"].map(|name| example(name).pointer("/shape/body/stations").unwrap().as_array().unwrap().len());
    assert_eq!(stations.len(), expected.iter().sum::<usize>());
    assert_eq!((stations[0]["well"].as_str(), stations[0]["station"].as_str()), ("A01", "1"));
    // Slices and volume are of different estimators, and both tables say of which.
    assert_eq!(
        (stations[0]["estimator"].as_str(), larva["shape_estimator"].as_str(), larva["estimator"].as_str()),
        ("field", "field", "support")
    );
    assert_eq!(number("/shape/solid/volume_um3").to_bits(), number("/measurement/field_volume_um3").to_bits());
    assert!(number("/measurement/volume_um3") < 0.98 * number("/measurement/field_volume_um3"), "the two differ by more than their errors");
    assert_eq!(stations[0]["width_um"].parse::<f64>().unwrap().to_bits(), number("/shape/body/stations/0/width_um").to_bits());
}

/// A pointer into a file that has no such key gives an empty column. These have a reason.
#[test]
fn every_column_has_a_value_somewhere() {
    // Both eyes and the swim bladder were found. The others are of larvae that lived: `provenance` has them.
    const NEVER_HERE: [&str; 6] = ["bladder_reason", "estimator_fallback", "exposure_id", "eyes_reason", "stage_id", "taxon_id"];
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    let out = dir.path().join("table.csv");
    done(&export(&["table", "--out", out.to_str().unwrap()], &[&run]));
    let rows = rows(&out);
    let empty: BTreeSet<&str> =
        rows[0].keys().filter(|column| rows.iter().all(|row| row[*column].is_empty())).map(String::as_str).collect();
    assert_eq!(empty, BTreeSet::from(NEVER_HERE));
}

/// Numbers of `measurement.json` that no column has, by the beginning of their pointers, and why.
const ONLY_IN_THE_FILE: [(&str, &str); 19] = [
    ("/calibration/", "the camera of the turn; the checks have its differences from the rig"),
    ("/closure/", "the checks have its numbers"),
    ("/facing/", "which views show the back and the sides, for pictures"),
    ("/measurement/area_method/", "settings of the fairing"),
    ("/measurement/estimators/support/", "how the support functions were fitted"),
    ("/measurement/fairing_volume_loss", "of the surface that is shown"),
    ("/measurement/mesh_volume_um3", "of the surface that is shown"),
    ("/measurement/planned_views", "the column `views_planned` is that of the method"),
    ("/measurement/sphere/", "the same as `diameter_um` and `sphere_rms_um`"),
    ("/measurement/unfaired_area_um2", "of the surface before it is faired"),
    ("/measurement/voxels", "a count of the computation"),
    ("/reference/dpf", "the age in the plate map"),
    ("/reference/eyes/", "the columns `reference_eye_...` have the place"),
    ("/shape/body/dorsal/belly_share", "what the confidence follows from"),
    ("/shape/body/dorsal/median_share", "what the confidence follows from"),
    ("/shape/body/head/first_moment", "what the confidence follows from"),
    ("/shape/body/slices_volume_share", "a check of the slices"),
    ("/shape/harmonics/", "fine structure of the surface"),
    ("/shape/solid/", "volume and area of the mesh"),
];

fn numbers(value: &Value, pointer: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(keys) => keys.iter().for_each(|(key, value)| numbers(value, &format!("{pointer}/{key}"), found)),
        Value::Number(_) => drop(found.insert(pointer.to_owned())),
        _ => {}
    }
}

/// Whoever adds a number to the measurement decides whether the table has it.
#[test]
fn every_number_of_a_measurement_has_a_column_or_a_reason() {
    let columns: BTreeSet<&str> =
        BEFORE.iter().chain(AFTER).filter_map(|column| if let Source::Measured(at) = column.source { Some(at) } else { None }).collect();
    let mut found = BTreeSet::new();
    for name in ["larva.json", "bead.json"] {
        numbers(&example(name), "", &mut found);
    }
    found.retain(|pointer| !columns.contains(pointer.as_str()));
    let without: Vec<_> = found.iter().filter(|pointer| ONLY_IN_THE_FILE.iter().all(|(part, _)| !pointer.starts_with(part))).collect();
    assert!(without.is_empty(), "no column in crates/store/src/columns/list.rs, and no reason here: {without:?}");
    for (part, why) in ONLY_IN_THE_FILE {
        assert!(found.iter().any(|pointer| pointer.starts_with(part)), "no number without a column begins with {part} ({why})");
    }
}

/// What `run.json` and the status say of a well is in the table, by the same name or by this one.
#[test]
fn every_value_of_a_well_has_a_column() {
    const OTHER_NAMES: [(&str, &str); 4] = [
        ("residual_px", "qc_residual_px"),
        ("signal_per_nl", "signal_grey_px_per_nl"),
        ("reference", "reference_volume_z"),
        ("note", "comment"),
    ];
    let planned = serde_json::from_value(json!({"well": "A01"})).unwrap();
    for key in serde_json::to_value(WellStatus::pending(&planned)).unwrap().as_object().unwrap().keys() {
        let name = OTHER_NAMES.iter().find(|(from, _)| from == key).map_or(key.as_str(), |(_, name)| name);
        assert!(BEFORE.iter().chain(AFTER).any(|column| column.name == name), "the table has no column {name} for {key} of a well");
    }
}

#[test]
fn a_column_has_the_unit_of_its_check() {
    let larva = example("larva.json");
    let checks = larva["quality"]["checks"].as_array().unwrap();
    let mut compared = 0;
    for column in BEFORE.iter().chain(AFTER) {
        let Source::Check(name, _) = column.source else { continue };
        let unit = checks.iter().find(|check| check["name"] == name).unwrap()["unit"].as_str().unwrap();
        // A count has no unit in the table.
        assert_eq!(column.unit().unwrap_or("views"), unit, "{}", column.name);
        compared += 1;
    }
    assert!(compared > 15, "{compared}");
}

#[test]
fn instruments_are_distinguished_and_runs_without_one_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let (first, second) = ("0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11", "8d5b1c5e-3c5f-4f6e-9a57-52d6a2f3b7aa");
    let of = [Some(instrument("vast-1", first)), Some(instrument("vast-1", second)), Some(instrument("renamed", second)), None];
    let runs: Vec<PathBuf> = (1..).zip(of).map(|(i, of)| plate_of(&data, &format!("r{i}"), "P-1", 2, of)).collect();
    let out = dir.path().join("table.csv");
    done(&carved().args(["export", "table", "--out"]).arg(&out).args(&runs).output().unwrap());
    let found: Vec<(String, String)> =
        rows(&out).iter().step_by(2).map(|row| (row["instrument"].clone(), row["instrument_uuid"].clone())).collect();
    let expected = [("vast-1", first), ("vast-1", second), ("renamed", second), ("rig", "")];
    assert_eq!(found, expected.map(|(name, uuid)| (name.to_owned(), uuid.to_owned())));
}

#[test]
fn the_index_has_the_values_of_the_table() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let run = plate(&data, "r1", "P-1", 4);
    let out = dir.path().join("table.csv");
    done(&export(&["table", "--out", out.to_str().unwrap()], &[&run]));
    let index = rusqlite::Connection::open(data.join("index.sqlite")).unwrap();
    let mut select = index.prepare("SELECT * FROM specimen_table WHERE run = 'r1' ORDER BY place").unwrap();
    let names: Vec<String> = select.column_names().filter(|name| *name != "metadata").map(str::to_owned).collect();
    let text = std::fs::read_to_string(&out).unwrap();
    let headings: Vec<String> = text.lines().next().unwrap().split(',').map(str::to_owned).collect();
    let (own, listed): (Vec<&String>, Vec<&String>) = headings.iter().partition(|name| name.starts_with("meta_"));
    assert!(names.iter().eq(listed), "the index has {names:?}");
    assert_eq!(own, ["meta_clutch__id"]);
    let mut found = select.query([]).unwrap();
    let mut compared = 0;
    for row in rows(&out) {
        let indexed = found.next().unwrap().unwrap();
        let metadata: Option<String> = indexed.get("metadata").unwrap();
        let metadata = metadata.map_or(Value::Null, |text| serde_json::from_str(&text).unwrap());
        assert_eq!(metadata["meta_clutch__id"].as_str().unwrap_or_default(), row["meta_clutch__id"]);
        for name in &names {
            let (cell, value) = (&row[name], indexed.get_ref(name.as_str()).unwrap());
            let same = match value {
                Null => cell.is_empty(),
                Integer(truth) if cell == "TRUE" || cell == "FALSE" => (cell == "TRUE") == (truth == 1),
                Integer(number) => *cell == number.to_string(),
                Real(number) => cell.parse::<f64>().unwrap().to_bits() == number.to_bits(),
                Text(text) => cell.as_bytes() == text,
                Blob(_) => false,
            };
            assert!(same, "{}, {name}: the table has {cell:?}, the index {:?}", row["well"], value);
            compared += usize::from(!cell.is_empty());
        }
    }
    assert!(compared > 200, "only {compared} cells hold anything");
}

#[test]
fn what_cannot_be_a_table_is_refused_before_anything_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let run = plate(&data, "r1", "P-1", 4);
    let out = dir.path().join("t.csv");
    let refused = |args: &[&str], paths: &[&Path], words: &str| {
        let output = export(args, paths);
        assert!(!output.status.success() && stderr(&output).contains(words), "{words}: {}", stderr(&output));
    };
    let to = ["table", "--out", out.to_str().unwrap()];
    refused(&to, &[&data], "no run: it has no run.json");
    refused(&to, &[&run, &run], "the run r1 is named twice");
    refused(&["table", "--out", "t.xlsx"], &[&run], "ends in .csv or .parquet");
    if cfg!(not(feature = "parquet")) {
        refused(&["table", "--out", "t.parquet"], &[&run], "without the feature parquet");
    }
    assert!(!out.exists());
}

/// One file is altered, no JSON, or a pipe. All other wells of all runs are in what is written, and the exit code says that one is not.
#[test]
fn a_well_that_cannot_be_read_is_named_and_the_others_are_given() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let runs = [plate(&data, "r1", "P-1", 4), plate(&data, "r2", "P-2", 4)];
    let paths = [runs[0].as_path(), runs[1].as_path()];
    let numbers = runs[0].join("A01/measurement.json");
    let text = std::fs::read_to_string(&numbers).unwrap();
    let file = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (out, shape, page) = (file("t.csv"), file("s.csv"), file("r.html"));
    let left_out = |output: &Output, what: &str| {
        let said = stderr(output);
        assert_eq!(output.status.code(), Some(3), "{what}: {said}");
        assert!(said.contains("r1 A01 was left out") && said.contains("measurement.json"), "{what}: {said}");
    };
    let damages: [&dyn Fn(); 3] = [
        &|| std::fs::write(&numbers, text.replacen("volume_um3", "volume_um4", 1)).unwrap(),
        &|| std::fs::write(&numbers, "{").unwrap(),
        &|| assert!(Command::new("mkfifo").arg(&numbers).status().unwrap().success()),
    ];
    for damage in damages {
        std::fs::remove_file(&numbers).unwrap();
        damage();
        left_out(&export(&["table", "--out", &out, "--shape", &shape], &paths), "table");
        let rows = rows(Path::new(&out));
        let of = |run: &str, well: &str| rows.iter().find(|row| row["run"] == run && row["well"] == well).unwrap();
        assert_eq!(rows.len(), 8);
        assert!(of("r1", "A01")["reason"].contains("measurement.json") && of("r1", "A01")["volume_um3"].is_empty(), "{rows:?}");
        assert!(!of("r2", "A01")["volume_um3"].is_empty() && !of("r1", "A02")["volume_um3"].is_empty());
        let slices = self::rows(Path::new(&shape));
        assert!(slices.iter().any(|row| row["run"] == "r2") && slices.iter().all(|row| row["run"] != "r1" || row["well"] != "A01"));
        left_out(&export(&["statistics", "--out", &file("a.csv")], &paths), "statistics");
        left_out(&export(&["methods"], &paths), "methods");
        left_out(&carved().arg("report").args(paths).arg("--out").arg(&page).output().unwrap(), "report");
        let text = std::fs::read_to_string(&page).unwrap();
        assert!(text.contains("Left out: r1 A01, because it cannot be read"));
    }
}

#[test]
fn statistics_are_written_as_tables_and_as_json() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let runs = [plate(&data, "r1", "P-1", 4), plate(&data, "r2", "P-2", 4)];
    let file = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (out, controls, all) = (file("s.csv"), file("c.csv"), file("s.json"));
    let paths = [runs[0].as_path(), runs[1].as_path()];
    done(&export(&["statistics", "--out", &out, "--controls", &controls], &paths));
    let rows = rows(Path::new(&out));
    let larvae = rows.iter().find(|r| r["quantity"] == "volume_um3" && r["grouping"] == "group" && r["specimen"] == "larva").unwrap();
    let volume = example("larva.json")["measurement"]["volume_um3"].as_f64().unwrap();
    assert_eq!((larvae["n"].as_str(), larvae["wells"].as_str(), larvae["sd"].as_str()), ("2", "r1/A01;r2/A01", "0.0"));
    assert_eq!(larvae["mean"].parse::<f64>().unwrap().to_bits(), volume.to_bits());
    assert!(self::rows(Path::new(&controls))[0]["reason"].contains("0 positive and 1 negative"));
    // The beads have flags.
    done(&export(&["statistics", "--out", &all, "--without-flagged"], &paths));
    let all = json(Path::new(&all));
    assert_eq!((&all["specimens"], &all["specimens_with_flags"], &all["modes"]), (&json!(4), &json!(2), &json!(["simulated"])));
    let diameter = all["quantities"].as_array().unwrap().iter().find(|q| q["name"] == "diameter_um").unwrap();
    assert_eq!((&diameter["groups"], diameter["left_out"].as_array().unwrap().len()), (&json!([]), 2), "only the beads have one");
}

/// Flags on every specimen.
#[test]
fn statistics_in_which_no_specimen_counts_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path(), "r1", "P-1", 4);
    let file = run.join("run.json");
    let flag = |code: &str| {
        let mut record = json(&file);
        for well in &mut record["wells"].as_array_mut().unwrap()[..2] {
            well["flags"] = json!([code]);
        }
        std::fs::write(&file, record.to_string()).unwrap();
    };
    let out = dir.path().join("s.csv");
    let statistics = |more: &[&str]| carved().args(["export", "statistics"]).arg(&run).arg("--out").arg(&out).args(more).output().unwrap();
    // A flag of a sound number, and one of a doubtful one.
    for (code, refused) in [("closure_undecided", vec!["--without-flagged"]), ("moved", vec!["--without-flagged", ""])] {
        flag(code);
        for more in refused {
            let output = statistics(&[more].into_iter().filter(|arg| !arg.is_empty()).collect::<Vec<_>>());
            assert_eq!(output.status.code(), Some(1), "{code} {more}");
            assert!(stderr(&output).contains("0 of 2 measured specimens count"), "{}", stderr(&output));
            assert!(stderr(&output).contains("--with-flagged counts") && !out.exists(), "{}", stderr(&output));
        }
        done(&statistics(&["--with-flagged"]));
        assert!(rows(&out).iter().any(|row| row["quantity"] == "volume_um3"));
        std::fs::remove_file(&out).unwrap();
    }
    let report = dir.path().join("report.html");
    done(&carved().arg("report").arg(&run).arg("--without-flagged").arg("--out").arg(&report).output().unwrap());
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("No specimen counts: all 2 have flags"));
    // On the card and in the table, also of a well without numbers.
    let remark = "left out by kim: an air bubble, &quot;large&quot; (tags: bubble, again)";
    assert_eq!(page.matches(remark).count(), 2, "{page}");
    assert!(page.contains("<td class=\"left\">excluded; empty; left out by kim"), "{page}");
    // A run without any number has no statistics, which is no mistake.
    let empty = plate(dir.path(), "r2", "P-2", 4);
    for well in ["A01", "A02"] {
        std::fs::remove_dir_all(empty.join(well)).unwrap();
    }
    done(&carved().args(["export", "statistics", "--without-flagged"]).arg(&empty).output().unwrap());
}

#[test]
fn the_reference_page_lists_the_columns() {
    let output = export(&["columns"], &[]);
    done(&output);
    generated::part("docs/tables.md", "columns", &String::from_utf8(output.stdout).unwrap());
}

/// Tables for the readers: more rows than polars looks at before it decides on types, and columns with gaps.
fn for_readers(folder: &Path, with_parquet: bool) -> Value {
    let data = folder.join("data");
    let runs = [plate(&data, "r1", "P-17", 120), plate(&data, "r2", "P-2", 4)];
    let (out, shape) = (folder.join("table.csv"), folder.join("shape.csv"));
    done(&carved().args(["export", "table"]).args(&runs).arg("--out").arg(&out).arg("--shape").arg(&shape).output().unwrap());
    if with_parquet {
        done(&carved().args(["export", "table"]).args(&runs).arg("--out").arg(folder.join("table.parquet")).output().unwrap());
    }
    let numbers = example("larva.json");
    json!({
        "rows": 124, "columns": rows(&out)[0].len(), "stations": rows(&shape).len(),
        "first": {
            "run": "r1", "plate_barcode": "P-17", "well": "A01", "compound": "DMSO, \"<dry>\"", "meta_clutch__id": "c \"1\"", "place": 1,
            "concentration": 0.1, "volume_um3": numbers["measurement"]["volume_um3"], "volume_sd_um3": numbers["measurement"]["volume_sd_um3"],
            "qc_passed": true, "software_dirty": false, "views": 21,
        },
        "kinds": {
            "run": "text", "plate_barcode": "text", "well": "text", "compound": "text", "meta_clutch__id": "text", "place": "number",
            "concentration": "number", "volume_um3": "number", "volume_sd_um3": "number", "qc_passed": "truth", "software_dirty": "truth",
            "views": "number", "flag_count": "number", "diameter_um": "number", "method_sha256": "text",
        },
    })
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn pandas_polars_and_duckdb_open_the_tables_without_options() {
    open_the_tables(false);
}

#[test]
#[cfg_attr(
    not(all(has_python, feature = "parquet")),
    ignore = "needs Python 3 with venv, and a carved with the feature parquet: make test-features"
)]
fn pandas_polars_and_duckdb_open_parquet_too() {
    open_the_tables(true);
}

fn open_the_tables(with_parquet: bool) {
    let python = match venv::python("readers", "duckdb, pandas, polars, pyarrow", "tests/readers/requirements.txt") {
        Ok(python) => python,
        Err(why) => return strict::cannot_run(&format!("pandas, polars and DuckDB cannot be installed: {why}")),
    };
    let dir = tempfile::tempdir().unwrap();
    let expected = for_readers(dir.path(), with_parquet);
    std::fs::write(dir.path().join("expected.json"), expected.to_string()).unwrap();
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/readers/read_tables.py");
    let output = Command::new(python).arg(program).arg(dir.path()).output().unwrap();
    assert!(output.status.success() && output.stdout.ends_with(b"read\n"), "{}", stderr(&output));
}

#[test]
#[cfg_attr(not(has_rscript), ignore = "no Rscript: apt-get install r-base-core")]
fn r_opens_the_tables_without_options() {
    let dir = tempfile::tempdir().unwrap();
    let expected = for_readers(dir.path(), false);
    let mut text = "column,kind,value\n".to_owned();
    for (column, value) in expected["first"].as_object().unwrap() {
        let kind = expected["kinds"][column].as_str().unwrap();
        let value = value.as_str().map_or_else(|| value.to_string(), |text| format!("\"{}\"", text.replace('"', "\"\"")));
        text.push_str(&format!("{column},{kind},{value}\n"));
    }
    std::fs::write(dir.path().join("expected.csv"), text).unwrap();
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/readers/read_tables.R");
    let output = Command::new("Rscript").arg(program).arg(dir.path()).output().unwrap();
    assert!(output.status.success() && output.stdout.ends_with(b"read\n"), "{}", stderr(&output));
}
