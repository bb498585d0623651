//! The views of a recording, as `ome-tiff` and `ome-zarr` write them.

use anyhow::Context;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::Picture;
use carved_records::{LedgerEntry, PlannedWell, PlateFormat, RunPlan, well_place};
use carved_store::{RecordingReader, StoreError};
use serde_json::Value;

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
    match frame.format() {
        PixelFormat::BayerRG8 => Picture::from_frame(frame).to_rgb(),
        PixelFormat::Mono8 | PixelFormat::RGB8Packed => frame.bytes().to_vec(),
    }
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
