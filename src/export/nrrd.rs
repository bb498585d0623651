//! NRRD (nearly raw raster data), version 5: a header of text, an empty line, and the voxels, compressed with gzip.
//!
//! ```text
//! sizes            x fastest, then y, then z
//! space directions (s,0,0) (0,s,0) (0,0,s)      mm
//! space origin     centre of the first voxel    mm
//! data             unsigned bytes: 1 inside, 0 outside
//! ```
//! The unit is mm, because 3D Slicer and ITK count in mm and ignore `space units`. The space is `3D-right-handed`: axes of the instrument,
//! and not those of a patient.

use super::Unit;
use carved_core::carver::Voxels;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::{self, Write};

/// Writes voxels, whose lengths are in um, as NRRD. `facts` become key/value pairs of the header; line breaks in them become spaces.
///
/// # Errors
/// Those of the writer.
pub fn write_nrrd(voxels: &Voxels, facts: &[(&str, String)], out: &mut impl Write) -> io::Result<()> {
    let [nx, ny, nz] = voxels.counts;
    let size = Unit::Mm.of_um(voxels.size);
    let [x, y, z] = voxels.origin.map(|um| Unit::Mm.of_um(um));
    writeln!(out, "NRRD0005\n# carved {}", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "type: uint8\ndimension: 3\nspace: 3D-right-handed\nsizes: {nx} {ny} {nz}")?;
    writeln!(out, "space directions: ({size},0,0) (0,{size},0) (0,0,{size})\nspace origin: ({x},{y},{z})")?;
    writeln!(out, "space units: \"mm\" \"mm\" \"mm\"\ncenters: cell cell cell\nkinds: domain domain domain\nencoding: gzip")?;
    for (key, value) in facts {
        writeln!(out, "{key}:={}", value.replace(['\n', '\r'], " "))?;
    }
    writeln!(out)?;
    let mut data = GzEncoder::new(out, Compression::default());
    data.write_all(&voxels.inside)?;
    data.finish().map(|_| ())
}
