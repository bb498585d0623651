//! Closed triangle meshes, from which every specimen is drawn, with exact volume and area.

use std::collections::HashMap;
use std::path::Path;

/// Triangles, um. They wind counter-clockwise when seen from outside, so that normals by the right-hand rule point outwards.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    #[error("mesh {path}: {source}")]
    Read { path: String, source: std::io::Error },
    #[error("mesh: line {line} reads {found:?}; expected {expected}")]
    Line { line: usize, found: String, expected: &'static str },
    #[error("mesh: line {line} names vertex {index}, the file has {vertices} before it")]
    NoSuchVertex { line: usize, index: i64, vertices: usize },
    #[error("mesh is open: {open} of {edges} edges have no second triangle; a specimen needs a closed surface: close the holes first")]
    Open { open: usize, edges: usize },
    #[error("mesh: {edges} edges are used more than once in one direction; wind all triangles alike and let two meet at each edge")]
    Tangled { edges: usize },
    #[error("mesh holds no volume ({triangles} triangles enclose {volume}); a specimen needs a solid")]
    Flat { triangles: usize, volume: f64 },
}

impl Mesh {
    /// Reads the vertices and faces of a Wavefront OBJ. Polygons become fans. The mesh is checked by [`Mesh::closed`].
    ///
    /// # Errors
    /// A line cannot be read, or the surface is not closed.
    pub fn from_obj(text: &str) -> Result<Self, MeshError> {
        let mut mesh = Self::default();
        for (i, raw) in text.lines().enumerate() {
            let line = i + 1;
            let mut words = raw.split_whitespace();
            match words.next() {
                Some("v") => mesh.vertices.push(vertex(line, raw, words)?),
                Some("f") => mesh.add_face(line, raw, words)?,
                _ => {}
            }
        }
        mesh.closed()
    }

    /// # Errors
    /// As [`Mesh::from_obj`], or the file cannot be read.
    pub fn from_obj_file(path: &Path) -> Result<Self, MeshError> {
        let text = std::fs::read_to_string(path).map_err(|source| MeshError::Read { path: path.display().to_string(), source })?;
        Self::from_obj(&text)
    }

