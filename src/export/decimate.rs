//! A mesh for looking at: the same shape from as few triangles as a stated error allows.
//!
//! Edges are collapsed in the order of what that changes (quadric errors, by meshoptimizer), onto vertices that were there. Where
//! the shape is thin, sheets may be joined: what is measured is the mesh that was given.

use carved_core::surface::Mesh;

/// A mesh in fewer triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Decimated {
    pub mesh: Mesh,
    /// How far its surface is off the given one by the measure that the triangles were collapsed by: root of the mean square of
    /// the distances to the planes that a vertex stands for. In the mesh's unit.
    pub error: f64,
}

/// Collapses triangles as long as the error stays below `max_error`, in the mesh's unit.
pub fn decimate(mesh: &Mesh, max_error: f64) -> Decimated {
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.map(|x| x as f32)).collect();
    let indices: Vec<u32> = mesh.triangles.concat();
    let mut error = 0.0;
    let options = meshopt::SimplifyOptions::ErrorAbsolute;
    let kept = meshopt::simplify_decoder(&indices, &positions, 0, max_error as f32, options, Some(&mut error));
    // Vertices in the order of the given mesh, without those that nothing needs any more.
    let mut numbers = vec![u32::MAX; mesh.vertices.len()];
    for &v in &kept {
        numbers[v as usize] = 0;
    }
    let mut vertices = Vec::new();
    for (number, vertex) in numbers.iter_mut().zip(&mesh.vertices).filter(|(number, _)| **number == 0) {
        *number = vertices.len() as u32;
        vertices.push(*vertex);
    }
    let triangles = kept.as_chunks().0.iter().map(|t: &[u32; 3]| t.map(|v| numbers[v as usize])).collect();
    Decimated { mesh: Mesh { vertices, triangles }, error: f64::from(error) }
}
