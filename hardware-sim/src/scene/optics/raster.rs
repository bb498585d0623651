//! The thickness of a closed mesh along each ray of the camera.
//!
//! ```text
//!   ray  ------|=========|-----|====|--->     thickness = sum of exit depths - sum of entry depths,
//!            entry     exit  entry exit       times the ray's length per depth
//! ```
//! Triangles are drawn on a grid of samples finer than the pixels, with corners snapped to 1/1024 of a sample and whole
//! numbers for the edges, so that neighbours share each sample exactly once and entries and exits always balance.

use crate::scene::camera::View;
use crate::scene::phantom::Mesh;
use rayon::prelude::*;

/// A block of pixels and how finely it is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    pub u0: i64,
    pub v0: i64,
    /// Size in pixels.
    pub width: usize,
    pub height: usize,
    /// Samples per pixel along u and v.
    pub fine_u: usize,
    pub fine_v: usize,
}

impl Window {
    pub fn columns(&self) -> usize {
        self.width * self.fine_u
    }

    pub fn rows(&self) -> usize {
        self.height * self.fine_v
    }

    /// Position of an image point in samples. Sample i is at i.
    pub fn to_samples(self, u_px: f64, v_px: f64) -> (f64, f64) {
        ((u_px + 0.5 - self.u0 as f64) * self.fine_u as f64 - 0.5, (v_px + 0.5 - self.v0 as f64) * self.fine_v as f64 - 0.5)
    }

    fn to_pixels(self, column: f64, row: f64) -> (f64, f64) {
        ((column + 0.5) / self.fine_u as f64 - 0.5 + self.u0 as f64, (row + 0.5) / self.fine_v as f64 - 0.5 + self.v0 as f64)
    }

    /// The pixels of the sensor that contain all `points`, with a margin. `None` if all points are outside the image.
    pub fn around(
        points: impl Iterator<Item = [f64; 2]>,
        margin: i64,
        (sensor_width, sensor_height): (u32, u32),
        (fine_u, fine_v): (usize, usize),
    ) -> Option<Self> {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for p in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        let first = |low: f64| (low.floor() as i64 - margin).max(0);
        let last = |high: f64, size: u32| (high.ceil() as i64 + margin).min(i64::from(size) - 1);
        let (u0, v0, u1, v1) = (first(low[0]), first(low[1]), last(high[0], sensor_width), last(high[1], sensor_height));
        (u1 >= u0 && v1 >= v0).then(|| Self { u0, v0, width: (u1 - u0 + 1) as usize, height: (v1 - v0 + 1) as usize, fine_u, fine_v })
    }
}

/// Steps per sample of the snapped corners.
const SNAP: i64 = 1024;
/// Rows that one task draws.
const BAND: usize = 64;

struct Corner {
    x: i64,
    y: i64,
    /// 1 / depth, which is linear in the image.
    nearness: f64,
}

/// Thickness along the ray of each sample, um.
pub fn thickness(mesh: &Mesh, view: &View, reference_depth_um: f64, window: &Window) -> Vec<f32> {
    let corners: Vec<Corner> = mesh
        .vertices
        .iter()
        .map(|&vertex| {
            let p = view.project(vertex);
            let (x, y) = window.to_samples(p.u_px, p.v_px);
            Corner { x: (x * SNAP as f64).round() as i64, y: (y * SNAP as f64).round() as i64, nearness: 1.0 / p.depth_um }
        })
        .collect();
    let columns = window.columns();
    let mut plane = vec![0.0f32; columns * window.rows()];
    plane.par_chunks_mut(columns * BAND).enumerate().for_each(|(band, rows)| {
        let first_row = (band * BAND) as i64;
        for t in &mesh.triangles {
            draw(t.map(|i| &corners[i as usize]), reference_depth_um, columns, first_row, rows);
        }
        for (i, row) in rows.chunks_mut(columns).enumerate() {
            for (column, value) in row.iter_mut().enumerate() {
                if *value != 0.0 {
                    let (u, v) = window.to_pixels(column as f64, (first_row as usize + i) as f64);
                    // Entry and exit at almost the same depth may give a rounding error below 0.
                    *value = (*value * view.ray_length_per_depth(u, v) as f32).max(1e-3);
                }
            }
        }
    });
    plane
}

