//! glTF 2.0 in its binary container: one mesh with positions, normals and indices.
//!
//! ```text
//!  "glTF" 2 length | length "JSON" {...} | length "BIN\0" positions f32 x 3, normals f32 x 3, indices u32, colours f32 x 3
//! ```
//! The format's unit is the metre, and its y points up. The positions are in um and in the axes of carved, y down, as the page shows them;
//! the node above the mesh turns them upright and scales them. `asset.extras.unit` names the unit of the scene.

use super::Unit;
use carved_core::surface::Mesh;
use serde_json::{Value, json};
use std::io::{self, Write};

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Roughness of the surface, from 0 for a mirror to 1: matt, with a faint gloss that shows its curvature.
const ROUGHNESS: f64 = 0.8;

/// Writes a mesh in um as GLB. `unit` is that of the scene: metres, or another one for a program that clips or picks badly at 0.004.
/// `colours` are those of the vertices, red, green and blue from 0 to 255 in sRGB; viewers show them as they are, without a light.
/// `facts` say what else is known of the mesh.
///
/// # Errors
/// An empty mesh, which the format cannot represent, and errors of the writer.
pub fn write_glb(mesh: &Mesh, colours: Option<&[[f64; 3]]>, unit: Unit, facts: &[(&str, String)], out: &mut impl Write) -> io::Result<()> {
    if mesh.is_empty() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "glTF holds no empty mesh: 0 triangles found, at least 1 expected"));
    }
    let (vertices, indices) = (mesh.vertices.len(), 3 * mesh.triangles.len());
    let mut buffer = Vec::with_capacity(24 * vertices + 4 * indices);
    let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for vertex in &mesh.vertices {
        for (a, x) in vertex.map(|x| x as f32).into_iter().enumerate() {
            min[a] = min[a].min(x);
            max[a] = max[a].max(x);
            buffer.extend_from_slice(&x.to_le_bytes());
        }
    }
    for normal in mesh.normals() {
        // A normal must have length 1, also if the triangles around a vertex have no area.
        let unit_length = if normal.iter().all(|&n| n == 0.0) { [0.0, 0.0, 1.0] } else { normal };
        for x in unit_length {
            buffer.extend_from_slice(&(x as f32).to_le_bytes());
        }
    }
    for v in mesh.triangles.iter().flatten() {
        buffer.extend_from_slice(&v.to_le_bytes());
    }

    let indices_end = buffer.len();
    for colour in colours.unwrap_or_default() {
        for x in colour.map(linear) {
            buffer.extend_from_slice(&(x as f32).to_le_bytes());
        }
    }

    let view =
        |offset: usize, length: usize, target: u32| json!({"buffer": 0, "byteOffset": offset, "byteLength": length, "target": target});
    let scale = [unit.of_um(1.0); 3];
    let mut extras = json!({"unit": unit.symbol()});
    for (key, value) in facts {
        extras[*key] = value.as_str().into();
    }
    let mut document = json!({
        "asset": {"version": "2.0", "generator": concat!("carved ", env!("CARGO_PKG_VERSION")), "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        // Half a turn about x: y points up, and z to the viewer.
        "nodes": [{"mesh": 0, "rotation": [1, 0, 0, 0], "scale": scale}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "mode": 4, "material": 0}]}],
        // The default of the format is metal, which is black where a scene has no surroundings that it reflects.
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}}],
        "accessors": [
            {"bufferView": 0, "componentType": FLOAT, "count": vertices, "type": "VEC3", "min": min, "max": max},
            {"bufferView": 1, "componentType": FLOAT, "count": vertices, "type": "VEC3"},
            {"bufferView": 2, "componentType": UNSIGNED_INT, "count": indices, "type": "SCALAR"},
        ],
        "bufferViews": [
            view(0, 12 * vertices, ARRAY_BUFFER),
            view(12 * vertices, 12 * vertices, ARRAY_BUFFER),
            view(24 * vertices, 4 * indices, ELEMENT_ARRAY_BUFFER),
        ],
        "buffers": [{"byteLength": buffer.len()}],
    });
    if let Some(colours) = colours {
        let accessor = json!({"bufferView": 3, "componentType": FLOAT, "count": colours.len(), "type": "VEC3"});
        append(&mut document["accessors"], accessor);
        append(&mut document["bufferViews"], view(indices_end, 12 * colours.len(), ARRAY_BUFFER));
        document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 3.into();
        document["materials"][0]["extensions"] = json!({"KHR_materials_unlit": {}});
        document["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    }
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');

    let length = |n: usize| {
        let too_long = || io::Error::new(io::ErrorKind::InvalidInput, format!("a GLB file holds 4 GiB, this mesh needs {n} bytes"));
        u32::try_from(n).map(u32::to_le_bytes).map_err(|_| too_long())
    };
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&length(12 + 8 + text.len() + 8 + buffer.len())?)?;
    out.write_all(&length(text.len())?)?;
    out.write_all(b"JSON")?;
    out.write_all(&text)?;
    out.write_all(&length(buffer.len())?)?;
    out.write_all(b"BIN\0")?;
    out.write_all(&buffer)
}

fn append(list: &mut Value, entry: Value) {
    if let Value::Array(entries) = list {
        entries.push(entry);
    }
}

/// The intensity, 0 to 1, of an sRGB value from 0 to 255 (IEC 61966-2-1), in which glTF states the colours of vertices.
fn linear(srgb: f64) -> f64 {
    let x = (srgb / 255.0).clamp(0.0, 1.0);
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}
