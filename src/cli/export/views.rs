//! The views of a recording, as `ome-tiff` and `ome-zarr` write them.

use crate::cli::measure::compute_and_see;
use crate::tables::statistics::QUANTITIES;
use anyhow::{Context, ensure};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::pipeline::SegmentedFrame;
use carved_core::profile::{Picture, Polygon};
use carved_records::{LedgerEntry, PlannedWell, PlateFormat, RunPlan, well_place};
use carved_store::columns::shape_estimator;
use carved_store::{MEASUREMENT, RecordingReader, StoreError, frames};
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// The newest take of every view, by number, without the view at 360 deg.
pub(super) fn by_number(reader: &RecordingReader) -> Vec<&LedgerEntry> {
    let mut views: Vec<&LedgerEntry> = reader.recording().ledger.carved().collect();
    views.sort_by_key(|entry| entry.view);
    views
}

/// Number of colours of pictures of this format: mosaics become colours.
pub(super) fn samples(format: PixelFormat) -> u32 {
    if format == PixelFormat::Mono8 { 1 } else { 3 }
}

/// The interleaved pixels of a frame; a mosaic is interpolated as for the measurement.
pub(super) fn interleaved(frame: &RawFrame) -> Vec<u8> {
    if frame.format().first_red().is_some() { Picture::from_frame(frame).to_rgb() } else { frame.bytes().to_vec() }
}

/// The pixels of a frame, one plane after another.
pub(super) fn planar(frame: &RawFrame) -> Vec<u8> {
    if frame.format() == PixelFormat::Mono8 {
        return frame.bytes().to_vec();
    }
    let pixels = interleaved(frame);
    (0..3).flat_map(|c| pixels.iter().skip(c).step_by(3).copied()).collect()
}

/// All that the plate map says about a well, as names and texts: its fields, and the cells of the lab's own columns, which `plan` has.
pub(super) fn plate_map_facts(planned: &PlannedWell, plan: Option<&RunPlan>) -> anyhow::Result<Vec<(String, String)>> {
    let Value::Object(fields) = serde_json::to_value(planned)? else { return Ok(Vec::new()) };
    let own = plan.and_then(|plan| plan.metadata.get("columns")?.as_object());
    let cells = own.into_iter().flatten().filter_map(|(name, cells)| Some((name.clone(), cells.get(&planned.well)?.clone())));
    let text = |value: Value| match value {
        Value::String(text) => Some(text),
        Value::Null => None,
        other => Some(other.to_string()),
    };
    let all = fields.into_iter().filter(|(name, _)| name != "well").chain(cells);
    Ok(all.filter_map(|(name, value)| Some((name, text(value)?))).collect())
}

/// The main numbers of a measured specimen, by the names of their columns, and its flags. Empty where it was not measured.
pub(super) fn measured_facts(reader: &RecordingReader) -> anyhow::Result<Vec<(String, String)>> {
    let Some(bytes) = reader.file(MEASUREMENT)? else { return Ok(Vec::new()) };
    let found: Value = serde_json::from_slice(&bytes).with_context(|| reader.folder().join(MEASUREMENT).display().to_string())?;
    let text = |key: &str, pointer: &str| match found.pointer(pointer)? {
        Value::String(text) => Some((key.to_owned(), text.clone())),
        Value::Array(list) => Some((key.to_owned(), list.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(";"))),
        Value::Null => None,
        other => Some((key.to_owned(), other.to_string())),
    };
    let of_quantities = QUANTITIES.iter().filter_map(|(name, _, pointer)| text(name, pointer));
    let others = [
        ("estimator", "/measurement/estimator"),
        ("volume_sd_um3", "/measurement/volume_sd_um3"),
        ("area_sd_um2", "/measurement/area_sd_um2"),
        ("flags", "/flags"),
    ];
    let of_shape = shape_estimator(&found).map(|estimator| ("shape_estimator".to_owned(), estimator.to_owned()));
    Ok(of_quantities.chain(others.into_iter().filter_map(|(key, pointer)| text(key, pointer))).chain(of_shape).collect())
}

/// The file of a view's profile in a recording.
pub(super) fn profile_name(view: usize) -> String {
    format!("profiles/view_{view:03}.png")
}

/// The profile of a view: 1 inside, 0 outside. `None` if the view has none.
///
/// # Errors
/// A file that cannot be read, was altered, or has another size than the camera.
pub(super) fn profile(reader: &RecordingReader, view: usize) -> anyhow::Result<Option<Vec<u8>>> {
    let name = profile_name(view);
    let Some(bytes) = reader.file(&name)? else { return Ok(None) };
    let mask = frames::decode_bytes(&reader.folder().join(&name), &bytes, PixelFormat::Mono8)?;
    let camera = &reader.recording().rig.camera;
    ensure!(
        (mask.width(), mask.height()) == (camera.width, camera.height),
        "{}: it is {} x {} px, the camera {} x {} px",
        reader.folder().join(&name).display(),
        mask.width(),
        mask.height(),
        camera.width,
        camera.height
    );
    Ok(Some(mask.bytes().iter().map(|&coverage| u8::from(coverage >= 128)).collect()))
}

/// The outlines of the views by number, found in the frames as the measurement does. A view without a profile has none.
///
/// # Errors
/// A recording that cannot be measured, as its numbers need all of its frames.
pub(super) fn outlines(reader: &RecordingReader) -> anyhow::Result<BTreeMap<u32, Vec<Polygon>>> {
    let found = Mutex::new(BTreeMap::new());
    let seen = |entry: &LedgerEntry, segmented: &SegmentedFrame| {
        if let (false, Ok(profile)) = (entry.closure, &segmented.profile) {
            found.lock().unwrap_or_else(PoisonError::into_inner).insert(entry.view, profile.edge.clone());
        }
    };
    compute_and_see(reader, &reader.recording().method, seen)?;
    Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Row and column of a well from 0.
///
/// # Errors
/// A name that is no well.
pub(super) fn place(well: &str) -> anyhow::Result<[usize; 2]> {
    let (row, column) = well_place(well).with_context(|| format!("{well:?} is no well; expected A01 to AF48"))?;
    Ok([row as usize, column as usize])
}

/// Rows and columns of the plate that these wells are shown on.
pub(super) fn size<'w>(stated: Option<u32>, wells: &(impl Iterator<Item = &'w str> + Clone)) -> [usize; 2] {
    let PlateFormat { rows, columns } = PlateFormat::shown(stated, wells);
    [rows as usize, columns as usize]
}

/// The frame of the second camera of a view that has one.
///
/// # Errors
/// The frame is missing or altered.
pub(super) fn second(reader: &RecordingReader, entry: &LedgerEntry) -> Result<RawFrame, StoreError> {
    reader
        .second(entry)?
        .ok_or_else(|| StoreError::MissingFrame { path: reader.folder().join(format!("second/view_{:03}.png", entry.view)) })
}
