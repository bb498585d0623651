//! Every parser that bytes from outside reach.

use carved::cli::parsers;
use carved::config::Config;
use carved_core::frame::PixelFormat;
use carved_devices::rotation::parsers as controllers;
use carved_records::picture_name::{Pattern, read as read_picture_name};
use carved_records::plate_map::{Format, read as read_plate_map};
use carved_records::{Event, RunPlan};
use carved_store::{MeasurementFile, Pack, Recording, RunRecord, frames};
use std::hint::black_box;
use std::path::Path;

/// A parser by its name, which is also that of its folder in the corpus.
pub type Target = (&'static str, fn(&[u8]));

/// All parsers.
pub const TARGETS: [Target; 17] = [
    ("grbl", |bytes| drop(black_box(controllers::grbl(bytes)))),
    ("tmcl", |bytes| drop(black_box(controllers::tmcl(bytes)))),
    ("zaber", |bytes| drop(black_box(controllers::zaber(bytes)))),
    ("bridge", |bytes| drop(black_box(controllers::bridge(bytes)))),
    ("angles", |bytes| drop(black_box(parsers::angles(bytes)))),
    ("cameras", |bytes| drop(black_box(parsers::cameras(bytes)))),
    ("shapes", |bytes| drop(black_box(parsers::shapes(bytes)))),
    ("picture", |bytes| drop(black_box(parsers::picture(bytes)))),
    ("plate_csv", |bytes| drop(black_box(read_plate_map(bytes, Format::Csv, None)))),
    ("plate_json", |bytes| drop(black_box(read_plate_map(bytes, Format::Json, None)))),
    ("config", |bytes| {
        if let Ok(text) = std::str::from_utf8(bytes) {
            drop(black_box(Config::parse(text, Path::new("carved.toml"))));
        }
    }),
    ("records", |bytes| {
        drop(black_box(serde_json::from_slice::<Recording>(bytes)));
        drop(black_box(serde_json::from_slice::<MeasurementFile>(bytes)));
        drop(black_box(serde_json::from_slice::<RunRecord>(bytes)));
    }),
    ("journal", |bytes| {
        for line in bytes.split(|byte| *byte == b'\n') {
            drop(black_box(serde_json::from_slice::<Event>(line)));
        }
    }),
    ("plan", |bytes| {
        if let Ok(plan) = serde_json::from_slice::<RunPlan>(bytes) {
            plan.plate_map.iter().for_each(|well| drop(black_box(well.mistakes())));
        }
    }),
    ("picture_name", picture_name),
    ("pack", pack),
    ("frame", |bytes| {
        for format in [PixelFormat::Mono8, PixelFormat::BayerRG8, PixelFormat::RGB8Packed] {
            drop(black_box(frames::decode_bytes(Path::new("view.png"), bytes, format)));
        }
    }),
];

/// A pattern and a name, one per line.
fn picture_name(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let (pattern, name) = text.split_once('\n').unwrap_or(("", &text));
    black_box(read_picture_name(Path::new(name), Pattern::read(pattern).ok().as_ref()));
}

/// A pack is read from a file.
fn pack(bytes: &[u8]) {
    let Ok(file) = tempfile::NamedTempFile::with_suffix(".tar") else { return };
    if std::fs::write(file.path(), bytes).is_err() {
        return;
    }
    if let Ok(pack) = Pack::open(file.path()) {
        for name in pack.names() {
            drop(black_box(pack.read(name)));
        }
    }
}
