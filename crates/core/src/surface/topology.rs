//! What the tests check of a mesh without knowing what it shows.

use super::Mesh;

/// How the triangles of a mesh hang together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Topology {
    vertices: usize,
    edges: usize,
    triangles: usize,
    /// Sides of triangles without exactly one partner that runs the other way.
    unpaired_sides: usize,
}

impl Topology {
    pub fn of(mesh: &Mesh) -> Self {
        let mut sides: Vec<(u32, u32)> = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        sides.sort_unstable();
        let twice = sides.chunk_by(|a, b| a == b).filter(|run| run.len() > 1).map(<[_]>::len).sum::<usize>();
        sides.dedup();
        let alone = sides.iter().filter(|&&(a, b)| sides.binary_search(&(b, a)).is_err()).count();
        let edges = sides.iter().filter(|&&(a, b)| a < b || sides.binary_search(&(b, a)).is_err()).count();
        Self { vertices: mesh.vertices.len(), edges, triangles: mesh.triangles.len(), unpaired_sides: twice + alone }
    }

    /// Every side has its one partner: the mesh bounds a volume, and all its triangles are turned alike.
    pub fn is_closed(&self) -> bool {
        self.unpaired_sides == 0
    }

    /// `V - E + F`: 2 for each closed body without a handle, 2 less for each handle.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.triangles as i64
    }
}
