//! Pictures whose last part was never written: a program reserved the space of the file, and its pixels end within a row.
//!
//! ```text
//!  noise noise noise noise
//!  noise noise 0 0 0 0 0 0     a program that fills rows begins at the left border; a file ends anywhere
//!  0 0 0 0 0 0 0 0 0 0 0 0
//! ```

use super::DecodeError;
use image::{DynamicImage, ImageFormat};

/// Rows above the end that show what pixels and borders are like.
const ROWS_ABOVE: usize = 4;
/// Pixels of a row that end the picture, at least.
const LEAST_RUN: usize = 8;
/// Step to what lies before, at least, as a share of the range.
const LEAST_STEP: f64 = 1.0 / 16.0;
/// Largest share of pixels that equal the one beside them in a picture with noise.
const MOST_EQUAL: f64 = 0.6;

/// Refuses a picture with noise whose last pixels, from within a row on, all have one value.
pub(super) fn check(image: &DynamicImage, format: ImageFormat) -> Result<(), DecodeError> {
    let channels = usize::from(image.color().channel_count());
    let width = image.width() as usize * channels;
    let found = match image {
        DynamicImage::ImageLuma16(_) | DynamicImage::ImageRgb16(_) => {
            let samples = image.as_flat_samples_u16().map(|flat| flat.samples.to_vec()).unwrap_or_default();
            begin(&samples, width, channels, f64::from(u16::MAX))
        }
        DynamicImage::ImageLuma8(_) | DynamicImage::ImageRgb8(_) => {
            let samples: Vec<u16> = image.as_bytes().iter().map(|byte| u16::from(*byte)).collect();
            begin(&samples, width, channels, f64::from(u8::MAX))
        }
        _ => None,
    };
    match found {
        None => Ok(()),
        Some((at, value)) => {
            let (row, column) = (at / width, at % width / channels);
            Err(DecodeError::Incomplete {
                format,
                why: format!("from row {row}, column {column} on (counted from 0) all its pixels are {value}"),
            })
        }
    }
}

/// Where the unwritten part begins, and its value.
fn begin(samples: &[u16], width: usize, channels: usize, range: f64) -> Option<(usize, u16)> {
    let value = *samples.last()?;
    let run = |end: usize| samples[..end].iter().rev().take_while(|sample| **sample == value).count();
    let at = samples.len() - run(samples.len());
    let (row, partial) = (at / width, width - at % width);
    if at.is_multiple_of(width) || partial < LEAST_RUN * channels || row < ROWS_ABOVE {
        return None;
    }
    // A border of the picture, or a part without light, is as wide in the rows above.
    let above = (row - ROWS_ABOVE..row).map(|above| run((above + 1) * width).min(width)).max()?;
    let rows = &samples[(row - ROWS_ABOVE) * width..at];
    let equal = rows.iter().zip(rows.iter().skip(channels)).filter(|(a, b)| a == b).count();
    let before = &samples[at.saturating_sub(LEAST_RUN * channels)..at];
    let mean = before.iter().map(|sample| f64::from(*sample)).sum::<f64>() / before.len() as f64;
    let is_unlike = (mean - f64::from(value)).abs() >= LEAST_STEP * range;
    (partial > above + LEAST_RUN * channels && is_unlike && (equal as f64) <= MOST_EQUAL * rows.len() as f64).then_some((at, value))
}
