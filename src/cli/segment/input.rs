//! Reads a picture file of any common type as a frame of a camera.

use anyhow::bail;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_offline::picture::{step_grey, uneven_greens};
use carved_pictures::decode::{self, FRAMES};
use carved_records::sha256_hex;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use image::DynamicImage;
use std::path::Path;

/// A picture and what is known of its file.
pub(in crate::cli) struct Input {
    pub frame: RawFrame,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Bits per colour as counted by the camera.
    pub bits: u32,
}

/// Properties that all pictures of one camera with the same settings share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cli) struct Kind {
    pub width: u32,
    pub height: u32,
    pub format: PixelFormat,
    bits: u32,
}

impl Input {
    pub fn kind(&self) -> Kind {
        let Self { frame, bits, .. } = self;
        Kind { width: frame.width(), height: frame.height(), format: frame.format(), bits: *bits }
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {} px {} of {} bits", self.width, self.height, self.format.name(), self.bits)
    }
}

/// Values of `--bayer`.
pub(in crate::cli) fn mosaics() -> impl TypedValueParser<Value = PixelFormat> {
    let orders = PixelFormat::ALL.into_iter().filter_map(PixelFormat::mosaic);
    PossibleValuesParser::new(orders).try_map(|order| PixelFormat::of_mosaic(&order).ok_or("no such order"))
}

/// Alpha is ignored, because a transparent pixel need not show light.
pub(in crate::cli) fn read(path: &Path, mosaic: Option<PixelFormat>) -> anyhow::Result<Input> {
    decode(&decode::read(path)?, mosaic)
}

/// A page of a file, from 0.
pub(in crate::cli) fn read_page(path: &Path, page: usize, mosaic: Option<PixelFormat>) -> anyhow::Result<Input> {
    let bytes = decode::read_turn(path)?;
    frame(decode::decode_page(&bytes, page, FRAMES)?, &bytes, mosaic)
}

/// The picture in the bytes of a file.
pub(in crate::cli) fn decode(bytes: &[u8], mosaic: Option<PixelFormat>) -> anyhow::Result<Input> {
    frame(decode::decode(bytes, FRAMES)?, bytes, mosaic)
}

fn frame(image: DynamicImage, bytes: &[u8], mosaic: Option<PixelFormat>) -> anyhow::Result<Input> {
    let (width, height) = (image.width(), image.height());
    if width == 0 || height == 0 {
        bail!("found a picture of {width} x {height} px, expected one pixel or more");
    }
    let grey = !image.color().has_color();
    if mosaic.is_some() && !grey {
        bail!("found a picture in colour, expected a grey mosaic; leave --bayer out");
    }
    let format = if grey { mosaic.unwrap_or(PixelFormat::Mono8) } else { PixelFormat::RGB8Packed };
    let (pixels, bits) = match (image, grey) {
        (image @ (DynamicImage::ImageLuma8(_) | DynamicImage::ImageLumaA8(_)), _) => (image.into_luma8().into_raw(), 8),
        (image @ (DynamicImage::ImageRgb8(_) | DynamicImage::ImageRgba8(_)), _) => (image.into_rgb8().into_raw(), 8),
        (image, true) => eight_bits(&image.into_luma16().into_raw()),
        (image, false) => eight_bits(&image.into_rgb16().into_raw()),
    };
    if format == PixelFormat::Mono8
        && let Some(step) = step_grey(&pixels, width as usize)
    {
        bail!(
            "found what looks like a colour camera's mosaic: every second pixel differs from those beside it by {step:.1} grey values in the \
             mean; read it with --bayer=ORDER, or give the picture in colour"
        );
    }
    if let Some(mosaic) = mosaic.and_then(|format| uneven_greens(&pixels, width as usize, format)) {
        bail!("{mosaic}; give the order of the camera: --bayer=ORDER");
    }
    Ok(Input { frame: RawFrame::new(width, height, format, pixels)?, sha256: sha256_hex(bytes), bits })
}

/// Cameras with 8, 10, 12 and 14 bits store their counts unscaled in 16 bits: the largest count shows which it was.
fn eight_bits(counts: &[u16]) -> (Vec<u8>, u32) {
    let largest = counts.iter().copied().max().unwrap_or(0);
    let bits = [8, 10, 12, 14].into_iter().find(|bits| largest >> bits == 0).unwrap_or(16);
    (counts.iter().map(|c| (c >> (bits - 8)) as u8).collect(), bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_count_says_how_many_bits_the_camera_had() {
        for (largest, bits) in [(255, 8), (256, 10), (1023, 10), (1024, 12), (4095, 12), (4096, 14), (16_384, 16), (65_535, 16)] {
            let (pixels, found) = eight_bits(&[0, largest]);
            assert_eq!(found, bits, "{largest}");
            assert_eq!(pixels, [0, (u32::from(largest) >> (bits - 8)) as u8]);
        }
    }
}
