//! JPEG. `image` reads it leniently: what is missing becomes grey.

use super::entropy;
use super::{DecodeError, Formats, MOST_ALLOCATED};
use image::metadata::Orientation;
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

pub(super) fn decode(bytes: &[u8], formats: Formats) -> Result<DynamicImage, DecodeError> {
    let unreadable = |why: String| DecodeError::Unreadable { expected: formats.words, why };
    let incomplete = |why: &str| DecodeError::Incomplete { format: ImageFormat::Jpeg, why: why.into() };
    entropy::check(bytes)?;
    let options = DecoderOptions::default().set_strict_mode(true).set_max_width(usize::MAX).set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| unreadable(error.to_string()))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| unreadable("it states no size".into()))?;
    let is_grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let channels = if is_grey { 1 } else { 3 };
    // The decoder keeps numbers of 16 bits beside the pixels.
    let found = (width as u64).saturating_mul(height as u64).saturating_mul(3 * channels);
    if found > MOST_ALLOCATED {
        return Err(DecodeError::Large { width: width as u32, height: height as u32, found, most: MOST_ALLOCATED });
    }
    decoder.set_options(options.jpeg_set_out_colorspace(if is_grey { ColorSpace::Luma } else { ColorSpace::RGB }));
    let pixels = decoder.decode().map_err(|error| incomplete(&format!("its pixels are damaged or end too early ({error})")))?;
    let (w, h) = (width as u32, height as u32);
    let image = if is_grey {
        GrayImage::from_raw(w, h, pixels).map(DynamicImage::from)
    } else {
        RgbImage::from_raw(w, h, pixels).map(DynamicImage::from)
    };
    let mut image = image.ok_or_else(|| unreadable("its pixels do not fill it".into()))?;
    let orientation = decoder.exif().and_then(|exif| Orientation::from_exif_chunk(exif));
    image.apply_orientation(orientation.unwrap_or(Orientation::NoTransforms));
    Ok(image)
}
