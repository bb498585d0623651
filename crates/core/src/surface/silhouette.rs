//! A mesh projected to a mask: for the overlap of a hull with its profiles, and for pictures.

use super::Mesh;
use crate::geometry::Projection;
use crate::profile::Mask;

/// The silhouette of a mesh. A pixel is inside where its centre lies in the image of some triangle. Triangles with a corner
/// that is not in front of the camera are left out.
pub fn silhouette(mesh: &Mesh, projection: &Projection, width: usize, height: usize) -> Mask {
    let lookup = projection.lookup();
    let points: Vec<Option<(f64, f64)>> = mesh.vertices.iter().map(|&v| lookup.project(v)).collect();
    let mut mask = Mask::empty(width, height);
    for triangle in &mesh.triangles {
        if let [Some(a), Some(b), Some(c)] = triangle.map(|v| points[v as usize]) {
            fill(&mut mask, [a, b, c]);
        }
    }
    mask
}

/// Row by row between the crossings of the sides. Both ends belong to the triangle, so that neighbours leave no gap.
fn fill(mask: &mut Mask, corners: [(f64, f64); 3]) {
    let low = corners.iter().fold(f64::INFINITY, |m, c| m.min(c.1));
    let high = corners.iter().fold(f64::NEG_INFINITY, |m, c| m.max(c.1));
    let first = low.ceil().max(0.0);
    let last = high.floor().min(mask.height() as f64 - 1.0);
    let rows = if first <= last { first as usize..last as usize + 1 } else { 0..0 };
    for v in rows {
        let y = v as f64;
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..3 {
            let ((u0, v0), (u1, v1)) = (corners[i], corners[(i + 1) % 3]);
            if y < v0.min(v1) || y > v0.max(v1) {
                continue;
            }
            let share = (y - v0) / (v1 - v0);
            // A side that lies in the row has no crossing: both its ends count.
            let ends = if share.is_finite() { [u0 + share * (u1 - u0); 2] } else { [u0, u1] };
            left = left.min(ends[0].min(ends[1]));
            right = right.max(ends[0].max(ends[1]));
        }
        let (from, to) = (left.ceil().max(0.0), right.floor().min(mask.width() as f64 - 1.0));
        if from <= to {
            (from as usize..=to as usize).for_each(|u| mask.set(u, v, true));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera that shows world (x, y) as pixel (x, y).
    fn plain() -> Projection {
        Projection::from_matrix([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).unwrap()
    }

    #[test]
    fn pixel_centres_within_a_triangle_are_inside_and_no_others() {
        let mesh = Mesh { vertices: vec![[2.2, 1.0, 1.0], [9.5, 3.5, 1.0], [3.0, 8.1, 1.0]], triangles: vec![[0, 1, 2]] };
        let mask = silhouette(&mesh, &plain(), 12, 10);
        let [a, b, c] = mesh.corners([0, 1, 2]);
        let side = |p: [f64; 3], q: [f64; 3], u: f64, v: f64| (q[0] - p[0]) * (v - p[1]) - (q[1] - p[1]) * (u - p[0]);
        for v in 0..10 {
            for u in 0..12 {
                let within = [(a, b), (b, c), (c, a)].iter().all(|&(p, q)| side(p, q, u as f64, v as f64) >= 0.0);
                assert_eq!(mask.get(u, v), within, "{u}, {v}");
            }
        }
        assert!(mask.area_px() > 15);
    }

    /// Triangles smaller than a pixel leave no pixel out along the sides they share, and the image may cut a mesh off.
    #[test]
    fn a_finely_cut_square_has_no_holes_and_is_clipped() {
        let n = 90;
        let at = |i: usize| -3.0 + i as f64 / 5.0;
        let vertices = (0..=n).flat_map(|j| (0..=n).map(move |i| [at(i), at(j), 1.0])).collect();
        let id = |i: usize, j: usize| (j * (n + 1) + i) as u32;
        let triangles = (0..n)
            .flat_map(|j| {
                (0..n).flat_map(move |i| [[id(i, j), id(i + 1, j), id(i, j + 1)], [id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)]])
            })
            .collect();
        let mask = silhouette(&Mesh { vertices, triangles }, &plain(), 20, 12);
        assert_eq!(mask.area_px(), 16 * 12, "columns 0 to 15 of every row");
    }
}
