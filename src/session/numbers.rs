//! Writes the files of a measured specimen, and puts its numbers into the status of its well.
//!
//! ```text
//! surface, numbers (of the live run, or of `carved_offline::recording`) ──┬─> mesh.ply, model.glb, measurement.json
//!                                                                         ├─> lateral.png, dorsal.png, also .tif, of a larva
//!                                                                         └─> the well's line of the status
//! ```

use super::{live, standard};
use crate::export;
use carved_core::measure::Estimator;
use carved_core::profile::Picture;
use carved_core::surface::{Colours, Mesh};
use carved_records::{LedgerEntry, Method, Mode, ReferenceStatus, SpecimenOutcome, WellStatus};
use carved_store::{MEASUREMENT, MeasurementFile, RecordingReader, RecordingWriter, ReplayWriter, StoreError, durable};
use std::path::Path;
use std::sync::Arc;

/// Allowed error of the model with colours. Its corners are closer together than those of the other one, because only they have colours.
const COLOURED_ERROR_UM: f64 = 0.1;

/// Writes the files of a measured specimen. Returns the model for the page.
///
/// # Errors
/// A file cannot be written.
pub fn write(writer: &mut RecordingWriter, mesh: &Mesh, file: &MeasurementFile) -> Result<Option<Arc<Vec<u8>>>, StoreError> {
    writer.add_file(MESH, &ply(mesh, file.mode)?)?;
    let model = live::model(mesh);
    if let Some(glb) = &model {
        writer.add_file("model.glb", glb)?;
    }
    writer.add_json(MEASUREMENT, file)?;
    standard::add(writer, file);
    Ok(model)
}

/// Name of the file with a specimen's surface.
pub const MESH: &str = "mesh.ply";

/// The surface as a run writes it.
///
/// # Errors
/// It cannot be encoded.
pub fn ply(mesh: &Mesh, mode: Mode) -> Result<Vec<u8>, StoreError> {
    let mut bytes = Vec::new();
    let unit = if mode == Mode::Simulated { "um (simulated)" } else { "um" };
    export::write_ply(mesh, unit, Estimator::Field.name(), &mut bytes).map_err(StoreError::io("encode", Path::new(MESH)))?;
    Ok(bytes)
}

/// Writes the numbers by another method beside the stored ones, which are not changed. `name` is that of the method, and of the results.
/// Returns false if they are there already.
///
/// # Errors
/// Results of another method, or other numbers, have this name. A file cannot be written.
pub fn write_beside(
    reader: &RecordingReader,
    name: &str,
    method: &Method,
    mesh: &Mesh,
    file: &MeasurementFile,
) -> Result<bool, StoreError> {
    let writer = ReplayWriter::new(reader.folder(), name);
    let numbers = durable::json_text(Path::new(MEASUREMENT), file)?;
    if writer.is_there(method, &numbers)? {
        return Ok(false);
    }
    writer.write(method, None, &[(MEASUREMENT, numbers), (MESH, ply(mesh, file.mode)?)])?;
    Ok(true)
}

/// The colour of each vertex of a surface in um, blended from the frames of the views that were carved with these numbers. Grey for a
/// vertex that no frame shows.
///
/// # Errors
/// A frame is missing or differs from its record.
pub fn colours(reader: &RecordingReader, file: &MeasurementFile, mesh: &Mesh) -> Result<Vec<[f64; 3]>, StoreError> {
    let projections = file.record.projections(&reader.recording().rig.camera);
    let mut colours = Colours::new(mesh);
    let mut entries: Vec<&LedgerEntry> = reader.recording().ledger.carved().collect();
    entries.sort_by_key(|entry| entry.view);
    for entry in entries {
        if let Some((_, projection)) = projections.iter().find(|(view, _)| *view == entry.view) {
            colours.add(projection, &Picture::from_frame(&reader.frame(entry)?));
        }
    }
    Ok(colours.finish().into_iter().map(|colour| colour.unwrap_or([128.0; 3])).collect())
}

/// The surface of a measured specimen as GLB, with the colours of its frames. `None` without a surface or without numbers.
///
/// # Errors
/// A file is missing, altered, or no such file.
pub fn coloured(reader: &RecordingReader) -> Result<Option<Vec<u8>>, StoreError> {
    let Some((numbers, ply)) = reader.closed_numbers().zip(reader.file(MESH)?) else { return Ok(None) };
    let path = reader.folder().join(MESH);
    let mesh = export::read_ply(&ply).map_err(|error| StoreError::Format {
        path: path.clone(),
        expected: "the surface of a specimen",
        found: error.to_string(),
    })?;
    let mesh = export::decimate(&mesh, COLOURED_ERROR_UM).mesh;
    let colours = colours(reader, &numbers, &mesh)?;
    let mut out = Vec::new();
    export::write_glb(&mesh, Some(&colours), export::Unit::M, &export::facts_of_mesh(), &mut out)
        .map_err(StoreError::io("encode", &path))?;
    Ok(Some(out))
}

/// Ends a well with its numbers. Views that do not show one turning specimen give no number: the well fails with the reason, and its files keep what
/// was computed.
pub fn end_well(result: &mut WellStatus, file: &MeasurementFile, views_planned: u32) {
    let m = &file.record.measurement;
    result.flags.clone_from(&file.record.flags);
    result.end(SpecimenOutcome::Succeeded, None);
    result.estimator = Some(m.estimator.name().to_owned());
    result.volume_um3 = Some(m.volume_um3);
    result.volume_sd_um3 = m.volume_sd_um3;
    result.area_um2 = Some(m.area_um2);
    result.area_sd_um2 = m.area_sd_um2;
    result.field_volume_um3 = Some(m.field_volume_um3);
    result.field_area_um2 = Some(m.field_area_um2);
    result.diameter_um = m.diameter_um;
    result.views = Some(m.views as u32);
    result.views_planned = Some(views_planned);
    result.residual_px = file.record.quality.as_ref().and_then(|quality| quality.check("residual_px")?.found);
    result.signal_per_nl = file.fluorescence.as_ref().map(|f| f.signal_per_nl);
    result.reference = file.reference.as_ref().and_then(ReferenceStatus::of).map(Box::new);
    if let Some(finding) = file.record.turn_findings.first() {
        result.fail_measured(&finding.to_string());
    }
}
