//! Lossless raw frames as PNG: one grey channel for mono and Bayer mosaics, three channels for RGB.

use super::StoreError;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::Mask;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ColorType, ExtendedColorType, ImageEncoder};
use std::path::Path;

fn png(bytes: &[u8], width: u32, height: u32, color: ExtendedColorType, filter: FilterType) -> Result<Vec<u8>, StoreError> {
    let mut out = Vec::with_capacity(bytes.len());
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, filter)
        .write_image(bytes, width, height, color)
        .map_err(|e| StoreError::Format { path: "a frame in memory".into(), expected: "pixels that PNG can hold", found: e.to_string() })?;
    Ok(out)
}

pub fn encode(frame: &RawFrame) -> Result<Vec<u8>, StoreError> {
    let (color, filter) = match frame.format() {
        PixelFormat::RGB8Packed => (ExtendedColorType::Rgb8, FilterType::Sub),
        _ => (ExtendedColorType::L8, FilterType::Up),
    };
    png(frame.bytes(), frame.width(), frame.height(), color, filter)
}

pub fn encode_mask(mask: &Mask) -> Result<Vec<u8>, StoreError> {
    png(mask.data(), mask.width() as u32, mask.height() as u32, ExtendedColorType::L8, FilterType::NoFilter)
}

/// Reads a frame in the pixel format of the camera.
pub fn decode(path: &Path, format: PixelFormat) -> Result<RawFrame, StoreError> {
    let bytes = carved_files::read(path).map_err(StoreError::io("read", path))?;
    decode_bytes(path, &bytes, format)
}

/// The same of the bytes of the file `path`.
pub fn decode_bytes(path: &Path, bytes: &[u8], format: PixelFormat) -> Result<RawFrame, StoreError> {
    let wrong = |found: String| StoreError::Format { path: path.to_owned(), expected: "a PNG of a recorded frame", found };
    let image = carved_pictures::decode::decode(bytes, carved_pictures::decode::PNG).map_err(|e| wrong(e.to_string()))?;
    let expected = if format == PixelFormat::RGB8Packed { ColorType::Rgb8 } else { ColorType::L8 };
    if image.color() != expected {
        return Err(wrong(format!("{:?} pixels, {expected:?} for {}", image.color(), format.name())));
    }
    RawFrame::new(image.width(), image.height(), format, image.into_bytes()).map_err(|e| wrong(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_come_back_bit_for_bit_in_every_format() {
        let dir = tempfile::tempdir().unwrap();
        for format in PixelFormat::ALL {
            let bytes: Vec<u8> = (0..31 * 17 * format.bytes_per_pixel()).map(|i| (i * i % 251) as u8).collect();
            let frame = RawFrame::new(31, 17, format, bytes).unwrap();
            let path = dir.path().join(format.name());
            std::fs::write(&path, encode(&frame).unwrap()).unwrap();
            assert_eq!(decode(&path, format).unwrap(), frame);
        }
        let grey = dir.path().join("Mono8");
        assert!(decode(&grey, PixelFormat::RGB8Packed).is_err(), "a grey file is no RGB frame");
        std::fs::write(&grey, b"not an image").unwrap();
        assert!(decode(&grey, PixelFormat::Mono8).unwrap_err().to_string().contains("Mono8"));
    }
}
