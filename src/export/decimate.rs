//! A mesh for display: the same shape with as few triangles as a given error allows.
//!
//! Edges are collapsed in the order of their quadric errors (by meshoptimizer), onto existing vertices. Thin parts of the shape may be
//! joined, so measurements use the original mesh.

use carved_core::surface::Mesh;

/// A mesh with fewer triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Decimated {
    pub mesh: Mesh,
    /// Distance of the surface from the original one, in the unit of the mesh, by the measure of the collapse: root mean square of the
    /// distances to the planes that a vertex represents.
    pub error: f64,
}

/// Collapses triangles while the error stays below `max_error`, in the unit of the mesh.
pub fn decimate(mesh: &Mesh, max_error: f64) -> Decimated {
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.map(|x| x as f32)).collect();
    let indices: Vec<u32> = mesh.triangles.concat();
    let mut error = 0.0;
    let options = meshopt::SimplifyOptions::ErrorAbsolute;
    let kept = meshopt::simplify_decoder(&indices, &positions, 0, max_error as f32, options, Some(&mut error));
    // The vertices in their original order, without the unused ones.
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
