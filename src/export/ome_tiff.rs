//! OME-TIFF: one directory per picture, and OME-XML (2016-06) in the first one.
//!
//! ```text
//!  Plate ── Well ── WellSample ── Image     one of each camera, and the profiles if they were asked for
//!                                  ├─ Pixels ── Plane ── DoubleAnnotation   angle of the view, deg
//!                                  │   T = views by number, C = 1 grey or 3 colours of one channel
//!                                  ├─ ROI             polygons of a view, if they were asked for
//!                                  └─ MapAnnotation   facts of the well
//! ```
//! The text is ASCII, as TIFF demands of a description; other letters are character references. A file of 4 GB and more is a BigTIFF.

use super::CORNER_PX;
use carved_core::profile::Polygon;
use quick_xml::events::{BytesDecl, BytesText, Event};
use std::io::{self, Seek, Write};
use tiff::TiffError;
use tiff::encoder::colortype::{Gray8, RGB8};
use tiff::encoder::{Compression, DeflateLevel, ImageEncoder, Rational, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::{ResolutionUnit, Tag};

/// Namespace of the annotations with the angle of a view, deg.
pub const OMEGA: &str = "carved/omega_deg";

const SCHEMA: &str = "http://www.openmicroscopy.org/Schemas/OME/2016-06";

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

/// A specimen of a file.
#[derive(Debug, Clone)]
pub struct Subject {
    /// `A01` to `AF48`.
    pub well: String,
    /// Row and column from 0.
    pub place: [usize; 2],
    /// Time of the recording, if it is known.
    pub started: Option<jiff::Timestamp>,
    /// Further facts.
    pub facts: Vec<(String, String)>,
    /// Its pictures, one stack per camera.
    pub stacks: Vec<Stack>,
}

/// The specimens of a file and their plate.
#[derive(Debug, Clone)]
pub struct Plate {
    /// Name of the run, which names the plate.
    pub run: String,
    /// Rows and columns.
    pub size: [usize; 2],
    /// One per well.
    pub subjects: Vec<Subject>,
}

/// Which picture of a plate is meant, by the numbers in its lists.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Of the subject.
    pub subject: usize,
    /// Of its stack.
    pub stack: usize,
    /// Of the view in the stack.
    pub view: usize,
}

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
#[error("the pictures cannot be written as TIFF: {0}")]
pub struct OmeTiffError(#[from] TiffError);

impl From<io::Error> for OmeTiffError {
    fn from(error: io::Error) -> Self {
        Self(error.into())
    }
}

/// Writes a file. `picture` gives the interleaved pixels of a view; only one picture at a time is in memory.
///
/// # Errors
/// Whatever `picture` returns, pictures of another size than stated, and what `out` refuses.
pub fn ome_tiff<E: From<OmeTiffError>>(
    out: impl Write + Seek,
    plate: &Plate,
    picture: impl FnMut(Place) -> Result<Vec<u8>, E>,
) -> Result<(), E> {
    // Deflate may lengthen what it cannot compress, by less than this room.
    const CLASSIC_BYTES: u64 = 4_000_000_000;
    let of = |s: &Stack| u64::from(s.samples) * s.size.iter().map(|&n| u64::from(n)).product::<u64>() * s.views.len() as u64;
    let bytes: u64 = plate.subjects.iter().flat_map(|subject| &subject.stacks).map(of).sum();
    if bytes < CLASSIC_BYTES {
        write(TiffEncoder::<_, TiffKindStandard>::new_generic(out).map_err(OmeTiffError)?, plate, picture)
    } else {
        write(TiffEncoder::<_, TiffKindBig>::new_generic(out).map_err(OmeTiffError)?, plate, picture)
    }
}

fn write<W: Write + Seek, K: TiffKind, E: From<OmeTiffError>>(
    tiff: TiffEncoder<W, K>,
    plate: &Plate,
    mut picture: impl FnMut(Place) -> Result<Vec<u8>, E>,
) -> Result<(), E> {
    let mut tiff = tiff.with_compression(Compression::Deflate(DeflateLevel::Balanced));
    let mut description = Some(xml(plate).map_err(OmeTiffError::from)?);
    for (subject, of_well) in plate.subjects.iter().enumerate() {
        for (stack, of_camera) in of_well.stacks.iter().enumerate() {
            for view in 0..of_camera.views.len() {
                let pixels = picture(Place { subject, stack, view })?;
                add(&mut tiff, of_camera, description.take(), &pixels).map_err(OmeTiffError)?;
            }
        }
    }
    Ok(())
}

fn add<W: Write + Seek, K: TiffKind>(
    tiff: &mut TiffEncoder<W, K>,
    stack: &Stack,
    description: Option<String>,
    pixels: &[u8],
) -> Result<(), TiffError> {
    let [width, height] = stack.size;
    if stack.samples == 3 {
        let mut image = tiff.new_image::<RGB8>(width, height)?;
        tag(&mut image, stack, description)?;
        image.write_data(pixels)
    } else {
        let mut image = tiff.new_image::<Gray8>(width, height)?;
        tag(&mut image, stack, description)?;
        image.write_data(pixels)
    }
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

type Xml = quick_xml::Writer<Vec<u8>>;

/// An element with its content.
fn element(out: &mut Xml, name: &str, attributes: &[(&str, &str)], content: impl FnOnce(&mut Xml) -> io::Result<()>) -> io::Result<()> {
    out.create_element(name).with_attributes(attributes.iter().copied()).write_inner_content(content)?;
    Ok(())
}

/// An element without content.
fn empty(out: &mut Xml, name: &str, attributes: &[(&str, &str)]) -> io::Result<()> {
    out.create_element(name).with_attributes(attributes.iter().copied()).write_empty()?;
    Ok(())
}

/// An element with a text.
fn text(out: &mut Xml, name: &str, attributes: &[(&str, &str)], content: &str) -> io::Result<()> {
    out.create_element(name).with_attributes(attributes.iter().copied()).write_text_content(BytesText::new(content))?;
    Ok(())
}

/// A document in ASCII: other letters become character references. Control characters, and those that XML does not have, become spaces.
fn ascii(document: &str) -> String {
    let mut safe = String::with_capacity(document.len());
    for c in document.chars() {
        match c {
            ' '..='~' => safe.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => safe.push(' '),
            c => safe.push_str(&format!("&#{};", u32::from(c))),
        }
    }
    safe
}

/// An image of the file: a stack, its number, that of its well, and that of its first directory.
struct Image<'p> {
    number: usize,
    well: usize,
    first: usize,
    stack: &'p Stack,
}

impl<'p> Image<'p> {
    fn all(plate: &'p Plate) -> Vec<Self> {
        let mut images: Vec<Self> = Vec::new();
        for (well, subject) in plate.subjects.iter().enumerate() {
            for stack in &subject.stacks {
                let first = images.last().map_or(0, |image| image.first + image.stack.views.len());
                images.push(Self { number: images.len(), well, first, stack });
            }
        }
        images
    }

    /// The views with outlines: their place in the stack, their number, and the outlines.
    fn outlines(&self) -> impl Iterator<Item = (usize, u32, &'p [Polygon])> {
        let views = self.stack.outlines.iter().zip(&self.stack.views).enumerate();
        views.filter(|(_, (polygons, _))| !polygons.is_empty()).map(|(t, (polygons, (view, _)))| (t, *view, polygons.as_slice()))
    }
}

fn xml(plate: &Plate) -> io::Result<String> {
    let images = Image::all(plate);
    let mut out = Xml::new(Vec::new());
    out.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let root = [
        ("xmlns", SCHEMA),
        ("xmlns:xsi", "http://www.w3.org/2001/XMLSchema-instance"),
        ("xsi:schemaLocation", &format!("{SCHEMA} {SCHEMA}/ome.xsd")),
        ("Creator", concat!("carved ", env!("CARGO_PKG_VERSION"))),
    ];
    element(&mut out, "OME", &root, |out| {
        write_plate(out, plate, &images)?;
        for image in &images {
            write_image(out, &plate.run, &plate.subjects[image.well], image)?;
        }
        element(out, "StructuredAnnotations", &[], |out| write_annotations(out, plate, &images))?;
        images.iter().try_for_each(|image| write_rois(out, image))
    })?;
    let document = String::from_utf8(out.into_inner()).map_err(io::Error::other)?;
    Ok(ascii(&document))
}

fn write_plate(out: &mut Xml, plate: &Plate, images: &[Image]) -> io::Result<()> {
    let [rows, columns] = plate.size.map(|n| n.to_string());
    let attributes = [
        ("ID", "Plate:0"),
        ("Name", &plate.run),
        ("Rows", &rows),
        ("Columns", &columns),
        ("RowNamingConvention", "letter"),
        ("ColumnNamingConvention", "number"),
    ];
    element(out, "Plate", &attributes, |out| {
        for (well, subject) in plate.subjects.iter().enumerate() {
            let [row, column] = subject.place.map(|n| n.to_string());
            element(out, "Well", &[("ID", &format!("Well:{well}")), ("Row", &row), ("Column", &column)], |out| {
                for Image { number, .. } in images.iter().filter(|image| image.well == well) {
                    element(out, "WellSample", &[("ID", &format!("WellSample:{number}")), ("Index", &number.to_string())], |out| {
                        empty(out, "ImageRef", &[("ID", &format!("Image:{number}"))])
                    })?;
                }
                Ok(())
            })?;
        }
        Ok(())
    })
}

fn write_image(out: &mut Xml, run: &str, subject: &Subject, image: &Image) -> io::Result<()> {
    let Image { number, well, stack, .. } = image;
    let name = format!("{run} {} {}", subject.well, stack.channel);
    element(out, "Image", &[("ID", &format!("Image:{number}")), ("Name", &name)], |out| {
        if let Some(started) = subject.started {
            // Whole seconds: readers differ in how many decimals they take.
            text(out, "AcquisitionDate", &[], &started.strftime("%Y-%m-%dT%H:%M:%SZ").to_string())?;
        }
        let turn = "Views of one turn about the axis of the capillary. T counts them; their angles are annotations of the planes.";
        text(out, "Description", &[], turn)?;
        write_pixels(out, image)?;
        for (t, ..) in image.outlines() {
            empty(out, "ROIRef", &[("ID", &format!("ROI:{number}:{t}"))])?;
        }
        empty(out, "AnnotationRef", &[("ID", &format!("Annotation:facts:{well}"))])
    })
}

/// The pixels of an image: which directory of the file has each view, and its angle.
fn write_pixels(out: &mut Xml, Image { number, first, stack, .. }: &Image) -> io::Result<()> {
    let [width, height] = stack.size.map(|n| n.to_string());
    let [x, y] = stack.pixel_um.map(|um| um.to_string());
    let (samples, views) = (stack.samples.to_string(), stack.views.len().to_string());
    let attributes = [
        ("ID", &*format!("Pixels:{number}")),
        ("DimensionOrder", "XYCZT"),
        ("Type", "uint8"),
        ("SizeX", &width),
        ("SizeY", &height),
        ("SizeC", &samples),
        ("SizeZ", "1"),
        ("SizeT", &views),
        ("Interleaved", if stack.samples == 3 { "true" } else { "false" }),
        ("PhysicalSizeX", &x),
        ("PhysicalSizeXUnit", "\u{b5}m"),
        ("PhysicalSizeY", &y),
        ("PhysicalSizeYUnit", "\u{b5}m"),
    ];
    element(out, "Pixels", &attributes, |out| {
        let channel = [("ID", &*format!("Channel:{number}:0")), ("Name", &stack.channel), ("SamplesPerPixel", &samples)];
        empty(out, "Channel", &channel)?;
        for t in 0..stack.views.len() {
            let (ifd, t) = ((first + t).to_string(), t.to_string());
            empty(out, "TiffData", &[("IFD", &ifd), ("FirstC", "0"), ("FirstZ", "0"), ("FirstT", &t), ("PlaneCount", "1")])?;
        }
        for t in 0..stack.views.len() {
            element(out, "Plane", &[("TheZ", "0"), ("TheC", "0"), ("TheT", &t.to_string())], |out| {
                empty(out, "AnnotationRef", &[("ID", &format!("Annotation:{}", first + t))])
            })?;
        }
        Ok(())
    })
}

/// The angles of the views and the facts of the wells.
fn write_annotations(out: &mut Xml, plate: &Plate, images: &[Image]) -> io::Result<()> {
    for image in images {
        for (t, (view, omega_deg)) in image.stack.views.iter().enumerate() {
            let id = format!("Annotation:{}", image.first + t);
            element(out, "DoubleAnnotation", &[("ID", &id), ("Namespace", OMEGA)], |out| {
                text(out, "Description", &[], &format!("view {view}"))?;
                text(out, "Value", &[], &omega_deg.to_string())
            })?;
        }
    }
    for (well, subject) in plate.subjects.iter().enumerate() {
        element(out, "MapAnnotation", &[("ID", &format!("Annotation:facts:{well}")), ("Namespace", "carved")], |out| {
            element(out, "Value", &[], |out| subject.facts.iter().try_for_each(|(key, value)| text(out, "M", &[("K", key)], value)))
        })?;
    }
    Ok(())
}

/// The outlines of an image as regions, one for each view that has some.
fn write_rois(out: &mut Xml, image: &Image) -> io::Result<()> {
    let number = image.number;
    for (t, view, polygons) in image.outlines() {
        element(out, "ROI", &[("ID", &format!("ROI:{number}:{t}")), ("Name", &format!("view {view}"))], |out| {
            element(out, "Union", &[], |out| {
                for (at, polygon) in polygons.iter().enumerate() {
                    let point = |[u, v]: &[f64; 2]| format!("{:.3},{:.3}", u + CORNER_PX, v + CORNER_PX);
                    let points: Vec<String> = polygon.vertices.iter().map(point).collect();
                    let id = format!("Shape:{number}:{t}:{at}");
                    empty(out, "Polygon", &[("ID", &id), ("TheZ", "0"), ("TheT", &t.to_string()), ("Points", &points.join(" "))])?;
                }
                Ok(())
            })
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_is_ascii_whatever_a_plate_map_says() {
        let nasty = "a<b> & \"c\" 'd' \u{b5}m\u{1}\u{0}\n\u{ffff}\u{1f41f}]]>";
        let mut out = Xml::new(Vec::new());
        text(&mut out, "M", &[("K", nasty)], nasty).unwrap();
        let written = ascii(std::str::from_utf8(&out.into_inner()).unwrap());
        let expected = "a&lt;b&gt; &amp; &quot;c&quot; &apos;d&apos; &#181;m    &#128031;]]&gt;";
        assert_eq!(written, format!("<M K=\"{expected}\">{expected}</M>"));
    }
}
