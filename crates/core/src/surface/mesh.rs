//! A triangle mesh and what can be checked of it without knowing what it shows.

/// Triangles turn counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

/// How the triangles of a mesh hang together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topology {
    pub vertices: usize,
    pub edges: usize,
    pub triangles: usize,
    /// Sides of triangles without exactly one partner that runs the other way.
    pub unpaired_sides: usize,
}

impl Topology {
    /// Every side has its one partner: the mesh bounds a volume, and all its triangles are turned alike.
    pub fn is_closed(&self) -> bool {
        self.unpaired_sides == 0
    }

    /// `V - E + F`: 2 for each closed body without a handle, 2 less for each handle.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.triangles as i64
    }
}

impl Mesh {
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    pub fn corners(&self, triangle: [u32; 3]) -> [[f64; 3]; 3] {
        triangle.map(|v| self.vertices[v as usize])
    }

    pub fn topology(&self) -> Topology {
        let mut sides: Vec<(u32, u32)> = self.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        sides.sort_unstable();
        let twice = sides.chunk_by(|a, b| a == b).filter(|run| run.len() > 1).map(<[_]>::len).sum::<usize>();
        sides.dedup();
        let alone = sides.iter().filter(|&&(a, b)| sides.binary_search(&(b, a)).is_err()).count();
        let edges = sides.iter().filter(|&&(a, b)| a < b || sides.binary_search(&(b, a)).is_err()).count();
        Topology { vertices: self.vertices.len(), edges, triangles: self.triangles.len(), unpaired_sides: twice + alone }
    }

    /// Unit normals per vertex: the mean of the adjoining triangles' normals by area; zero where there is none.
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
