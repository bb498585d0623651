//! Regions of ImageJ and Fiji: polygons at sub-pixel positions, in a zip of `.roi` files that the ROI manager opens.
//!
//! ```text
//! "Iout" version type | top left bottom right n | ... options ... position, place of header 2 | n x, n y (i16) | n x, n y (f32) | header 2 | name
//! ```
//! All numbers are big-endian. ImageJ counts from the corner of the first pixel, carved from its centre: half a pixel is added.

use carved_core::profile::Polygon;
use std::io::{self, Cursor, Write};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// A version whose readers know sub-pixel positions and a second header.
const VERSION: u16 = 227;
const SUB_PIXEL: u16 = 128;
const HEADER: usize = 64;
const HEADER_2: usize = 64;

/// An outline in one picture of a stack.
pub struct Outline<'p> {
    /// Name in the ROI manager.
    pub name: String,
    /// Number of the picture in its stack, from 1.
    pub picture: u32,
    /// Vertices in px, pixel centres at integers.
    pub polygon: &'p Polygon,
}

/// Distance of the first pixel's centre from its corner, where ImageJ and OME begin to count.
pub const CORNER_PX: f64 = 0.5;

/// The bytes of a zip with a region per outline.
///
/// # Errors
/// An outline of more than 65535 vertices or beyond a picture of 32767 px, which the format cannot represent.
pub fn imagej_rois(outlines: &[Outline]) -> io::Result<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for outline in outlines {
        zip.start_file(format!("{}.roi", outline.name), SimpleFileOptions::default())?;
        zip.write_all(&roi(outline)?)?;
    }
    Ok(zip.finish()?.into_inner())
}

fn roi(outline: &Outline) -> io::Result<Vec<u8>> {
    let points: Vec<[f64; 2]> = outline.polygon.vertices.iter().map(|v| v.map(|x| x + CORNER_PX)).collect();
    let invalid = |what: String| io::Error::new(io::ErrorKind::InvalidInput, format!("{}: {what}", outline.name));
    let n = u16::try_from(points.len()).map_err(|_| invalid(format!("{} vertices; ImageJ's regions have 65535 at most", points.len())))?;
    let bound = |axis: usize, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[axis]).reduce(pick).unwrap_or(0.0);
    let whole = |x: f64| {
        let fits = (f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&x);
        if fits { Ok(x as i16) } else { Err(invalid(format!("a vertex at {x} px; ImageJ's regions end at 32767 px"))) }
    };
    let [left, top] = [whole(bound(0, f64::min).floor())?, whole(bound(1, f64::min).floor())?];
    let [right, bottom] = [whole(bound(0, f64::max).ceil())?, whole(bound(1, f64::max).ceil())?];
    let name: Vec<u16> = outline.name.encode_utf16().collect();
    let header_2 = HEADER + 12 * points.len();
    let mut header = [0; HEADER];
    header[..4].copy_from_slice(b"Iout");
    header[4..6].copy_from_slice(&VERSION.to_be_bytes());
    for (at, x) in [(8, top), (10, left), (12, bottom), (14, right)] {
        header[at..at + 2].copy_from_slice(&x.to_be_bytes());
    }
    header[16..18].copy_from_slice(&n.to_be_bytes());
    header[50..52].copy_from_slice(&SUB_PIXEL.to_be_bytes());
    header[56..60].copy_from_slice(&outline.picture.to_be_bytes());
    header[60..64].copy_from_slice(&(header_2 as u32).to_be_bytes());
    let mut second = [0; HEADER_2];
    for (at, x) in [(4, 1), (8, 1), (12, outline.picture), (16, (header_2 + HEADER_2) as u32), (20, name.len() as u32)] {
        second[at..at + 4].copy_from_slice(&x.to_be_bytes());
    }
    let mut bytes = header.to_vec();
    for (axis, least) in [(0, left), (1, top)] {
        bytes.extend(points.iter().flat_map(|p| ((p[axis] - f64::from(least)) as i16).to_be_bytes()));
    }
    for axis in 0..2 {
        bytes.extend(points.iter().flat_map(|p| (p[axis] as f32).to_be_bytes()));
    }
    bytes.extend(second);
    bytes.extend(name.iter().flat_map(|c| c.to_be_bytes()));
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_format_cannot_represent_is_refused() {
        let of = |vertices: Vec<[f64; 2]>| {
            let polygon = Polygon { vertices };
            imagej_rois(&[Outline { name: "view 1".into(), picture: 1, polygon: &polygon }]).map(|bytes| bytes.len())
        };
        assert!(of(vec![[0.0, 0.0], [3.5, 0.0], [0.0, 2.0]]).is_ok());
        assert!(of(vec![[0.0; 2]; 65_536]).unwrap_err().to_string().contains("view 1: 65536 vertices"));
        assert!(of(vec![[0.0, 4e4]]).unwrap_err().to_string().contains("end at 32767 px"));
        assert!(of(vec![[f64::NAN, 0.0]]).is_err());
    }
}
