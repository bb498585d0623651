//! Export of models to common file formats.
//!
//! ```text
//!  Mesh ── ply ── MeshLab, CloudCompare, Fiji, trimesh
//!   │   ├─ glb ── three.js on the page, Blender
//!   │   ├─ stl ── printers
//!   │   └─ decimate ── Mesh of fewer triangles
//!  Voxels ── nrrd ── 3D Slicer, ITK, ParaView
//!  frames ─┬─ ome_tiff ── Fiji, CellProfiler, QuPath, OMERO
//!          └─ zarr ── napari and all that reads OME-Zarr
//!  outlines ── imagej ── Fiji, CellProfiler
//! ```
//! The formats write to any `Write`, in the unit of the mesh, except that NRRD is in mm and GLB in m. The caller decides about files and whether they may
//! be replaced.

mod decimate;
mod glb;
mod imagej;
mod nrrd;
mod ome_tiff;
mod ply;
mod stl;
mod unit;
pub mod zarr;

pub use decimate::{Decimated, decimate};
pub use glb::write_glb;
pub use imagej::{CORNER_PX, Outline, imagej_rois};
pub use nrrd::write_nrrd;
pub use ome_tiff::{OmeTiffError, Place, Plate, Stack, Subject, ome_tiff};
pub use ply::{PlyError, read_ply, write_ply};
pub use stl::write_stl;
pub use unit::Unit;

