//! Pixels that `image` does not read: palettes, floating point numbers, and JPEGs in brightness and colour difference. What they mean is
//! clear, or the picture is refused.

use super::tiff_pages::{Kind, Page, of_tiff};
use super::{DecodeError, Formats, MOST_ALLOCATED, decoder, jpeg, of_image};
use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, RgbImage, imageops};
use tiff::decoder::{Decoder, DecodingResult};

/// Colours of a palette that differ more are no grey with the tint of a lamp. Somebody has coloured the picture.
const MOST_TINT: u8 = 64;
/// A frame in grey values of 8 bits has a brighter pixel. Less may be a scale of another kind.
const LEAST_LIGHT: f64 = 16.0;

/// The picture of a page. `None`: `image` reads it.
pub(super) fn read(page: &Page, bytes: &[u8], formats: Formats) -> Result<Option<DynamicImage>, DecodeError> {
    match &page.kind {
        Kind::Palette { colours, said_at } => palette(page, bytes, colours, *said_at, formats).map(Some),
        Kind::Float => float(page, bytes, formats).map(Some),
        Kind::Jpegs => jpegs(page, bytes, formats).map(Some),
        Kind::Plain | Kind::Unread(_) => Ok(None),
    }
}

/// The numbers are read as if they were grey values.
fn palette(page: &Page, bytes: &[u8], colours: &[u16], said_at: usize, formats: Formats) -> Result<DynamicImage, DecodeError> {
    const BLACK_IS_ZERO: u16 = 1;
    let mut grey = bytes.to_vec();
    let value = if bytes.starts_with(b"II") { BLACK_IS_ZERO.to_le_bytes() } else { BLACK_IS_ZERO.to_be_bytes() };
    if let Some(said) = grey.get_mut(said_at..said_at + 2) {
        said.copy_from_slice(&value);
    }
    let decoder = decoder(&grey, ImageFormat::Tiff, Some(page), formats)?;
    let numbers = DynamicImage::from_decoder(decoder).map_err(|error| of_image(error, ImageFormat::Tiff, formats))?.into_luma8();
    // Some programs write the colours in 8 bits.
    let shift = if colours.iter().all(|colour| *colour < 256) { 0 } else { 8 };
    let colour = |number: u8, channel: usize| colours.get(channel * 256 + usize::from(number)).map_or(0, |colour| (colour >> shift) as u8);
    of_palette(&RgbImage::from_fn(numbers.width(), numbers.height(), |u, v| {
        let number = numbers.get_pixel(u, v).0[0];
        image::Rgb([0, 1, 2].map(|channel| colour(number, channel)))
    }))
}

/// A picture whose colours come from a palette: grey values, or those of a colour camera.
pub(super) fn of_palette(picture: &RgbImage) -> Result<DynamicImage, DecodeError> {
    let tint = |p: &image::Rgb<u8>| p.0.iter().max().unwrap_or(&0) - p.0.iter().min().unwrap_or(&0);
    match picture.pixels().map(tint).max().unwrap_or(0) {
        0 => Ok(GrayImage::from_fn(picture.width(), picture.height(), |u, v| image::Luma([picture.get_pixel(u, v).0[0]])).into()),
        most if most <= MOST_TINT => Ok(picture.clone().into()),
        _ => Err(DecodeError::Kind { why: "a picture whose palette has other colours than grey, as of a coloured look-up table,".into() }),
    }
}

/// Fractions of the full scale, or counts of 8 or 16 bits.
fn float(page: &Page, bytes: &[u8], formats: Formats) -> Result<DynamicImage, DecodeError> {
    let mut decoder = Decoder::new(page.reader(bytes)).map_err(|error| of_tiff(error, formats))?;
    let values: Vec<f64> = match decoder.read_image().map_err(|error| of_tiff(error, formats))? {
        DecodingResult::F32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::F64(values) => values,
        _ => return Err(DecodeError::Kind { why: "this kind of floating point numbers".into() }),
    };
    let (least, most) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), v| (least.min(*v), most.max(*v)));
    let are_counts = values.iter().all(|value| value.fract() == 0.0);
    let (width, height) = page.size;
    let eight = |scale: f64| {
        let pixels = values.iter().map(|value| (value * scale).round() as u8).collect();
        GrayImage::from_raw(width, height, pixels).map(DynamicImage::from)
    };
    let image = if values.iter().any(|value| !value.is_finite()) || least < 0.0 {
        None
    } else if most <= 1.0 && !are_counts {
        eight(255.0)
    } else if (LEAST_LIGHT..=255.0).contains(&most) {
        eight(1.0)
    } else if most > 255.0 && most <= 65_535.0 {
        let pixels = values.iter().map(|value| value.round() as u16).collect();
        ImageBuffer::from_raw(width, height, pixels).map(DynamicImage::ImageLuma16)
    } else {
        None
    };
    image.ok_or_else(|| DecodeError::Kind {
        why: format!(
            "a picture of floating point numbers from {least} to {most}{}, where 0 to 1, 0 to 255 or 0 to 65535 is expected,",
            if values.iter().all(|value| value.is_finite()) { "" } else { ", some of them no numbers" }
        ),
    })
}

fn jpegs(page: &Page, bytes: &[u8], formats: Formats) -> Result<DynamicImage, DecodeError> {
    let unreadable = |why: String| DecodeError::Unreadable { expected: formats.words, why };
    let ((width, height), (across, down)) = (page.size, page.piece);
    if across == 0 || down == 0 || u64::from(width).saturating_mul(u64::from(height)).saturating_mul(3) > MOST_ALLOCATED {
        return Err(unreadable(format!("it is {width} x {height} px in pieces of {across} x {down} px")));
    }
    let (columns, rows) = (width.div_ceil(across), height.div_ceil(down));
    let pieces = page.jpegs(bytes);
    if pieces.len() as u64 != u64::from(columns) * u64::from(rows) {
        return Err(unreadable(format!("it has {} pieces, expected {columns} x {rows}", pieces.len())));
    }
    let mut whole = RgbImage::new(width, height);
    for (at, piece) in (0..).zip(&pieces) {
        let picture = jpeg::decode(piece, formats)?.into_rgb8();
        let (u, v) = (at % columns * across, at / columns * down);
        let expected = (across.min(width - u), down.min(height - v));
        if picture.width() < expected.0 || picture.height() < expected.1 || picture.width() > across || picture.height() > down {
            let (found, (w, h)) = (picture.dimensions(), expected);
            return Err(unreadable(format!("a piece of it has {} x {} px, expected {w} x {h}", found.0, found.1)));
        }
        imageops::replace(&mut whole, &picture, u.into(), v.into());
    }
    Ok(whole.into())
}
