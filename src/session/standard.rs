//! The standard pictures of a measured larva: its left side and its back, head to the left.
//!
//! ```text
//! numbers ── which views, and which way up ──┐
//! the frames of these two views ─────────────┴─ turned, at one scale ── lateral.png, lateral.tif, dorsal.png, dorsal.tif
//! ```

use carved_core::geometry::BoxUm;
use carved_core::pipeline::standard::{Format, NoStandardView, StandardView};
use carved_core::profile::Picture;
use carved_pictures::{PictureError, standard};
use carved_records::LedgerEntry;
use carved_store::{MeasurementFile, RecordingReader, RecordingWriter, SpecimenFile, StoreError};

/// A standard picture with its files.
pub struct StandardPicture {
    pub view: StandardView,
    pub um_per_px: f64,
    /// With the scale bar below it.
    pub png: Vec<u8>,
    pub tiff: Vec<u8>,
}

/// Why there are no standard pictures.
#[derive(Debug, thiserror::Error)]
pub enum NoPictures {
    #[error(transparent)]
    View(#[from] NoStandardView),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Picture(#[from] PictureError),
}

/// Makes the standard pictures of a recording with these numbers.
///
/// # Errors
/// Head or back are not decided, or a frame is missing, altered or cannot be drawn.
pub fn of(reader: &RecordingReader, numbers: &MeasurementFile) -> Result<[StandardPicture; 2], NoPictures> {
    let recording = reader.recording();
    let BoxUm { min, max } = recording.method.box_um;
    let extent = |axis: usize| max[axis] - min[axis];
    // The capillary turns: what lies across it in one view is along the line of sight in another.
    let format = Format::of(&recording.rig.camera, [extent(0), extent(1).max(extent(2))]);
    let [lateral, dorsal] = numbers.record.standard_views(&recording.rig.camera)?;
    let made = |view: StandardView| -> Result<StandardPicture, NoPictures> {
        let gone = || StoreError::MissingFrame { path: reader.folder().join(format!("frames/view_{:03}.png", view.view)) };
        let entry: &LedgerEntry = recording.ledger.carved().find(|entry| entry.view == view.view).ok_or_else(gone)?;
        let frame = Picture::from_frame(&reader.frame(entry)?);
        let picture = standard::drawn(&frame, &format, |point| view.in_frame(point))?;
        let facts = [
            ("mode", carved_store::columns::mode(recording.mode).to_owned()),
            ("run", recording.run.clone()),
            ("well", recording.specimen.well.clone()),
            ("picture", view.aspect.name().to_owned()),
            ("view", view.view.to_string()),
            ("off_deg", format!("{:.2}", view.off_deg)),
            ("confidence", format!("{:.3}", view.confidence)),
            ("turned_deg", if view.is_turned { "180" } else { "0" }.to_owned()),
            ("um_per_px", format.um_per_px.to_string()),
        ];
        let name = format!("{} {} {}", recording.run, recording.specimen.well, view.aspect.name());
        let png = standard::png(&picture, format.um_per_px)?;
        let tiff = standard::tiff(&picture, format.um_per_px, &name, &facts)?;
        Ok(StandardPicture { view, um_per_px: format.um_per_px, png, tiff })
    };
    Ok([made(lateral)?, made(dorsal)?])
}

/// Adds the standard pictures to a recording that has its numbers. They are no result: the well keeps its numbers where they cannot be made,
/// and `carved export pictures` makes them later.
pub(super) fn add(writer: &mut RecordingWriter, numbers: &MeasurementFile) {
    let reader = writer.reader().map_err(NoPictures::from);
    let written = reader.and_then(|reader| of(&reader, numbers)).and_then(|pictures| {
        for picture in &pictures {
            for (is_tiff, bytes) in [(false, &picture.png), (true, &picture.tiff)] {
                writer.add_file(&SpecimenFile::standard_name(picture.view.aspect, is_tiff), bytes)?;
            }
        }
        Ok(())
    });
    match written {
        // The numbers say so.
        Ok(()) | Err(NoPictures::View(_)) => {}
        Err(error) => {
            let well = &writer.recording().specimen.well;
            tracing::warn!(%well, %error, "the standard pictures are not written; carved export pictures makes them");
        }
    }
}
