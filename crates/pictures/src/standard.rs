//! A part of a frame at one scale, as PNG with a scale bar and as TIFF, both with the size of a pixel.
//!
//! ```text
//!  frame ── place of each pixel of the picture ── cubic convolution ──┬── PNG   + margin with the scale bar   pHYs
//!                                                                     └── TIFF  as it is                      resolution, OME-XML
//! ```

use super::PictureError;
use carved_core::pipeline::standard::Format;
use carved_core::profile::Picture;
use image::{DynamicImage, GenericImage, GrayImage, Luma, RgbImage};
use std::fmt::Write as _;
use std::io::Cursor;
use tiff::encoder::colortype::{Gray8, RGB8};
use tiff::encoder::{Compression, DeflateLevel, Rational, TiffEncoder};
use tiff::tags::{ResolutionUnit, Tag};

/// What is beyond the frame is white: no place inside the capillary is.
const BEYOND: u8 = 255;
/// Length of the scale bar.
const BAR_UM: f64 = 500.0;
/// Height of the margin below the picture, and of the bar in it, px.
const MARGIN_PX: u32 = 24;
const BAR_PX: u32 = 4;
/// Distance of the bar from the border, and of its label from the bar, px.
const GAP_PX: u32 = 8;
/// Columns and rows of a letter, and the px of each of its dots.
const LETTER: [u32; 2] = [5, 7];
const DOT_PX: u32 = 2;
/// `500 um`: rows from the top, the leftmost dot in the highest of five bits.
const LABEL: [[u8; 7]; 6] = [
    [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
    [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110],
    [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110],
    [0; 7],
    [0b00000, 0b10001, 0b10001, 0b10001, 0b10011, 0b11101, 0b10000],
    [0b00000, 0b00000, 0b11010, 0b10101, 0b10101, 0b10101, 0b10101],
];

/// Draws the picture of this format. `in_frame` gives the place of a point of the picture in the frame (px, pixel centres at integers), for
/// um right of the middle of the picture and below it. Grey where the frame has one colour.
///
/// # Errors
/// The picture has no pixel.
pub fn drawn(frame: &Picture, format: &Format, in_frame: impl Fn([f64; 2]) -> Option<(f64, f64)>) -> Result<DynamicImage, PictureError> {
    let [width, height] = format.size;
    let planes = &frame.planes()[..frame.colours()];
    let mut pixels = Vec::with_capacity(width as usize * height as usize * planes.len());
    for row in 0..height {
        for column in 0..width {
            let place = in_frame(format.at_um([column, row]));
            pixels.extend(planes.iter().map(|plane| place.map_or(BEYOND, |place| sampled(plane, [frame.width(), frame.height()], place))));
        }
    }
    let made = if planes.len() == 1 {
        GrayImage::from_raw(width, height, pixels).map(DynamicImage::from)
    } else {
        RgbImage::from_raw(width, height, pixels).map(DynamicImage::from)
    };
    made.ok_or(PictureError::Incomplete { width, height })
}

/// The value between the pixels of a plane, by cubic convolution (Keys 1981, a = -1/2), which keeps edges as sharp as they are.
fn sampled(plane: &[u8], [width, height]: [usize; 2], (u, v): (f64, f64)) -> u8 {
    let is_inside = |at: f64, of: usize| (-0.5..=of as f64 - 0.5).contains(&at);
    if !is_inside(u, width) || !is_inside(v, height) {
        return BEYOND;
    }
    let ([from_u, of_u], [from_v, of_v]) = (taps(u), taps(v));
    // The border's pixel is repeated.
    let at = |from: f64, tap: usize, of: usize| (from + tap as f64).clamp(0.0, of as f64 - 1.0) as usize;
    let mut sum = 0.0;
    for (j, weight_v) in of_v.iter().enumerate() {
        let row = at(from_v[0], j, height) * width;
        sum += weight_v * of_u.iter().enumerate().map(|(i, weight)| weight * f64::from(plane[row + at(from_u[0], i, width)])).sum::<f64>();
    }
    sum.round().clamp(0.0, 255.0) as u8
}

/// The first of the four pixels around a place, and their weights.
fn taps(at: f64) -> [[f64; 4]; 2] {
    let first = at.floor() - 1.0;
    let weight = |tap: f64| {
        let away = (at - tap).abs();
        if away < 1.0 { (1.5 * away - 2.5) * away * away + 1.0 } else { ((-0.5 * away + 2.5) * away - 4.0) * away + 2.0 }
    };
    let pixels: [f64; 4] = std::array::from_fn(|i| first + i as f64);
    [pixels, pixels.map(weight)]
}

/// The picture with a white margin below it that has the scale bar, as PNG with the size of a pixel (`pHYs`).
///
/// # Errors
/// It cannot be encoded.
pub fn png(picture: &DynamicImage, um_per_px: f64) -> Result<Vec<u8>, PictureError> {
    let framed = with_bar(picture, um_per_px)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, framed.width(), framed.height());
    encoder.set_color(if framed.color().has_color() { png::ColorType::Rgb } else { png::ColorType::Grayscale });
    encoder.set_depth(png::BitDepth::Eight);
    let per_m = (1e6 / um_per_px).round() as u32;
    encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: per_m, yppu: per_m, unit: png::Unit::Meter }));
    let mut writer = encoder.write_header()?;
    writer.write_image_data(framed.as_bytes())?;
    writer.finish()?;
    Ok(bytes)
}

