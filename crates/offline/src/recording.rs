//! Recordings to numbers.
//!
//! ```text
//! ledger ─ all views, or an even subset ─ frames ─ look (parallel) ─ observe, in their order ─ finish ──> surface, numbers
//!   live run: the same pipeline, frame by frame as they are taken ──────────────────────────┘
//! ```

use crate::Stopped;
use crate::frames::{self, View};
use crate::subset::{SubsetError, subset};
use carved_core::pipeline::{Finished, PipelineError, SegmentedFrame};
use carved_core::reconstruction::HullModel;
use carved_core::surface::Mesh;
use carved_records::{LedgerEntry, Method, SpecimenKind};
use carved_store::{MeasurementFile, Recording, RecordingReader, StoreError};

/// Why a recording has no numbers.
#[derive(Debug, thiserror::Error)]
pub enum NumbersError {
    /// The recording cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The frames give no numbers.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The views have no even subset of this number.
    #[error(transparent)]
    Subset(#[from] SubsetError),
    /// The caller ended the computation.
    #[error(transparent)]
    Stopped(#[from] Stopped),
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

/// The views of a finished recording that a method measures: all that count, or an even subset if the method asks for fewer.
///
/// # Errors
/// The turn is not finished, or has no such subset.
pub fn views<'a>(reader: &'a RecordingReader, method: &Method) -> Result<Vec<&'a LedgerEntry>, NumbersError> {
    reader.require_finished()?;
    let captured = reader.recording().method.asd;
    let counted: Vec<&LedgerEntry> = reader.recording().ledger.counted().collect();
    if method.asd == captured { Ok(counted) } else { Ok(subset(&counted, captured, method.asd)?) }
}

/// Surface and numbers of these views of a recording by this method. They are bit-identical to those of a live run. `seen` is called with
/// each view and its segmented frame, from several threads.
///
/// # Errors
/// A frame is missing or differs from its record, the pipeline gives no number, or `seen` ended the computation.
pub fn compute(
    reader: &RecordingReader,
    method: &Method,
    entries: &[&LedgerEntry],
    seen: impl Fn(&LedgerEntry, &SegmentedFrame) -> Result<(), Stopped> + Sync,
) -> Result<Computed, NumbersError> {
    let recording = reader.recording();
    let sphere = recording.specimen.specimen == SpecimenKind::Bead;
    let settings = method.pipeline(&recording.rig.camera, sphere).map_err(PipelineError::from)?;
    let settings = settings.compared_with(reader.empty_capillary()?.as_ref())?;
    let views: Vec<View> = entries.iter().map(|e| View { number: e.view, omega: e.omega, closure: e.closure }).collect();
    let Finished { mesh, record, hull } = frames::measure(
        settings,
        &views,
        recording.ended_after_views.is_some(),
        |at| Ok::<_, NumbersError>(reader.frame(entries[at])?),
        |at, segmented| Ok(seen(entries[at], segmented)?),
    )?;
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