/// What files with a specimen's surface say about it: the estimator that made it.
pub fn facts_of_mesh() -> [(&'static str, String); 1] {
    [("estimator", carved_core::measure::Estimator::Field.name().into())]
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::surface::Mesh;

    fn tetrahedron() -> Mesh {
        let vertices = vec![[0.0; 3], [10.5, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, -5.25]];
        Mesh { vertices, triangles: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] }
    }

    #[test]
    fn ply_is_its_header_and_its_records() {
        let mut bytes = Vec::new();
        write_ply(&tetrahedron(), "um", "field", &mut bytes).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
        assert!(header.contains("element vertex 4\n") && header.contains("element face 4\n") && header.contains("um"), "{header}");
        assert!(header.contains("\ncomment estimator field\n"), "{header}");
        let body = &bytes[end..];
        assert_eq!(body.len(), 4 * 12 + 4 * 13);
        assert_eq!(body[12..16], 10.5f32.to_le_bytes());
        assert_eq!(body[48..61], [3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(read_ply(&bytes).unwrap(), tetrahedron());
    }

    #[test]
    fn a_ply_that_was_spoiled_is_refused_with_the_reason() {
        let mut bytes = Vec::new();
        write_ply(&tetrahedron(), "um", "field", &mut bytes).unwrap();
        let expected = 4 * 12 + 4 * 13;
        assert_eq!(read_ply(&bytes[..bytes.len() - 1]), Err(PlyError::Length { expected, found: expected - 1 }));
        assert_eq!(read_ply(b"ply\n"), Err(PlyError::Header { missing: "end_header" }));
        let text = String::from_utf8_lossy(&bytes).replace("element face 4", "element face 99999999999");
        assert_eq!(read_ply(text.as_bytes()), Err(PlyError::Header { missing: "element face" }));
        let end = bytes.len() - 1;
        bytes[end] = 1;
        assert_eq!(read_ply(&bytes), Err(PlyError::Face { face: 3, vertices: 4 }));
    }

    #[test]
    fn glb_is_a_container_of_json_and_buffer_that_agree() {
        let mut bytes = Vec::new();
        write_glb(&tetrahedron(), None, Unit::M, &[("estimator", "field".into())], &mut bytes).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (b"glTF".as_slice(), 2, bytes.len()));
        let (json_len, json_kind) = (word(12), word(16));
        assert_eq!((json_len % 4, json_kind), (0, 0x4e4f_534a));
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_len]).unwrap();
        let at = 20 + json_len;
        assert_eq!((word(at), word(at + 4)), (bytes.len() - at - 8, 0x004e_4942));
        assert_eq!(json["buffers"][0]["byteLength"], word(at));
        assert_eq!(json["asset"]["extras"], serde_json::json!({"unit": "m", "estimator": "field"}));
        assert_eq!(json["nodes"], serde_json::json!([{"mesh": 0, "rotation": [1, 0, 0, 0], "scale": [1e-6, 1e-6, 1e-6]}]));
        assert_eq!(json["accessors"][0]["min"], serde_json::json!([0.0, 0.0, -5.25]));
        assert_eq!(json["accessors"][0]["max"], serde_json::json!([10.5, 20.0, 0.0]));
        for view in json["bufferViews"].as_array().unwrap() {
            let (start, length) = (view["byteOffset"].as_u64().unwrap() as usize, view["byteLength"].as_u64().unwrap() as usize);
            assert!(start % 4 == 0 && start + length <= word(at), "{view}");
        }
        let indices = at + 8 + json["bufferViews"][2]["byteOffset"].as_u64().unwrap() as usize;
        let found: Vec<usize> = (0..12).map(|i| word(indices + 4 * i)).collect();
        assert_eq!(found, [0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2]);
    }

    /// A cube with a side of 10, each face cut into n^2 squares of two triangles. Vertices are shared along the edges of the cube.
    fn cube(n: i32) -> Mesh {
        let mut numbers = std::collections::BTreeMap::new();
        let mut mesh = Mesh::default();
        for (axis, up) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let mut corner = |a: i32, b: i32| {
                    let mut at = [0; 3];
                    at[axis] = up * n;
                    at[(axis + 1) % 3] = i + a;
                    at[(axis + 2) % 3] = j + b;
                    *numbers.entry(at).or_insert_with(|| {
                        mesh.vertices.push(at.map(|c| 10.0 * f64::from(c) / f64::from(n)));
                        mesh.vertices.len() as u32 - 1
                    })
                };
                let [p, q, r, s] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                mesh.triangles.extend(if up == 1 { [[p, q, r], [p, r, s]] } else { [[p, r, q], [p, s, r]] });
            }
        }
        mesh
    }

    #[test]
    fn what_is_flat_needs_few_triangles_and_what_is_round_keeps_its_error() {
        let flat = cube(16);
        assert!((carved_core::measure::volume(&flat) - 1000.0).abs() < 1e-9 && flat.triangles.len() == 3072, "the cube is closed");
        let Decimated { mesh, error } = decimate(&flat, 0.01);
        assert!(mesh.triangles.len() <= 24 && error <= 0.01, "{} triangles, off by {error}", mesh.triangles.len());
        assert!((carved_core::measure::volume(&mesh) / 1000.0 - 1.0).abs() < 1e-3);
        assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < mesh.vertices.len()));

        // The same cube, inflated to a ball of 100 um.
        let mut round = cube(64);
        for v in &mut round.vertices {
            let from_middle = v.map(|c| c - 5.0);
            let length = from_middle.iter().map(|c| c * c).sum::<f64>().sqrt();
            *v = from_middle.map(|c| 100.0 * c / length);
        }
        for max_error in [0.2, 1.0] {
            let Decimated { mesh, error } = decimate(&round, max_error);
            assert!(error <= max_error && mesh.triangles.len() * 8 < round.triangles.len(), "{} triangles", mesh.triangles.len());
            // The middle of an edge is the point furthest inside the ball. Its depth is bounded by a small multiple of the root mean
            // square.
            for &t in &mesh.triangles {
                let [a, b, c] = mesh.corners(t);
                let middle: [f64; 3] = std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0);
                let inside = 100.0 - middle.iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!(inside < 4.0 * max_error, "{inside} um at an error of {max_error} um");
            }
        }
        assert_eq!(decimate(&Mesh::default(), 1.0).mesh, Mesh::default());
    }

    #[test]
    fn an_empty_mesh_is_refused_by_glb_which_cannot_hold_one() {
        let refused = write_glb(&Mesh::default(), None, Unit::M, &[], &mut Vec::new()).unwrap_err();
        assert_eq!(refused.kind(), std::io::ErrorKind::InvalidInput);
        write_ply(&Mesh::default(), "um", "field", &mut Vec::new()).unwrap();
    }
}