fn with_bar(picture: &DynamicImage, um_per_px: f64) -> Result<DynamicImage, PictureError> {
    let (width, height) = (picture.width(), picture.height());
    let mut margin = GrayImage::from_pixel(width, MARGIN_PX, Luma([u8::MAX]));
    // A bar that is longer than the picture is wide ends with it.
    let bar = ((BAR_UM / um_per_px).round() as u32).min(width);
    let mut fill = |[left, top]: [u32; 2], [wide, high]: [u32; 2]| {
        for (u, v) in (left..left + wide).flat_map(|u| (top..top + high).map(move |v| (u, v))) {
            if let Some(pixel) = margin.get_pixel_mut_checked(u, v) {
                *pixel = Luma([0]);
            }
        }
    };
    fill([GAP_PX, (MARGIN_PX - BAR_PX) / 2], [bar, BAR_PX]);
    let top = (MARGIN_PX - LETTER[1] * DOT_PX) / 2;
    for (letter, rows) in (0..).zip(LABEL) {
        let left = 2 * GAP_PX + bar + letter * (LETTER[0] + 1) * DOT_PX;
        for (row, bits) in (0..).zip(rows) {
            for column in (0..LETTER[0]).filter(|column| bits >> (LETTER[0] - 1 - column) & 1 == 1) {
                fill([left + column * DOT_PX, top + row * DOT_PX], [DOT_PX; 2]);
            }
        }
    }
    let mut framed = DynamicImage::new(width, height + MARGIN_PX, picture.color());
    framed.copy_from(picture, 0, 0)?;
    framed.copy_from(&DynamicImage::from(margin), 0, height)?;
    Ok(framed)
}

/// The picture alone as TIFF, with the size of a pixel in its resolution and in OME-XML, and its `name` and further facts there.
///
/// # Errors
/// It cannot be encoded.
pub fn tiff(picture: &DynamicImage, um_per_px: f64, name: &str, facts: &[(&str, String)]) -> Result<Vec<u8>, PictureError> {
    let [width, height] = [picture.width(), picture.height()];
    let description = xml(picture, um_per_px, name, facts);
    // Pixels per centimetre, to a thousandth.
    let per_cm = || Rational { n: (1e7 / um_per_px).round() as u32, d: 1000 };
    let mut out = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut out)?.with_compression(Compression::Deflate(DeflateLevel::Balanced));
    macro_rules! encode {
        ($colour:ty) => {{
            let mut image = encoder.new_image::<$colour>(width, height)?;
            image.encoder().write_tag(Tag::ImageDescription, description.as_str())?;
            image.resolution_unit(ResolutionUnit::Centimeter);
            image.x_resolution(per_cm());
            image.y_resolution(per_cm());
            image.write_data(picture.as_bytes())?;
        }};
    }
    if picture.color().has_color() {
        encode!(RGB8);
    } else {
        encode!(Gray8);
    }
    Ok(out.into_inner())
}

