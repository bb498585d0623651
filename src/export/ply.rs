//! PLY, binary little-endian: positions as f32, triangles as lists of three indices. Only files of carved are read.

use carved_core::surface::Mesh;
use std::io::{self, Write};

/// Why a PLY file is not read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlyError {
    /// The header is not one that carved writes.
    #[error("its header has no {missing:?}, which files of carved have: compute the mesh again with carved replay")]
    Header {
        /// The line or its beginning.
        missing: &'static str,
    },
    /// The number of bytes after the header does not follow from the header.
    #[error("{found} bytes follow the header, expected {expected}: the file was cut short or is not of carved")]
    Length {
        /// Bytes that follow from the header.
        expected: usize,
        /// Bytes that are there.
        found: usize,
    },
    /// A triangle has a vertex that is not there, or is no triangle.
    #[error("face {face} names a vertex beyond the {vertices} of the file, or is no triangle")]
    Face {
        /// Number of the face, from 0.
        face: usize,
        /// Vertices of the file.
        vertices: usize,
    },
}

/// Reads a mesh that [`write_ply`] wrote, in its unit.
///
/// # Errors
/// A file that carved did not write.
pub fn read_ply(bytes: &[u8]) -> Result<Mesh, PlyError> {
    const END: &[u8] = b"end_header\n";
    let missing = |missing| PlyError::Header { missing };
    let end = bytes.windows(END.len()).position(|w| w == END).ok_or(missing("end_header"))? + END.len();
    let header = String::from_utf8_lossy(&bytes[..end]);
    for needed in ["format binary_little_endian 1.0", "property float x", "property list uchar int vertex_indices"] {
        if !header.lines().any(|line| line == needed) {
            return Err(missing(needed));
        }
    }
    let count = |element: &'static str| {
        let number = header.lines().find_map(|line| line.strip_prefix(element)?.trim().parse::<u32>().ok());
        number.map(|n| n as usize).ok_or(missing(element))
    };
    let (vertices, faces) = (count("element vertex")?, count("element face")?);
    let body = &bytes[end..];
    let expected = 12 * vertices + 13 * faces;
    if body.len() != expected {
        return Err(PlyError::Length { expected, found: body.len() });
    }
    let (points, lists) = body.split_at(12 * vertices);
    let point = |p: &[[u8; 4]; 3]| p.map(|x| f64::from(f32::from_le_bytes(x)));
    let points = points.as_chunks::<4>().0.as_chunks::<3>().0.iter().map(point).collect();
    let mut triangles = Vec::with_capacity(faces);
    for (face, list) in lists.as_chunks::<13>().0.iter().enumerate() {
        let corner = |at: usize| u32::from_le_bytes([list[at], list[at + 1], list[at + 2], list[at + 3]]);
        let triangle = [corner(1), corner(5), corner(9)];
        if list[0] != 3 || triangle.iter().any(|&v| v as usize >= vertices) {
            return Err(PlyError::Face { face, vertices });
        }
        triangles.push(triangle);
    }
    Ok(Mesh { vertices: points, triangles })
}

/// Writes the mesh as PLY. `unit` is the unit of the positions, and `estimator` made the surface; comments in the header name both.
///
/// # Errors
/// Those of the writer.
pub fn write_ply(mesh: &Mesh, unit: &str, estimator: &str, out: &mut impl Write) -> io::Result<()> {
    let (vertices, faces) = (mesh.vertices.len(), mesh.triangles.len());
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment made by carved {}\ncomment unit {unit}\ncomment estimator {estimator}\n\
         element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n",
        env!("CARGO_PKG_VERSION")
    )?;
    let mut body = Vec::with_capacity(12 * vertices + 13 * faces);
    for x in mesh.vertices.iter().flatten() {
        body.extend_from_slice(&(*x as f32).to_le_bytes());
    }
    for triangle in &mesh.triangles {
        body.push(3);
        for v in triangle {
            body.extend_from_slice(&v.to_le_bytes());
        }
    }
    out.write_all(&body)
}
