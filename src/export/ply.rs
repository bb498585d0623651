//! PLY, binary little-endian: positions as f32, triangles as lists of three indices.

use carved_core::surface::Mesh;
use std::io::{self, Write};

/// Writes the mesh as PLY. `unit` is the unit of the positions, for a comment in the header.
///
/// # Errors
/// Those of the writer.
pub fn write_ply(mesh: &Mesh, unit: &str, out: &mut impl Write) -> io::Result<()> {
    let (vertices, faces) = (mesh.vertices.len(), mesh.triangles.len());
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment made by carved {}\ncomment unit {unit}\n\
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