/// Adds the depth of one triangle to the samples it covers: positive where the ray leaves the solid.
fn draw([p, q, r]: [&Corner; 3], reference_depth_um: f64, columns: usize, first_row: i64, rows: &mut [f32]) {
    let count = (rows.len() / columns) as i64;
    let (low, high) = (p.y.min(q.y).min(r.y), p.y.max(q.y).max(r.y));
    let top = low.div_euclid(SNAP).max(first_row);
    let bottom = (high.div_euclid(SNAP) + 1).min(first_row + count - 1);
    if top > bottom {
        return;
    }
    let doubled = (q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x);
    if doubled == 0 {
        return;
    }
    // The frame of u right, v down and z away is right-handed. A triangle that is seen from behind winds positively: the ray leaves.
    let (sign, a, b, c, doubled) = if doubled > 0 { (1.0, p, q, r, doubled) } else { (-1.0, p, r, q, -doubled) };
    let left = a.x.min(b.x).min(c.x).div_euclid(SNAP).max(0);
    let right = (a.x.max(b.x).max(c.x).div_euclid(SNAP) + 1).min(columns as i64 - 1);
    let edges = [Edge::new(b, c), Edge::new(c, a), Edge::new(a, b)];
    let scale = 1.0 / doubled as f64;
    for row in top..=bottom {
        let mut e = edges.each_ref().map(|edge| edge.at(left * SNAP, row * SNAP));
        let base = (row - first_row) as usize * columns;
        for column in left..=right {
            if (0..3).all(|k| e[k] > 0 || (e[k] == 0 && edges[k].owns)) {
                let nearness = (e[0] as f64 * a.nearness + e[1] as f64 * b.nearness + e[2] as f64 * c.nearness) * scale;
                rows[base + column as usize] += (sign * (1.0 / nearness - reference_depth_um)) as f32;
            }
            for k in 0..3 {
                e[k] += edges[k].per_column;
            }
        }
    }
}

/// A directed side of a triangle. Its function is positive inside.
struct Edge {
    x: i64,
    y: i64,
    dx: i64,
    dy: i64,
    per_column: i64,
    /// Two triangles share a side and draw it in opposite directions. Exactly one of them owns the samples on it.
    owns: bool,
}

impl Edge {
    fn new(from: &Corner, to: &Corner) -> Self {
        let (dx, dy) = (to.x - from.x, to.y - from.y);
        Self { x: from.x, y: from.y, dx, dy, per_column: -dy * SNAP, owns: dy > 0 || (dy == 0 && dx < 0) }
    }

    fn at(&self, x: i64, y: i64) -> i64 {
        self.dx * (y - self.y) - self.dy * (x - self.x)
    }
}

/// The samples that any of the meshes covers.
pub fn covered(planes: &[Vec<f32>]) -> Vec<bool> {
    let samples = planes.first().map_or(0, Vec::len);
    (0..samples).into_par_iter().map(|i| planes.iter().any(|plane| plane[i] > 0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::Camera;

    #[test]
    fn a_sample_on_an_edge_belongs_to_one_of_its_two_triangles() {
        // A cube whose sides and diagonals run exactly through samples, seen from so far that depth does not move them.
        let half = 5.5 * 10.5;
        let ring = |x: f64| [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[y, z]| [x, y * half, z * half]).to_vec();
        let cube = Mesh::lofted([-half, 0.0, 0.0], &[ring(-half), ring(half)], [half, 0.0, 0.0]);
        let camera = Camera { f_um: 6e7, ..Camera::default() };
        let window = Window { u0: 495, v0: 495, width: 34, height: 34, fine_u: 1, fine_v: 1 };
        let plane = thickness(&cube, &camera.view(0.0), camera.f_um, &window);
        // 21 steps of a pixel across, with the samples on one of each two opposite sides.
        assert_eq!(plane.iter().filter(|&&t| t > 0.0).count(), 21 * 21);
        for &t in plane.iter().filter(|&&t| t > 0.0) {
            assert!((f64::from(t) - 2.0 * half).abs() < 0.1, "{t} um instead of {}", 2.0 * half);
        }
    }
}