    fn add_face<'a>(&mut self, line: usize, raw: &str, words: impl Iterator<Item = &'a str>) -> Result<(), MeshError> {
        let mut corners = Vec::new();
        for word in words {
            let first = word.split('/').next().unwrap_or_default();
            let index: i64 = first.parse().map_err(|_| MeshError::Line {
                line,
                found: raw.to_owned(),
                expected: "a face of vertex numbers such as `f 1 2 3` or `f 1/1/1 2/2/2 3/3/3`",
            })?;
            let vertices = self.vertices.len();
            // Negative numbers count backwards from the last vertex.
            let from_zero = if index < 0 { vertices as i64 + index } else { index - 1 };
            if from_zero < 0 || from_zero >= vertices as i64 {
                return Err(MeshError::NoSuchVertex { line, index, vertices });
            }
            corners.push(from_zero as u32);
        }
        if corners.len() < 3 {
            return Err(MeshError::Line { line, found: raw.to_owned(), expected: "a face of at least three vertices" });
        }
        for pair in corners[1..].windows(2) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
        }
        Ok(())
    }

    /// Checks that the triangles close, and turns them outwards.
    ///
    /// # Errors
    /// An edge is open, or has more than two triangles, or has two triangles of different winding, or the volume is 0.
    pub fn closed(mut self) -> Result<Self, MeshError> {
        let mut directed: HashMap<(u32, u32), usize> = HashMap::new();
        for t in &self.triangles {
            for k in 0..3 {
                *directed.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
            }
        }
        let tangled = directed.values().filter(|&&n| n > 1).count();
        if tangled > 0 {
            return Err(MeshError::Tangled { edges: tangled });
        }
        let open = directed.keys().filter(|&&(a, b)| !directed.contains_key(&(b, a))).count();
        if open > 0 {
            return Err(MeshError::Open { open, edges: usize::midpoint(directed.len(), open) });
        }
        let volume = self.volume();
        if !volume.is_finite() || volume == 0.0 {
            return Err(MeshError::Flat { triangles: self.triangles.len(), volume });
        }
        if volume < 0.0 {
            for t in &mut self.triangles {
                t.swap(1, 2);
            }
        }
        Ok(self)
    }

    fn corners(&self) -> impl Iterator<Item = [[f64; 3]; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|i| self.vertices[i as usize]))
    }

    /// The volume: the sum of the signed tetrahedra of the triangles with a nearby point.
    pub fn volume(&self) -> f64 {
        let Some(&origin) = self.vertices.first() else { return 0.0 };
        self.corners().map(|[a, b, c]| dot(sub(a, origin), cross(sub(b, origin), sub(c, origin))) / 6.0).sum()
    }

    /// Centre of the volume that it encloses.
    pub fn centroid(&self) -> [f64; 3] {
        let Some(&origin) = self.vertices.first() else { return [0.0; 3] };
        let (mut sum, mut volume) = ([0.0; 3], 0.0);
        for corners in self.corners() {
            let [a, b, c] = corners.map(|p| sub(p, origin));
            let part = dot(a, cross(b, c));
            volume += part;
            for i in 0..3 {
                sum[i] += part * (a[i] + b[i] + c[i]) / 4.0;
            }
        }
        std::array::from_fn(|i| origin[i] + sum[i] / volume)
    }

    pub fn area(&self) -> f64 {
        self.corners().map(|[a, b, c]| norm(cross(sub(b, a), sub(c, a))) / 2.0).sum()
    }

    /// Lowest and highest coordinate of each axis, um.
    pub fn bounds(&self) -> [[f64; 2]; 3] {
        std::array::from_fn(|axis| {
            self.vertices.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v[axis]), high.max(v[axis])])
        })
    }

    #[must_use]
    pub fn mapped(mut self, map: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        for v in &mut self.vertices {
            *v = map(*v);
        }
        self
    }

    /// Adds another closed mesh. The two may overlap.
    #[must_use]
    pub fn with(mut self, other: &Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
        self
    }

    /// The mesh with the longest side of its bounding box along x, its middle at the origin, and scaled to `length_um`.
    #[must_use]
    pub fn laid_along_x(self, length_um: f64) -> Self {
        let bounds = self.bounds();
        let side = |axis: usize| bounds[axis][1] - bounds[axis][0];
        let longest = (0..3).fold(0, |best, axis| if side(axis) > side(best) { axis } else { best });
        let scale = length_um / side(longest);
        // A cyclic exchange of the axes is a rotation: it does not mirror the shape.
        self.mapped(|v| {
            std::array::from_fn(|axis| {
                let from = (axis + longest) % 3;
                (v[from] - f64::midpoint(bounds[from][0], bounds[from][1])) * scale
            })
        })
    }

    /// The section of the plane at `x`: the end points (y, z) of all cut triangles, unordered.
    pub fn section(&self, x: f64) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        for corners in self.corners() {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if (a[0] <= x) != (b[0] <= x) {
                    let t = (x - a[0]) / (b[0] - a[0]);
                    points.push([a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])]);
                }
            }
        }
        points
    }

    /// A closed tube of `rings`: closed rings with the same number of points. Each end is closed by a fan from its tip.
    pub fn lofted(first_tip: [f64; 3], rings: &[Vec<[f64; 3]>], last_tip: [f64; 3]) -> Self {
        let n = rings.first().map_or(0, Vec::len) as u32;
        let mut mesh = Self { vertices: vec![first_tip, last_tip], triangles: Vec::new() };
        for ring in rings {
            mesh.vertices.extend_from_slice(ring);
        }
        let at = |ring: u32, k: u32| 2 + ring * n + k % n;
        let last = rings.len() as u32 - 1;
        for k in 0..n {
            mesh.triangles.push([0, at(0, k + 1), at(0, k)]);
            mesh.triangles.push([1, at(last, k), at(last, k + 1)]);
            for ring in 0..last {
                let (a, b, c, d) = (at(ring, k), at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1));
                mesh.triangles.push([a, b, c]);
                mesh.triangles.push([b, d, c]);
            }
        }
        if mesh.volume() < 0.0 {
            for t in &mut mesh.triangles {
                t.swap(1, 2);
            }
        }
        mesh
    }
}

fn vertex<'a>(line: usize, raw: &str, mut words: impl Iterator<Item = &'a str>) -> Result<[f64; 3], MeshError> {
    let mut next = || {
        words.next().and_then(|w| w.parse::<f64>().ok()).filter(|v| v.is_finite()).ok_or_else(|| MeshError::Line {
            line,
            found: raw.to_owned(),
            expected: "a vertex of three numbers such as `v 0.1 2 -3`",
        })
    };
    Ok([next()?, next()?, next()?])
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
        f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

    #[test]
    fn a_cube_has_volume_1_and_area_6_whichever_way_it_is_wound() {
        let cube = Mesh::from_obj(CUBE).unwrap();
        assert!((cube.volume() - 1.0).abs() < 1e-12 && (cube.area() - 6.0).abs() < 1e-12);
        let mut inside_out = cube.clone();
        inside_out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(inside_out.volume() < 0.0);
        assert!((inside_out.closed().unwrap().volume() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn an_open_mesh_is_refused_with_its_open_edges() {
        let lidless = CUBE.replace("f 5 6 7 8\n", "");
        let error = Mesh::from_obj(&lidless).unwrap_err();
        assert!(matches!(error, MeshError::Open { open: 4, .. }), "{error}");
        assert!(error.to_string().contains("close the holes"));
    }

    #[test]
    fn faces_of_different_winding_are_refused() {
        let twisted = CUBE.replace("f 5 6 7 8", "f 8 7 6 5");
        assert!(matches!(Mesh::from_obj(&twisted), Err(MeshError::Tangled { .. })));
    }

    #[test]
    fn unreadable_lines_are_named() {
        assert!(matches!(Mesh::from_obj("v 0 zero 0"), Err(MeshError::Line { line: 1, .. })));
        assert!(matches!(Mesh::from_obj("v 0 0 0\nf 1 2 3"), Err(MeshError::NoSuchVertex { line: 2, index: 2, vertices: 1 })));
        assert!(matches!(Mesh::from_obj(""), Err(MeshError::Flat { .. })));
    }
}
