//! A triangle mesh.

/// A triangle mesh. Triangles turn counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// World coordinates of each vertex, um.
    pub vertices: Vec<[f64; 3]>,
    /// Indices of each triangle's corners in `vertices`.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// World coordinates of a triangle's corners, um.
    pub fn corners(&self, triangle: [u32; 3]) -> [[f64; 3]; 3] {
        triangle.map(|v| self.vertices[v as usize])
    }

    /// Unit normals per vertex: the mean of the adjoining triangles' normals, weighted by area. Zero for a vertex without
    /// triangles.
    pub fn normals(&self) -> Vec<[f64; 3]> {
        let mut normals = vec![[0.0; 3]; self.vertices.len()];
        for &triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle);
            let n = cross(sub(b, a), sub(c, a));
            for v in triangle {
                normals[v as usize] = add(normals[v as usize], n);
            }
        }
        for n in &mut normals {
            let length = dot(*n, *n).sqrt();
            if length > 0.0 {
                *n = n.map(|x| x / length);
            }
        }
        normals
    }
}

pub(crate) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

pub(crate) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
