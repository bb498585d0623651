//! OME-TIFF: one directory per picture, and OME-XML (2016-06) in the first one.
//!
//! ```text
//!  Image 0  camera          T = views by number, C = 1 grey or 3 colours of one channel
//!  Image 1  second camera   if there is one
//!  Image 2  profile         if it was asked for: 1 inside, 0 outside
//!  Plate ── Well ── WellSample ── Image        Plane ── DoubleAnnotation   angle of the view, deg
//!                                  └─ ROI      polygons of a view, if they were asked for
//! ```
//! The text is ASCII, as TIFF demands of a description; other letters are character references. A file of 4 GB and more is a BigTIFF.

use super::CORNER_PX;
use carved_core::profile::Polygon;
use std::fmt::Write as _;
use std::io::{Cursor, Seek, Write};
use tiff::TiffError;
use tiff::encoder::colortype::{Gray8, RGB8};
use tiff::encoder::{Compression, DeflateLevel, ImageEncoder, Rational, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::{ResolutionUnit, Tag};

/// Namespace of the annotations with the angle of a view, deg.
pub const OMEGA: &str = "carved/omega_deg";

/// The pictures of one camera.
#[derive(Debug, Clone)]
pub struct Stack {
    /// Name of the channel.
    pub channel: String,
    /// Pixels along u and v.
    pub size: [u32; 2],
    /// 1 for grey pictures, 3 for colours.
    pub samples: u32,
    /// Size of a pixel at the axis of rotation along u and v, um.
    pub pixel_um: [f64; 2],
    /// Number and angle (deg) of each view, in the order of the pictures.
    pub views: Vec<(u32, f64)>,
    /// Outlines of each view in px, pixel centres at integers, in the order of the pictures. May be shorter than `views`.
    pub outlines: Vec<Vec<Polygon>>,
}

/// The specimen of a file.
#[derive(Debug, Clone)]
pub struct Subject {
    /// Name of the run, which names the plate.
    pub run: String,
    /// `A01` to `AF48`.
    pub well: String,
    /// Row and column from 0.
    pub place: [usize; 2],
    /// Rows and columns of the plate.
    pub plate: [usize; 2],
    /// Time of the recording, RFC 3339, UTC.
    pub started: String,
    /// Further facts.
    pub facts: Vec<(String, String)>,
}

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
pub enum OmeTiffError<E: std::error::Error + 'static> {
    /// The encoder.
    #[error("the pictures cannot be written as TIFF: {0}")]
    Tiff(#[from] TiffError),
    /// A picture cannot be had.
    #[error(transparent)]
    Picture(E),
}

/// The bytes of a file. `picture` gives the interleaved pixels of a stack's view, by their numbers in the lists.
///
/// # Errors
/// Whatever `picture` returns, and pictures of another size than stated.
pub fn ome_tiff<E: std::error::Error + 'static>(
    subject: &Subject,
    stacks: &[Stack],
    picture: impl FnMut(usize, usize) -> Result<Vec<u8>, E>,
) -> Result<Vec<u8>, OmeTiffError<E>> {
    // Deflate may lengthen what it cannot compress, by less than this room.
    const CLASSIC_BYTES: u64 = 4_000_000_000;
    let of = |s: &Stack| u64::from(s.samples) * s.size.iter().map(|&n| u64::from(n)).product::<u64>() * s.views.len() as u64;
    let mut out = Cursor::new(Vec::new());
    if stacks.iter().map(of).sum::<u64>() < CLASSIC_BYTES {
        write(TiffEncoder::<_, TiffKindStandard>::new_generic(&mut out)?, subject, stacks, picture)?;
    } else {
        write(TiffEncoder::<_, TiffKindBig>::new_generic(&mut out)?, subject, stacks, picture)?;
    }
    Ok(out.into_inner())
}

