//! Computes the numbers of a recorded specimen from its frames, and writes the files of a measured specimen.
//!
//! ```text
//! ledger ─ frames ─ look (parallel) ─ observe, in their order ─ finish ──> surface, numbers ──┬─> mesh.ply, model.glb, measurement.json
//!   live run: the same pipeline, frame by frame as they are taken ──────────────────────────┘ └─> the well's line of the status
//! ```

use super::live;
use super::subset::{SubsetError, subset};
use crate::export;
use carved_core::pipeline::{Finished, Pipeline, PipelineError, SegmentedFrame};
use carved_core::profile::Picture;
use carved_core::reconstruction::HullModel;
use carved_core::surface::{Colours, Mesh};
use carved_records::{LedgerEntry, Method, Mode, ReferenceStatus, SpecimenKind, SpecimenOutcome, WellStatus};
use carved_store::{self, MEASUREMENT, MeasurementFile, Recording, RecordingReader, RecordingWriter, ReplayWriter, StoreError, durable};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Why a recording has no numbers.
#[derive(Debug, thiserror::Error)]
pub enum NumbersError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    #[error(transparent)]
    Subset(#[from] SubsetError),
    /// The caller of the computation ended it.
    #[error("the computation was cancelled")]
    Cancelled,
}

/// The views of a finished recording that this method measures: all captured ones, or an even subset if the method asks for fewer.
///
/// # Errors
/// A recording that is not finished, or views of which the method's number do not stand evenly around the turn.
pub fn entries<'a>(reader: &'a RecordingReader, method: &Method) -> Result<Vec<&'a LedgerEntry>, NumbersError> {
    reader.require_finished()?;
    let captured = reader.recording().method.asd;
    let counted: Vec<&LedgerEntry> = reader.recording().ledger.counted().collect();
    Ok(if method.asd == captured { counted } else { subset(&counted, captured, method.asd)? })
}

/// Surface and numbers of these views of a recording by this method. They are bit-identical to those of a live run. `looked` is called with
/// each view and its segmented frame, from several threads. An error of it ends the computation.
///
/// # Errors
/// A frame is missing or differs from its record, or the pipeline gives no number.
pub fn of_recording(
    reader: &RecordingReader,
    method: &Method,
    entries: &[&LedgerEntry],
    looked: impl Fn(&LedgerEntry, &SegmentedFrame) -> Result<(), NumbersError> + Sync,
) -> Result<(Mesh, MeasurementFile), NumbersError> {
    with_hull(reader, method, entries, looked).map(|found| (found.mesh, found.file))
}

/// What a recording gives.
pub struct Computed {
    /// The surface, um.
    pub mesh: Mesh,
    /// The numbers.
    pub file: MeasurementFile,
    /// The voxels that were counted.
    pub hull: HullModel,
}

/// As [`of_recording`], with the voxels that were counted.
///
/// # Errors
/// As [`of_recording`].
pub fn with_hull(
    reader: &RecordingReader,
    method: &Method,
    entries: &[&LedgerEntry],
    looked: impl Fn(&LedgerEntry, &SegmentedFrame) -> Result<(), NumbersError> + Sync,
) -> Result<Computed, NumbersError> {
    let recording = reader.recording();
    let sphere = recording.specimen.specimen == SpecimenKind::Bead;
    let settings = method.pipeline(&recording.rig.camera, sphere).map_err(PipelineError::from)?;
    let mut pipeline = Pipeline::new(settings.compared_with(reader.empty_capillary()?.as_ref())?)?;
    let look = |entry: &LedgerEntry| {
        let seen = pipeline.look(&reader.frame(entry)?)?;
        looked(entry, &seen)?;
        Ok::<_, NumbersError>(seen)
    };
    // Look at all frames before any is judged, so that the reported error is always the first one of the turn, on any number of threads.
    let seen = entries.par_iter().map(|entry| look(entry)).collect::<Vec<_>>().into_iter().collect::<Result<Vec<_>, _>>()?;
    for (entry, seen) in entries.iter().zip(&seen) {
        if entry.closure {
            pipeline.observe_closure(seen);
        } else {
            pipeline.observe(entry.view, entry.omega, seen)?;
        }
    }
    if recording.ended_after_views.is_some() {
        pipeline.end_early()?;
    }
    let Finished { mesh, record, hull } = pipeline.finish_with_hull()?;
    let mut fluorescence = None;
    if let Some(second) = &recording.rig.second {
        let mut frames = Vec::new();
        for entry in entries {
            frames.extend(reader.second(entry)?.map(|frame| (*entry, frame)));
        }
        let frames = frames.iter().map(|(entry, frame)| (*entry, frame));
        fluorescence = carved_store::fluorescence(&mesh, &record.measurement, &second.optics, frames);
    }
    let as_if = Recording { method: method.clone(), ..recording.clone() };
    let file = MeasurementFile { fluorescence, ..MeasurementFile::new(&as_if, &reader.references()?, record) };
    Ok(Computed { mesh, file, hull })
}

/// Writes the files of a measured specimen. Returns the model for the page.
///
/// # Errors
/// A file cannot be written.
pub fn keep(writer: &mut RecordingWriter, mesh: &Mesh, file: &MeasurementFile) -> Result<Option<Arc<Vec<u8>>>, StoreError> {
    writer.add_file(MESH, &ply(mesh, file.mode)?)?;
    let model = live::model(mesh);
    if let Some(glb) = &model {
        writer.add_file("model.glb", glb)?;
    }
    writer.add_json(MEASUREMENT, file)?;
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
    export::write_ply(mesh, unit, &mut bytes).map_err(StoreError::io("encode", Path::new(MESH)))?;
    Ok(bytes)
}

/// Writes the numbers by another method beside the stored ones, which are not changed. `name` is that of the method, and of the results.
/// Returns false if they are there already.
///
/// # Errors
/// Results of another method, or other numbers, have this name. A file cannot be written.
pub fn keep_beside(reader: &RecordingReader, name: &str, method: &Method, mesh: &Mesh, file: &MeasurementFile) -> Result<bool, StoreError> {
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

/// Ends a well with its numbers.
pub fn tell(result: &mut WellStatus, file: &MeasurementFile, views_planned: u32) {
    let m = &file.record.measurement;
    result.end(SpecimenOutcome::Succeeded, None);
    result.flags.clone_from(&file.record.flags);
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
}
