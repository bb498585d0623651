//! The views of a recording, as `ome-tiff` and `ome-zarr` write them.

use anyhow::{Context, ensure};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::Picture;
use carved_records::LedgerEntry;
use carved_store::{RecordingReader, StoreError};

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

/// Row and column of a well from 0, and those of the smallest plate of 96, 384 or 1536 wells that has it.
///
/// # Errors
/// A name that is no well.
pub(super) fn place(well: &str) -> anyhow::Result<([usize; 2], [usize; 2])> {
    let letters = well.bytes().take_while(u8::is_ascii_uppercase).count();
    let row = well[..letters].bytes().fold(0, |n, letter| 26 * n + usize::from(letter - b'A') + 1);
    let column: usize = well[letters..].parse().with_context(|| format!("{well:?} is no well; expected A01 to AF48"))?;
    ensure!(row > 0 && column > 0, "{well:?} is no well; expected A01 to AF48");
    let plates = [[8, 12], [16, 24], [32, 48]];
    let plate = plates.into_iter().find(|[rows, columns]| row <= *rows && column <= *columns);
    Ok(([row - 1, column - 1], plate.with_context(|| format!("{well:?} is beyond AF48, the last well of the largest plate"))?))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_well_lies_on_the_smallest_plate_that_has_it() {
        assert_eq!(place("A01").unwrap(), ([0, 0], [8, 12]));
        assert_eq!(place("H13").unwrap(), ([7, 12], [16, 24]));
        assert_eq!(place("AF48").unwrap(), ([31, 47], [32, 48]));
        for wrong in ["", "A", "7", "A00", "AG01", "a01"] {
            assert!(place(wrong).is_err(), "{wrong}");
        }
    }
}
