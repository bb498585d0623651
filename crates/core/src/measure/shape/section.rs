//! Many plane sections of one closed mesh, along a body.
//!
//! ```text
//!   plane 0    1    2    3           rank of a vertex: planes that it lies beyond
//!      |  0 | 1 . | 2  |             a triangle with corners of ranks 1 and 3 is cut by planes 1 and 2,
//!      |    |  /\ |    |             each time in one side that is directed as its border is: area on its left
//! ```
//! The sides of a section are not linked. Area, centre, second moments and perimeter are sums over directed sides (Green),
//! which do not depend on their order except for rounding; holes and several pieces are correct. Triangles are visited in their
//! order, so that the sums are the same bits on any number of threads.

use super::Vector;
use crate::parallel::prelude::*;
use crate::surface::Mesh;

/// A plane with directions of its own.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    pub at: Vector,
    /// Two unit vectors in the plane; `across[0] x across[1] = along`.
    pub across: [Vector; 2],
    pub along: Vector,
}

impl Plane {
    pub fn height(&self, point: [f64; 3]) -> f64 {
        (Vector::from(point) - self.at).dot(&self.along)
    }

    fn flat(&self, point: Vector) -> [f64; 2] {
        let from = point - self.at;
        self.across.map(|a| from.dot(&a))
    }

    pub fn point(&self, [a, b]: [f64; 2]) -> Vector {
        self.at + self.across[0] * a + self.across[1] * b
    }
}

/// For each vertex the number of planes behind it. The planes must be in order and not meet within the mesh.
pub fn ranks(mesh: &Mesh, planes: &[Plane]) -> Vec<u32> {
    mesh.vertices.par_iter().map(|&v| planes.partition_point(|p| p.height(v) > 0.0) as u32).collect()
}

/// Sides of one section in the plane's coordinates, um, counter-clockwise around the inside.
#[derive(Debug, Clone, Default)]
pub struct Section {
    pub sides: Vec<[[f64; 2]; 2]>,
}

/// All sections, and the number of triangle corners that lie on the wrong side of a plane: the planes meet within the body
/// there.
pub fn cut(mesh: &Mesh, planes: &[Plane], ranks: &[u32]) -> (Vec<Section>, usize) {
    let mut sections = vec![Section::default(); planes.len()];
    let mut folded = 0;
    for &triangle in &mesh.triangles {
        let rank = triangle.map(|v| ranks[v as usize]);
        let (low, high) = (rank[0].min(rank[1]).min(rank[2]), rank[0].max(rank[1]).max(rank[2]));
        for at in low..high {
            let plane = &planes[at as usize];
            let corners = mesh.corners(triangle);
            let heights = corners.map(|p| plane.height(p));
            let beyond = rank.map(|r| r > at);
            folded += (0..3).filter(|&k| beyond[k] != (heights[k] > 0.0)).count();
            let mut side = [[0.0; 2]; 2];
            for k in 0..3 {
                let next = (k + 1) % 3;
                if beyond[k] != beyond[next] {
                    // Always from the corner before the plane: neighbouring triangles then get the same bits for their common
                    // end.
                    let (from, to) = if beyond[k] { (next, k) } else { (k, next) };
                    let span = heights[from] - heights[to];
                    // Where both ends are on one side of a folded plane the middle is used. Such sections are refused.
                    let part = if span == 0.0 { 0.5 } else { (heights[from] / span).clamp(0.0, 1.0) };
                    let (a, b) = (Vector::from(corners[from]), Vector::from(corners[to]));
                    // Seen around the triangle, the side begins where the border returns through the plane.
                    side[usize::from(beyond[next])] = plane.flat(a + (b - a) * part);
                }
            }
            sections[at as usize].sides.push(side);
        }
    }
    (sections, folded)
}

/// The area that a section's border encloses.
#[derive(Debug, Clone, Copy)]
pub struct Flat {
    pub area_um2: f64,
    pub perimeter_um: f64,
    pub centre: [f64; 2],
    /// Central second moments over the area, um^2: of the first direction, mixed, of the second.
    pub spread: [f64; 3],
}

impl Section {
    /// `None` where no area is enclosed.
    pub fn flat(&self) -> Option<Flat> {
        let (mut area, mut first, mut second, mut perimeter) = (0.0, [0.0; 2], [0.0; 3], 0.0);
        for &[[x, y], [u, v]] in &self.sides {
            let cross = x * v - u * y;
            area += cross / 2.0;
            first[0] += (x + u) * cross / 6.0;
            first[1] += (y + v) * cross / 6.0;
            second[0] += (x * x + x * u + u * u) * cross / 12.0;
            second[1] += (2.0 * x * y + x * v + u * y + 2.0 * u * v) * cross / 24.0;
            second[2] += (y * y + y * v + v * v) * cross / 12.0;
            perimeter += (u - x).hypot(v - y);
        }
        (area > 0.0).then(|| {
            let [a, b] = first.map(|f| f / area);
            let spread = [second[0] / area - a * a, second[1] / area - a * b, second[2] / area - b * b];
            Flat { area_um2: area, perimeter_um: perimeter, centre: [a, b], spread }
        })
    }

    /// Extent along each of the two directions.
    pub fn extent(&self) -> [f64; 2] {
        std::array::from_fn(|a| {
            let ends = self.sides.iter().flatten().fold([f64::INFINITY, f64::NEG_INFINITY], |e, p| [e[0].min(p[a]), e[1].max(p[a])]);
            (ends[1] - ends[0]).max(0.0)
        })
    }
}
