//! Models as files that people open.
//!
//! ```text
//!  Mesh ── ply ── MeshLab, CloudCompare, Fiji, trimesh
//!       └─ glb ── three.js on the page, Blender
//! ```
//! Both write to any `Write`, in the mesh's own unit; what is a file and whether it may be replaced is the caller's matter.

mod glb;
mod ply;

pub use glb::write_glb;
pub use ply::write_ply;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::Mesh;

    fn tetrahedron() -> Mesh {
        let vertices = vec![[0.0; 3], [10.5, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, -5.25]];
        Mesh { vertices, triangles: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] }
    }

    #[test]
    fn ply_is_its_header_and_its_records() {
        let mut bytes = Vec::new();
        write_ply(&tetrahedron(), "um", &mut bytes).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
        assert!(header.contains("element vertex 4\n") && header.contains("element face 4\n") && header.contains("um"), "{header}");
        let body = &bytes[end..];
        assert_eq!(body.len(), 4 * 12 + 4 * 13);
        assert_eq!(body[12..16], 10.5f32.to_le_bytes());
        assert_eq!(body[48..61], [3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    }

    #[test]
    fn glb_is_a_container_of_json_and_buffer_that_agree() {
        let mut bytes = Vec::new();
        write_glb(&tetrahedron(), "um", &mut bytes).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (b"glTF".as_slice(), 2, bytes.len()));
        let (json_len, json_kind) = (word(12), word(16));
        assert_eq!((json_len % 4, json_kind), (0, 0x4e4f_534a));
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_len]).unwrap();
        let at = 20 + json_len;
        assert_eq!((word(at), word(at + 4)), (bytes.len() - at - 8, 0x004e_4942));
        assert_eq!(json["buffers"][0]["byteLength"], word(at));
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

    #[test]
    fn an_empty_mesh_is_refused_by_glb_which_cannot_hold_one() {
        let refused = write_glb(&Mesh::default(), "um", &mut Vec::new()).unwrap_err();
        assert_eq!(refused.kind(), std::io::ErrorKind::InvalidInput);
        write_ply(&Mesh::default(), "um", &mut Vec::new()).unwrap();
    }
}
