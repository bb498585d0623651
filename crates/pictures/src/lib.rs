//! Pictures for the page, the report and run folders: frames, profiles, models, and the standard pictures of larvae. A crate of its own,
//! because encoding must be fast also in a development build, where the daemon is not optimised.

pub mod decode;
pub mod model;
pub mod standard;

use carved_core::profile::{Mask, Picture};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, GrayImage, ImageEncoder, ImageError, RgbImage};

/// At this quality the outline of a larva looks as in the raw frame.
const QUALITY: u8 = 85;

/// Why a picture was not encoded.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The values of a picture do not fill it.
    #[error("the colours of a frame of {width} x {height} px do not fill it")]
    Incomplete {
        /// px
        width: u32,
        /// px
        height: u32,
    },
    /// The encoder refused the picture.
    #[error("the picture cannot be encoded: {0}")]
    Encoder(#[from] ImageError),
    /// The encoder of PNG refused the picture.
    #[error("the picture cannot be encoded as PNG: {0}")]
    Png(#[from] png::EncodingError),
    /// The encoder of TIFF refused the picture.
    #[error("the picture cannot be encoded as TIFF: {0}")]
    Tiff(#[from] tiff::TiffError),
}

/// A frame as JPEG: grey where it has one colour, and scaled down to `width` px if it is wider. A raw frame of a megapixel has some 870 kB.
///
/// # Errors
/// The values do not fill the picture, or it cannot be encoded.
pub fn jpeg(picture: &Picture, width: Option<u32>) -> Result<Vec<u8>, PictureError> {
    let (w, h) = (picture.width() as u32, picture.height() as u32);
    let whole = if picture.colours() == 1 {
        GrayImage::from_raw(w, h, picture.planes()[0].clone()).map(DynamicImage::from)
    } else {
        RgbImage::from_raw(w, h, picture.to_rgb()).map(DynamicImage::from)
    };
    let whole = whole.ok_or(PictureError::Incomplete { width: w, height: h })?;
    let shown = match width.filter(|width| *width < w) {
        Some(width) => whole.thumbnail(width, u32::MAX),
        None => whole,
    };
    let mut out = Vec::new();
    shown.write_with_encoder(JpegEncoder::new_with_quality(&mut out, QUALITY))?;
    Ok(out)
}

/// The edge of a profile as PNG on a transparent background. It is two pixels wide, so that it is visible when the page scales it down.
///
/// # Errors
/// It cannot be encoded.
pub fn outline(mask: &Mask) -> Result<Vec<u8>, PictureError> {
    const EDGE: [u8; 4] = [255, 64, 160, 255];
    let (width, height) = (mask.width(), mask.height());
    let mut rgba = vec![0u8; width * height * 4];
    let inside = |u: usize, v: usize| u < width && v < height && mask.get(u, v);
    for v in 0..height {
        for u in 0..width {
            let here = mask.get(u, v);
            if inside(u + 1, v) != here || inside(u, v + 1) != here {
                for (du, dv) in [(0, 0), (1, 0), (0, 1)] {
                    if u + du < width && v + dv < height {
                        let at = ((v + dv) * width + u + du) * 4;
                        rgba[at..at + 4].copy_from_slice(&EDGE);
                    }
                }
            }
        }
    }
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::NoFilter).write_image(
        &rgba,
        width as u32,
        height as u32,
        ExtendedColorType::Rgba8,
    )?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test may panic

    use super::*;
    use carved_core::frame::{PixelFormat, RawFrame};

    /// Left half dark, right half light, in a frame of the format.
    fn halves(format: PixelFormat) -> Picture {
        let n = format.bytes_per_pixel();
        let bytes = (0..64 * 48 * n).map(|i| if i / n % 64 < 32 { 20 } else { 220 }).collect();
        Picture::from_frame(&RawFrame::new(64, 48, format, bytes).unwrap())
    }

    #[test]
    fn every_format_is_shown_at_the_width_that_is_asked_for() {
        for (format, colours) in [(PixelFormat::Mono8, 1), (PixelFormat::BayerRG8, 3), (PixelFormat::RGB8Packed, 1)] {
            for (asked, expected) in [(None, [64, 48]), (Some(32), [32, 24]), (Some(64), [64, 48]), (Some(500), [64, 48])] {
                let bytes = jpeg(&halves(format), asked).unwrap();
                let shown = image::load_from_memory_with_format(&bytes, image::ImageFormat::Jpeg).unwrap();
                assert_eq!([shown.width(), shown.height()], expected, "{format:?} {asked:?}");
                assert_eq!(shown.color().channel_count(), colours, "{format:?}: three equal planes are encoded as grey");
                let grey = shown.to_luma8();
                let [dark, light] = [shown.width() / 4, 3 * shown.width() / 4].map(|u| grey.get_pixel(u, shown.height() / 2).0[0]);
                assert!(dark.abs_diff(20) < 8 && light.abs_diff(220) < 8, "{format:?} {asked:?}: {dark} {light}");
            }
        }
    }

    #[test]
    fn colours_stay_colours() {
        let red = RawFrame::new(32, 32, PixelFormat::RGB8Packed, [200u8, 30, 30].repeat(32 * 32)).unwrap();
        let shown = image::load_from_memory(&jpeg(&Picture::from_frame(&red), None).unwrap()).unwrap().to_rgb8();
        let [r, g, b] = shown.get_pixel(16, 16).0;
        assert!(r > 180 && g < 60 && b < 60, "{r} {g} {b}");
    }
}
