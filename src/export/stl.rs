//! STL, binary: a header of 80 bytes, the number of triangles, and per triangle its normal, three corners and two unused bytes.
//!
//! The format has no unit. The header states the one of the file. A header that began with `solid` would be read as text.

use carved_core::surface::Mesh;
use std::io::{self, Write};

const HEADER: usize = 80;

/// Writes the mesh as STL. `words` say in the header what the file holds, with its unit; what is longer than 80 bytes is cut off.
///
/// # Errors
/// More triangles than the format counts, and errors of the writer.
pub fn write_stl(mesh: &Mesh, words: &str, out: &mut impl Write) -> io::Result<()> {
    let count = u32::try_from(mesh.triangles.len()).map_err(|_| {
        let found = mesh.triangles.len();
        io::Error::new(io::ErrorKind::InvalidInput, format!("STL holds {} triangles, this mesh has {found}", u32::MAX))
    })?;
    let mut header = format!("carved {words}").into_bytes();
    header.resize(HEADER, b' ');
    let mut bytes = Vec::with_capacity(HEADER + 4 + 50 * mesh.triangles.len());
    bytes.extend_from_slice(&header);
    bytes.extend_from_slice(&count.to_le_bytes());
    for &triangle in &mesh.triangles {
        let corners = mesh.corners(triangle);
        for x in normal(corners).into_iter().chain(corners.into_iter().flatten()) {
            bytes.extend_from_slice(&(x as f32).to_le_bytes());
        }
        bytes.extend_from_slice(&[0; 2]);
    }
    out.write_all(&bytes)
}

/// Unit normal of a triangle; zero for one without area, as the format has it.
fn normal([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let side = |to: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| to[i] - a[i]) };
    let (p, q) = (side(b), side(c));
    let n = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { n.map(|x| x / length) } else { [0.0; 3] }
}
