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

    /// The connected piece that encloses the largest volume, with its own vertices. `None` if all triangles hang together.
    pub fn largest_piece(&self) -> Option<Self> {
        // Each vertex leads to one of its piece with a lower number, and the first of a piece to itself.
        let mut leads: Vec<u32> = (0..self.vertices.len() as u32).collect();
        let first = |leads: &mut [u32], mut v: u32| {
            while leads[v as usize] != v {
                leads[v as usize] = leads[leads[v as usize] as usize];
                v = leads[v as usize];
            }
            v
        };
        for &[a, b, c] in &self.triangles {
            for [v, w] in [[a, b], [b, c]] {
                let [v, w] = [v, w].map(|v| first(&mut leads, v));
                leads[v.max(w) as usize] = v.min(w);
            }
        }
        let of_triangle: Vec<u32> = self.triangles.iter().map(|t| first(&mut leads, t[0])).collect();
        let one = *of_triangle.first()?;
        if of_triangle.iter().all(|piece| *piece == one) {
            return None;
        }
        let mut volumes = vec![0.0; self.vertices.len()];
        for (&triangle, &piece) in self.triangles.iter().zip(&of_triangle) {
            let [a, b, c] = self.corners(triangle);
            volumes[piece as usize] += dot(a, cross(b, c));
        }
        let (largest, _) = volumes.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        let mut piece = Self::default();
        let mut moved = vec![None; self.vertices.len()];
        for (triangle, _) in self.triangles.iter().zip(&of_triangle).filter(|(_, of)| **of as usize == largest) {
            piece.triangles.push(triangle.map(|v| {
                *moved[v as usize].get_or_insert_with(|| {
                    piece.vertices.push(self.vertices[v as usize]);
                    piece.vertices.len() as u32 - 1
                })
            }));
        }
        Some(piece)
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