fn xml(picture: &DynamicImage, um_per_px: f64, name: &str, facts: &[(&str, String)]) -> String {
    const SCHEMA: &str = "http://www.openmicroscopy.org/Schemas/OME/2016-06";
    let (width, height, samples) = (picture.width(), picture.height(), picture.color().channel_count());
    let interleaved = samples == 3;
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        out,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"{SCHEMA}\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:schemaLocation=\"{SCHEMA} {SCHEMA}/ome.xsd\"><Image ID=\"Image:0\" Name=\"{name}\"><Pixels ID=\"Pixels:0\" \
         DimensionOrder=\"XYCZT\" Type=\"uint8\" SizeX=\"{width}\" SizeY=\"{height}\" SizeC=\"{samples}\" SizeZ=\"1\" SizeT=\"1\" \
         Interleaved=\"{interleaved}\" PhysicalSizeX=\"{um_per_px}\" PhysicalSizeXUnit=\"&#181;m\" PhysicalSizeY=\"{um_per_px}\" \
         PhysicalSizeYUnit=\"&#181;m\"><Channel ID=\"Channel:0:0\" SamplesPerPixel=\"{samples}\"/><TiffData/></Pixels>\
         <AnnotationRef ID=\"Annotation:0\"/></Image><StructuredAnnotations><MapAnnotation ID=\"Annotation:0\" \
         Namespace=\"carved\"><Value>",
        name = text(name),
    );
    for (key, value) in facts {
        let _ = write!(out, "<M K=\"{}\">{}</M>", text(key), text(value));
    }
    out.push_str("</Value></MapAnnotation></StructuredAnnotations></OME>");
    out
}