fn write<W: Write + Seek, K: TiffKind, E: std::error::Error + 'static>(
    tiff: TiffEncoder<W, K>,
    subject: &Subject,
    stacks: &[Stack],
    mut picture: impl FnMut(usize, usize) -> Result<Vec<u8>, E>,
) -> Result<(), OmeTiffError<E>> {
    let mut tiff = tiff.with_compression(Compression::Deflate(DeflateLevel::Balanced));
    let mut description = Some(xml(subject, stacks));
    for (number, stack) in stacks.iter().enumerate() {
        for view in 0..stack.views.len() {
            let pixels = picture(number, view).map_err(OmeTiffError::Picture)?;
            let [width, height] = stack.size;
            if stack.samples == 3 {
                let mut image = tiff.new_image::<RGB8>(width, height)?;
                tag(&mut image, stack, description.take())?;
                image.write_data(&pixels)?;
            } else {
                let mut image = tiff.new_image::<Gray8>(width, height)?;
                tag(&mut image, stack, description.take())?;
                image.write_data(&pixels)?;
            }
        }
    }
    Ok(())
}

fn tag<W: Write + Seek, C: tiff::encoder::colortype::ColorType, K: TiffKind>(
    image: &mut ImageEncoder<W, C, K>,
    stack: &Stack,
    description: Option<String>,
) -> Result<(), TiffError> {
    if let Some(text) = description {
        image.encoder().write_tag(Tag::ImageDescription, text.as_str())?;
    }
    // Pixels per centimetre, to a thousandth.
    let per_cm = |um: f64| Rational { n: (1e7 / um).round() as u32, d: 1000 };
    image.resolution_unit(ResolutionUnit::Centimeter);
    image.x_resolution(per_cm(stack.pixel_um[0]));
    image.y_resolution(per_cm(stack.pixel_um[1]));
    Ok(())
}

/// Text for an attribute or an element. A control character that XML does not have becomes a space.
fn text(raw: &str) -> String {
    let mut safe = String::with_capacity(raw.len());
    for c in raw.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            ' '..='~' => safe.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => safe.push(' '),
            c => safe.push_str(&format!("&#{};", u32::from(c))),
        }
    }
    safe
}

fn xml(subject: &Subject, stacks: &[Stack]) -> String {
    const SCHEMA: &str = "http://www.openmicroscopy.org/Schemas/OME/2016-06";
    let mut out = String::new();
    let [rows, columns] = subject.plate;
    let [row, column] = subject.place;
    let (run, well) = (text(&subject.run), text(&subject.well));
    // Writing to a string cannot fail.
    let _ = write!(
        out,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"{SCHEMA}\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:schemaLocation=\"{SCHEMA} {SCHEMA}/ome.xsd\" Creator=\"carved {}\"><Plate ID=\"Plate:0\" Name=\"{run}\" Rows=\"{rows}\" \
         Columns=\"{columns}\" RowNamingConvention=\"letter\" ColumnNamingConvention=\"number\">\
         <Well ID=\"Well:0\" Row=\"{row}\" Column=\"{column}\">",
        env!("CARGO_PKG_VERSION")
    );
    for number in 0..stacks.len() {
        let _ = write!(out, "<WellSample ID=\"WellSample:{number}\" Index=\"{number}\"><ImageRef ID=\"Image:{number}\"/></WellSample>");
    }
    out.push_str("</Well></Plate>");
    let (mut annotations, mut directory, mut all_rois) = (String::new(), 0, String::new());
    for (number, stack) in stacks.iter().enumerate() {
        let (planes, tiff_data) = planes(stack, &mut directory, &mut annotations);
        let [width, height] = stack.size;
        let [x, y] = stack.pixel_um;
        let samples = stack.samples;
        let _ = write!(
            out,
            "<Image ID=\"Image:{number}\" Name=\"{run} {well} {channel}\"><AcquisitionDate>{started}</AcquisitionDate>\
             <Description>Views of one turn about the axis of the capillary. T counts them; their angles are annotations of the \
             planes.</Description><Pixels ID=\"Pixels:{number}\" DimensionOrder=\"XYCZT\" Type=\"uint8\" SizeX=\"{width}\" SizeY=\"{height}\" \
             SizeC=\"{samples}\" SizeZ=\"1\" SizeT=\"{views}\" Interleaved=\"{interleaved}\" PhysicalSizeX=\"{x}\" PhysicalSizeXUnit=\"&#181;m\" \
             PhysicalSizeY=\"{y}\" PhysicalSizeYUnit=\"&#181;m\"><Channel ID=\"Channel:{number}:0\" Name=\"{channel}\" \
             SamplesPerPixel=\"{samples}\"/>{tiff_data}{planes}</Pixels>{roi_refs}<AnnotationRef ID=\"Annotation:facts\"/></Image>",
            channel = text(&stack.channel),
            started = text(&subject.started),
            roi_refs = rois(number, stack, &mut all_rois),
            views = stack.views.len(),
            interleaved = samples == 3,
        );
    }
    let _ = write!(out, "<StructuredAnnotations>{annotations}<MapAnnotation ID=\"Annotation:facts\" Namespace=\"carved\"><Value>");
    for (key, value) in &subject.facts {
        let _ = write!(out, "<M K=\"{}\">{}</M>", text(key), text(value));
    }
    out.push_str("</Value></MapAnnotation></StructuredAnnotations>");
    out.push_str(&all_rois);
    out.push_str("</OME>");
    out
}

