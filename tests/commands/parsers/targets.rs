//! Every parser that bytes from outside reach. The fuzzer in `fuzz/` has the same list.

use carved::cli::parsers;
use carved::config::{Config, references};
use carved::export::read_ply;
use carved::http::parsers::Requests;
use carved::report::html;
use carved::session::replays;
use carved::tables::{self, statistics::Flagged};
use carved_core::frame::PixelFormat;
use carved_devices::camera::answer_of_camera;
use carved_devices::rotation::parsers as controllers;
use carved_records::picture_name::{Pattern, read as read_picture_name};
use carved_records::plate_map::{Format, MappedColumn, ProposedColumn, propose, read as read_plate_map, read_mapped};
use carved_records::{Event, InstrumentState, Mode, RunPlan};
use carved_store::{
    MeasurementFile, Pack, PlateQueue, Recording, RecordingFiles, RecordingReader, RunRecord, StoreReader, StoredRun, calibrations, frames,
    gates, instrument_uuid,
};
use std::hint::black_box;
use std::path::Path;
use tempfile::TempDir;

/// A parser by its name, which is also that of its folder in the corpus.
pub type Target = (&'static str, fn(&[u8]));

/// All parsers.
pub const TARGETS: &[Target] = &[
    // What controllers and cameras send.
    ("grbl", |bytes| drop(black_box(controllers::grbl(bytes)))),
    ("tmcl", |bytes| drop(black_box(controllers::tmcl(bytes)))),
    ("zaber", |bytes| drop(black_box(controllers::zaber(bytes)))),
    ("vast_bridge", |bytes| drop(black_box(controllers::bridge(bytes)))),
    ("relay", |bytes| drop(black_box(controllers::relay(bytes)))),
    ("camera_control", |bytes| {
        black_box(answer_of_camera(bytes));
    }),
    // What clients send, and what a daemon answers to a client.
    ("http", http),
    ("daemon", |bytes| drop(black_box(parsers::answer_of_daemon(bytes)))),
    ("plan", |bytes| {
        if let Ok(plan) = serde_json::from_slice::<RunPlan>(bytes) {
            plan.plate_map.iter().for_each(|well| drop(black_box(well.mistakes())));
        }
    }),
    ("plate_csv", |bytes| drop(black_box(read_plate_map(bytes, Format::Csv, None, None)))),
    ("plate_json", |bytes| drop(black_box(read_plate_map(bytes, Format::Json, None, None)))),
    ("plate_columns", |bytes| {
        if let Ok(proposal) = propose(bytes) {
            let mapped = |c: ProposedColumn| MappedColumn { heading: c.heading, column: c.column, unit: c.unit };
            let columns: Vec<MappedColumn> = proposal.columns.into_iter().map(mapped).collect();
            drop(black_box(read_mapped(bytes, None, &columns)));
        }
    }),
    // Files of the lab.
    ("config", |bytes| {
        if let Ok(text) = std::str::from_utf8(bytes) {
            drop(black_box(Config::parse(text, Path::new("carved.toml"))));
        }
    }),
    ("references", |bytes| {
        if let Ok(text) = std::str::from_utf8(bytes) {
            drop(black_box(references::parse(text, Path::new("references.toml"))));
        }
    }),
    ("method", |bytes| {
        if let Ok(text) = std::str::from_utf8(bytes) {
            drop(black_box(replays::method(text)));
        }
    }),
    ("segment_settings", |bytes| drop(black_box(parsers::segment_settings(bytes)))),
    ("controls", |bytes| drop(black_box(parsers::controls(bytes)))),
    ("setup_answers", |bytes| drop(black_box(parsers::setup_answers(bytes)))),
    ("setup", |bytes| drop(black_box(parsers::setup(bytes)))),
    ("angles", |bytes| drop(black_box(parsers::angles(bytes)))),
    ("cameras", |bytes| drop(black_box(parsers::cameras(bytes)))),
    ("camera_of_pictures", |bytes| drop(black_box(parsers::camera_of_pictures(bytes)))),
    ("shapes", |bytes| drop(black_box(parsers::shapes(bytes)))),
    ("picture", |bytes| drop(black_box(parsers::picture(bytes)))),
    ("mask", |bytes| drop(black_box(parsers::mask(bytes)))),
    ("silhouette", |bytes| {
        if let Some(folder) = folder([("view", bytes)]) {
            drop(black_box(parsers::silhouette(&folder.path().join("view"))));
        }
    }),
    ("picture_name", picture_name),
    ("plate_of_pictures", |bytes| drop(black_box(parsers::plate_of_pictures(bytes)))),
    // The data folder, which other programs can change.
    ("records", |bytes| {
        drop(black_box(serde_json::from_slice::<Recording>(bytes)));
        drop(black_box(serde_json::from_slice::<MeasurementFile>(bytes)));
        drop(black_box(serde_json::from_slice::<RunRecord>(bytes)));
    }),
    ("stored_run", stored_run),
    ("journal", journal),
    ("sums", |bytes| {
        if let Some(folder) = folder([("SHA256SUMS", bytes), ("recording.json", b"{}")]) {
            drop(black_box(RecordingFiles::Folder(folder.path().into()).verified("recording.json")));
        }
    }),
    ("receipt", |bytes| {
        if let Some(root) = folder([("runs/r/archives/copy.json", bytes)]) {
            drop(black_box(StoreReader::new(root.path()).copies("r")));
        }
    }),
    ("calibration", calibration),
    ("instrument", |bytes| {
        if let Some(root) = folder([("instrument.json", bytes)]) {
            drop(black_box(instrument_uuid(root.path())));
        }
    }),
    ("queue", |bytes| {
        if let Some(root) = folder([("queue.json", bytes)]) {
            black_box(PlateQueue::open(root.path()));
        }
    }),
    ("pack", |bytes| {
        if let Some(folder) = folder([("two.tar", bytes)])
            && let Ok(pack) = Pack::open(&folder.path().join("two.tar"))
        {
            pack.names().for_each(|name| drop(black_box(pack.read(name))));
        }
    }),
    ("frame", |bytes| {
        for format in [PixelFormat::Mono8, PixelFormat::BayerRG8, PixelFormat::RGB8Packed] {
            drop(black_box(frames::decode_bytes(Path::new("view.png"), bytes, format)));
        }
    }),
    ("ply", |bytes| drop(black_box(read_ply(bytes)))),
];

/// A new folder with these files. `None` where there is no room for it.
fn folder<'f>(files: impl IntoIterator<Item = (&'f str, &'f [u8])>) -> Option<TempDir> {
    let folder = tempfile::tempdir().ok()?;
    for (name, content) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent()?).ok()?;
        std::fs::write(path, content).ok()?;
    }
    Some(folder)
}