/// Text for XML in ASCII, as TIFF demands of a description.
fn text(raw: &str) -> String {
    raw.chars().fold(String::new(), |mut safe, c| {
        match c {
            ' '..='~' if !"&<>\"".contains(c) => safe.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => safe.push(' '),
            c => safe.push_str(&format!("&#{};", u32::from(c))),
        }
        safe
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test may panic

    use super::*;
    use carved_core::frame::{PixelFormat, RawFrame};

    /// An F in a frame of 60 x 40 px, dark on light.
    fn letter() -> Picture {
        let is_dark = |u: u32, v: u32| match (u, v) {
            (10..=15, 5..=34) | (16..=40, 5..=10) | (16..=30, 18..=22) => 20,
            _ => 220,
        };
        let bytes = (0..40).flat_map(|v| (0..60).map(move |u| is_dark(u, v))).collect();
        Picture::from_frame(&RawFrame::new(60, 40, PixelFormat::Mono8, bytes).unwrap())
    }

    fn format() -> Format {
        Format { um_per_px: 10.0, size: [80, 50] }
    }

    /// The frame's middle is the picture's.
    fn place(sign: f64) -> impl Fn([f64; 2]) -> Option<(f64, f64)> {
        move |[right, down]| Some((29.5 + sign * right / 10.0, 19.5 + sign * down / 10.0))
    }

    #[test]
    fn a_picture_that_is_turned_stands_on_its_head_and_is_no_mirror_image() {
        let upright = drawn(&letter(), &format(), place(1.0)).unwrap().to_luma8();
        let turned = drawn(&letter(), &format(), place(-1.0)).unwrap().to_luma8();
        assert_eq!(turned, image::imageops::rotate180(&upright));
        assert_eq!(upright.get_pixel(10 + 12, 5 + 30).0[0], 20, "the stem of the F");
        assert_eq!(upright.get_pixel(10 + 35, 5 + 30).0[0], 220);
        assert_eq!(upright.get_pixel(2, 2).0[0], BEYOND, "beyond the frame");
    }

    #[test]
    fn values_between_pixels_follow_a_slope() {
        let bytes: Vec<u8> = (0..20).flat_map(|v| (0..30).map(move |u| (3 * u + 2 * v) as u8)).collect();
        for (u, v) in [(10.25, 7.5), (3.0, 4.0), (20.9, 12.1)] {
            assert!((f64::from(sampled(&bytes, [30, 20], (u, v))) - (3.0 * u + 2.0 * v)).abs() <= 0.5, "{u} {v}");
        }
    }

    #[test]
    fn a_png_has_the_size_of_a_pixel_and_the_bar_below_the_picture() {
        let wide = Format { um_per_px: 10.0, size: [200, 50] };
        let picture = drawn(&letter(), &wide, place(1.0)).unwrap();
        let bytes = png(&picture, 10.0).unwrap();
        let reader = png::Decoder::new(Cursor::new(&bytes)).read_info().unwrap();
        let dims = reader.info().pixel_dims.unwrap();
        assert_eq!((dims.xppu, dims.yppu, dims.unit), (100_000, 100_000, png::Unit::Meter));
        let shown = image::load_from_memory(&bytes).unwrap().to_luma8();
        assert_eq!(shown.dimensions(), (200, 50 + MARGIN_PX));
        let above = image::imageops::crop_imm(&shown, 0, 0, 200, 50).to_image();
        assert_eq!(above, picture.to_luma8(), "nothing is drawn over the picture");
        let bar = (0..200).filter(|u| shown.get_pixel(*u, 50 + MARGIN_PX / 2).0[0] == 0).take_while(|u| *u < GAP_PX + 50).count();
        assert_eq!(bar, 50, "500 um");
        let label = (GAP_PX + 51..200).flat_map(|u| (50..50 + MARGIN_PX).map(move |v| (u, v)));
        assert!(label.filter(|(u, v)| shown.get_pixel(*u, *v).0[0] == 0).count() > 100, "the label");
    }

    #[test]
    fn a_tiff_has_the_size_of_a_pixel_and_its_facts() {
        let picture = drawn(&letter(), &format(), place(1.0)).unwrap();
        let bytes = tiff(&picture, 5.5, "r1 \"A01\" \u{b5}", &[("view", "7".into())]).unwrap();
        let mut decoder = tiff::decoder::Decoder::new(Cursor::new(&bytes)).unwrap();
        assert_eq!(decoder.dimensions().unwrap(), (80, 50));
        assert_eq!(decoder.get_tag_u32(Tag::ResolutionUnit).unwrap(), 3);
        let resolution = decoder.get_tag(Tag::XResolution).unwrap();
        assert!(format!("{resolution:?}").contains("1818182, 1000"), "{resolution:?}");
        let words = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap();
        assert!(words.contains("PhysicalSizeX=\"5.5\"") && words.contains("<M K=\"view\">7</M>"), "{words}");
        assert!(words.contains("Name=\"r1 &#34;A01&#34; &#181;\""), "{words}");
        let tiff::decoder::DecodingResult::U8(pixels) = decoder.read_image().unwrap() else { panic!("no bytes") };
        assert_eq!(pixels, picture.to_luma8().into_raw());
    }

    #[test]
    fn a_frame_with_colours_gives_a_picture_with_colours() {
        let red = RawFrame::new(32, 32, PixelFormat::RGB8Packed, [200u8, 30, 30].repeat(32 * 32)).unwrap();
        let picture = drawn(&Picture::from_frame(&red), &format(), |_| Some((10.0, 10.0))).unwrap();
        for bytes in [png(&picture, 5.0).unwrap(), tiff(&picture, 5.0, "", &[]).unwrap()] {
            assert_eq!(image::load_from_memory(&bytes).unwrap().to_rgb8().get_pixel(5, 5).0, [200, 30, 30]);
        }
    }
}