/// The outlines of a stack as regions, one for each view that has some, and the references of its image to them.
fn rois(number: usize, stack: &Stack, all: &mut String) -> String {
    let mut references = String::new();
    for (t, (polygons, (view, _))) in stack.outlines.iter().zip(&stack.views).enumerate().filter(|(_, (polygons, _))| !polygons.is_empty())
    {
        let _ = write!(references, "<ROIRef ID=\"ROI:{number}:{t}\"/>");
        let _ = write!(all, "<ROI ID=\"ROI:{number}:{t}\" Name=\"view {view}\"><Union>");
        for (at, polygon) in polygons.iter().enumerate() {
            let points: Vec<String> = polygon.vertices.iter().map(|[u, v]| format!("{:.3},{:.3}", u + CORNER_PX, v + CORNER_PX)).collect();
            let points = points.join(" ");
            let _ = write!(all, "<Polygon ID=\"Shape:{number}:{t}:{at}\" TheZ=\"0\" TheT=\"{t}\" Points=\"{points}\"/>");
        }
        all.push_str("</Union></ROI>");
    }
    references
}

/// The planes of a stack, and which directory of the file has each. Adds the angles to the annotations.
fn planes(stack: &Stack, directory: &mut usize, annotations: &mut String) -> (String, String) {
    let (mut planes, mut tiff_data) = (String::new(), String::new());
    for (t, (view, omega_deg)) in stack.views.iter().enumerate() {
        let ifd = *directory;
        let _ = write!(tiff_data, "<TiffData IFD=\"{ifd}\" FirstC=\"0\" FirstZ=\"0\" FirstT=\"{t}\" PlaneCount=\"1\"/>");
        let _ = write!(planes, "<Plane TheZ=\"0\" TheC=\"0\" TheT=\"{t}\"><AnnotationRef ID=\"Annotation:{ifd}\"/></Plane>");
        let _ = write!(
            annotations,
            "<DoubleAnnotation ID=\"Annotation:{ifd}\" Namespace=\"{OMEGA}\"><Description>view {view}</Description><Value>{omega_deg}</Value></DoubleAnnotation>"
        );
        *directory += 1;
    }
    (planes, tiff_data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_ascii_and_well_formed_whatever_a_plate_map_says() {
        assert_eq!(text("a<b> & \"c\" \u{b5}m\u{1}\n\u{ffff}"), "a&lt;b&gt; &amp; &quot;c&quot; &#181;m   ");
    }
}