/// A request to a daemon that has a stored run: its method and address on the first line, a header per line, and the body after an empty
/// line.
fn http(bytes: &[u8]) {
    thread_local! {
        static ROUTES: (Requests, TempDir) = {
            let [run, recording, measurement] = parts(include_bytes!("../data/parsers/stored_run/larva.txt"));
            let well = [("runs/a/A01/recording.json", recording), ("runs/a/A01/measurement.json", measurement)];
            let root = folder(well.into_iter().chain([("runs/a/run.json", run)])).expect("a folder");
            (Requests::new(root.path()).expect("the routes"), root)
        };
    }
    let status = ROUTES.with(|(routes, _)| routes.answer(bytes)).map_or(0, |status| status.as_u16());
    // A panic on a thread that reads the disk is answered like the end of the daemon.
    assert!(status != 503 || !bytes.starts_with(b"GET /v1/runs"), "a request that reads the disk ended badly");
}

/// A pattern and a name, one per line.
fn picture_name(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let (pattern, name) = text.split_once('\n').unwrap_or(("", &text));
    black_box(read_picture_name(Path::new(name), Pattern::read(pattern).ok().as_ref()));
}

/// Events, one per line, and the state that follows from them.
fn journal(bytes: &[u8]) {
    let events: Vec<Event> = bytes.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
    let state = InstrumentState::after(&events);
    let last = events.last().and_then(|event| event.body.time.parse().ok());
    if let (Some(now), Some(run)) = (last, &state.run) {
        black_box(state.paces.remaining("m", run.specimens().inside(), u32::MAX, now));
    }
}

/// `run.json`, `recording.json` and `measurement.json`, with a line `%` between them.
fn parts(mut bytes: &[u8]) -> [&[u8]; 3] {
    [(); 3].map(|()| {
        let end = bytes.windows(3).position(|three| three == b"\n%\n");
        let (part, rest) = end.map_or((bytes, &b""[..]), |end| (&bytes[..end], &bytes[end + 3..]));
        bytes = rest;
        part
    })
}

/// These files as tables and reports read them.
fn stored_run(bytes: &[u8]) {
    let [run, recording, measurement] = parts(bytes);
    let files = [("run.json", run), ("A01/recording.json", recording), ("A01/measurement.json", measurement)];
    let Some(folder) = folder(files.into_iter().filter(|(_, content)| !content.is_empty())) else { return };
    if let Ok(reader) = RecordingReader::open(&folder.path().join("A01")) {
        drop(black_box(reader.measurement()));
    }
    let Ok(run) = StoredRun::read(folder.path()) else { return };
    let runs = [run];
    for table in [tables::specimens(&runs), tables::stations(&runs)] {
        black_box(tables::csv::text(&table));
    }
    drop(black_box(tables::mihcsme::metadata(&runs[0])));
    drop(black_box(html::report(&runs, &[], Flagged::Included)));
}

/// What `carved calibrate` leaves, as the daemon and reports read it.
fn calibration(bytes: &[u8]) {
    let Some(folder) = folder([("beads.json", bytes), ("gate-1.json", bytes)]) else { return };
    let now = "2026-11-25T12:00:00Z".parse().unwrap_or_default();
    if let Ok(Some(found)) = calibrations::newest(folder.path(), "rig", Mode::Simulated) {
        black_box(found.status(30.0, now));
    }
    let gates = gates::every(folder.path()).unwrap_or_default();
    for gate in &gates {
        black_box(gate.stands(now));
    }
    drop(black_box(html::report(&[], &gates, Flagged::Included)));
}
