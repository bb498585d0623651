//! A stored frame as the page shows it: in colour, no larger than it is drawn, and as JPEG. A raw frame of a megapixel has some 870 kB.

use crate::http::problem::Problem;
use axum::http::StatusCode;
use carved_core::frame::RawFrame;
use carved_core::profile::Picture;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, GrayImage, RgbImage};

/// Widths that can be asked for, px.
pub(super) const WIDTHS: std::ops::RangeInclusive<u32> = 32..=8192;

/// At this quality the outline of a larva looks as in the raw frame.
const QUALITY: u8 = 85;

/// Encodes a frame, scaled down to `width` if it is wider.
pub(super) fn jpeg(frame: &RawFrame, width: Option<u32>) -> Result<Vec<u8>, Problem> {
    let picture = Picture::from_frame(frame);
    let (w, h) = (frame.width(), frame.height());
    let whole = if picture.colours() == 1 {
        GrayImage::from_raw(w, h, picture.planes()[0].clone()).map(DynamicImage::from)
    } else {
        RgbImage::from_raw(w, h, picture.to_rgb()).map(DynamicImage::from)
    };
    let unshown = |why: String| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "store", why);
    let whole = whole.ok_or_else(|| unshown(format!("the colours of a frame of {w} x {h} px do not fill it")))?;
    let shown = match width.filter(|width| *width < w) {
        Some(width) => whole.thumbnail(width, u32::MAX),
        None => whole,
    };
    let mut out = Vec::new();
    shown
        .write_with_encoder(JpegEncoder::new_with_quality(&mut out, QUALITY))
        .map_err(|e| unshown(format!("the frame cannot be encoded: {e}")))?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::frame::PixelFormat;

    /// Left half dark, right half light, in a frame of the format.
    fn halves(format: PixelFormat) -> RawFrame {
        let n = format.bytes_per_pixel();
        let bytes = (0..64 * 48 * n).map(|i| if i / n % 64 < 32 { 20 } else { 220 }).collect();
        RawFrame::new(64, 48, format, bytes).unwrap()
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
        let shown = image::load_from_memory(&jpeg(&red, None).unwrap()).unwrap().to_rgb8();
        let [r, g, b] = shown.get_pixel(16, 16).0;
        assert!(r > 180 && g < 60 && b < 60, "{r} {g} {b}");
    }
}
