//! Outlines: traced around pixels, smoothed, walked in even steps, and filled again.
//!
//! ```text
//!   set of pixels --cracks between them--> closed staircase --smoothed--> even steps with normals
//!   polygons --winding number--> pixels whose centres they enclose
//! ```

use super::plane::gaussian;
use crate::profile::Columns;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A vertex within this distance of a column's edge lies on it, px.
const ON_EDGE_PX: f64 = 1.0;

/// A closed outline in pixel coordinates (pixel centres at integers). The last vertex is joined to the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Polygon {
    /// The vertices `[u, v]`, px.
    pub vertices: Vec<[f64; 2]>,
}

impl Polygon {
    /// The outline with other edges by column: what lay on an edge of `old` lies on that of `new`, and nothing lies beyond.
    pub(crate) fn with_edges(&self, old: &Columns, new: &Columns) -> Self {
        let moved = |&[u, v]: &[f64; 2]| {
            let column = u.round().max(0.0) as usize;
            let (Some(from), Some(to)) = (old.at(u).or(old.get(column)), new.at(u).or(new.get(column))) else { return [u, v] };
            let near = |edge: f64| (v - edge).abs() < ON_EDGE_PX;
            let v = if near(from.upper) {
                v + to.upper - from.upper
            } else if near(from.lower) {
                v + to.lower - from.lower
            } else {
                v
            };
            [u, v.max(to.upper).min(to.lower)]
        };
        Self { vertices: self.vertices.iter().map(moved).collect() }
    }

    /// Area enclosed, px^2.
    pub fn area_px2(&self) -> f64 {
        let n = self.vertices.len();
        let cross = |i: usize| {
            let ([u0, v0], [u1, v1]) = (self.vertices[i], self.vertices[(i + 1) % n]);
            u0 * v1 - u1 * v0
        };
        (0..n).map(cross).sum::<f64>().abs() / 2.0
    }
}

/// Closed outlines one after the other in one list of points.
#[derive(Debug, Default)]
pub(in crate::profile) struct Outlines {
    pub points: Vec<[f64; 2]>,
    pub ranges: Vec<Range<usize>>,
}

impl Outlines {
    pub fn clear(&mut self) {
        self.points.clear();
        self.ranges.clear();
    }

    pub fn each(&self) -> impl Iterator<Item = &[[f64; 2]]> {
        self.ranges.iter().map(|range| &self.points[range.clone()])
    }
}

/// Follows the cracks around each connected set of true pixels: outer outlines only, clockwise on the screen; those of fewer
/// than `least` cracks are left out. `used` is memory.
pub(in crate::profile) fn trace(inside: &[bool], width: usize, top: usize, least: usize, used: &mut Vec<bool>, out: &mut Outlines) {
    let height = inside.len() / width;
    let is = |u: isize, v: isize| {
        (0..width as isize).contains(&u) && (0..height as isize).contains(&v) && inside[v as usize * width + u as usize]
    };
    out.clear();
    // A crack that runs rightwards has an inside pixel below it and an outside pixel above it.
    used.clear();
    used.resize(inside.len(), false);
    for start in 0..inside.len() {
        // Most pixels start no outline. A position needs a division, so it is computed only for those that do.
        if !inside[start] || used[start] || (start >= width && inside[start - width]) {
            continue;
        }
        let (u, v) = ((start % width) as isize, (start / width) as isize);
        let first = out.points.len();
        let (mut corner, mut way) = ((u, v), (1isize, 0isize));
        // Twice the area enclosed, positive clockwise.
        let mut doubled = 0;
        loop {
            out.points.push([corner.0 as f64 - 0.5, corner.1 as f64 - 0.5 + top as f64]);
            if way == (1, 0) {
                used[corner.1 as usize * width + corner.0 as usize] = true;
            }
            doubled += corner.0 * way.1 - corner.1 * way.0;
            corner = (corner.0 + way.0, corner.1 + way.1);
            // The pixels ahead of the corner, on the left (outside) and on the right (inside) of the way.
            let ahead = |side: (isize, isize)| {
                let u = corner.0 + (way.0 + side.0 - 1).div_euclid(2);
                let v = corner.1 + (way.1 + side.1 - 1).div_euclid(2);
                is(u, v)
            };
            let (left, right) = ((way.1, -way.0), (-way.1, way.0));
            way = if ahead(left) {
                left
            } else if ahead(right) {
                way
            } else {
                right
            };
            if corner == (u, v) && way == (1, 0) {
                break;
            }
        }
        if doubled > 0 && out.points.len() - first >= least {
            out.ranges.push(first..out.points.len());
        } else {
            out.points.truncate(first);
        }
    }
}

/// Memory of [`smoothed`].
#[derive(Debug, Default)]
pub(in crate::profile) struct Smoother {
    kernel: Vec<f32>,
    means: Vec<[f64; 2]>,
}

/// Smooths the staircase of cracks away and walks what is left in steps of about `step_px`.
pub(in crate::profile) fn smoothed(cracks: &Outlines, sigma_px: f64, step_px: f64, memory: &mut Smoother, out: &mut Outlines) {
    gaussian(sigma_px, &mut memory.kernel);
    out.clear();
    for outline in cracks.each() {
        memory.means.clear();
        memory.means.resize(outline.len(), [0.0; 2]);
        smooth_cyclic(outline.as_flattened(), 2, &memory.kernel, memory.means.as_flattened_mut());
        let first = out.points.len();
        resample(&memory.means, step_px, &mut out.points);
        out.ranges.push(first..out.points.len());
    }
}

/// What a cyclic mean is taken of.
pub(in crate::profile) trait Mean: Copy {
    fn add(&mut self, weight: f32, other: Self);
}

impl Mean for f64 {
    fn add(&mut self, weight: f32, other: Self) {
        *self += f64::from(weight) * other;
    }
}

impl Mean for f32 {
    fn add(&mut self, weight: f32, other: Self) {
        *self += weight * other;
    }
}

/// Adds to `means` those of the places around each place, weighed by the kernel; a place is `at_each` values that follow each other.
pub(in crate::profile) fn smooth_cyclic<T: Mean>(values: &[T], at_each: usize, kernel: &[f32], means: &mut [T]) {
    let (n, reach) = (values.len() / at_each, kernel.len() / 2);
    if n == 0 {
        return;
    }
    let behind = n * (reach / n + 1) - reach;
    for (i, mean) in means.chunks_exact_mut(at_each).enumerate() {
        for (k, &weight) in kernel.iter().enumerate() {
            let from = (i + k + behind) % n * at_each;
            for (sum, &value) in mean.iter_mut().zip(&values[from..from + at_each]) {
                sum.add(weight, value);
            }
        }
    }
}

/// Appends vertices at equal steps of about `step_px` along a closed outline.
fn resample(outline: &[[f64; 2]], step_px: f64, out: &mut Vec<[f64; 2]>) {
    let n = outline.len();
    let side = |i: usize| {
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    };
    let length: f64 = (0..n).map(side).sum();
    let count = ((length / step_px).round() as usize).max(8);
    let (mut i, mut before) = (0, 0.0);
    for k in 0..count {
        let target = length * k as f64 / count as f64;
        while i + 1 < n && before + side(i) < target {
            before += side(i);
            i += 1;
        }
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        let part = ((target - before) / side(i).max(1e-12)).clamp(0.0, 1.0);
        out.push([a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]);
    }
}

/// Appends the unit normals that point inside a clockwise outline.
pub(in crate::profile) fn normals(points: &[[f64; 2]], out: &mut Vec<[f64; 2]>) {
    let n = points.len();
    out.extend((0..n).map(|i| {
        let (a, b) = (points[(i + n - 1) % n], points[(i + 1) % n]);
        let (du, dv) = (b[0] - a[0], b[1] - a[1]);
        let length = du.hypot(dv).max(1e-9);
        [-dv / length, du / length]
    }));
}

/// Crossings of polygon sides with the rows of a mask; memory of [`rasterise`].
#[derive(Debug, Default)]
pub(in crate::profile) struct Crossings {
    rows: Vec<Vec<(f64, i32)>>,
}

/// Marks every pixel whose centre an outline encloses (a vertex order that winds around it, in either sense).
pub(in crate::profile) fn rasterise(polygons: &[Polygon], mask: &mut super::mask::Mask, crossings: &mut Crossings) {
    fill(polygons.iter().map(|p| p.vertices.as_slice()), (mask.width(), mask.height()), crossings, |u, v| mask.set(u, v, true));
}

/// Calls back with every pixel of a picture of that size whose centre an outline encloses.
pub(in crate::profile) fn fill<'a>(
    outlines: impl Iterator<Item = &'a [[f64; 2]]>,
    (w, h): (usize, usize),
    crossings: &mut Crossings,
    mut each: impl FnMut(usize, usize),
) {
    // Rows that this picture does not have are kept for one that has them.
    if crossings.rows.len() < h {
        crossings.rows.resize(h, Vec::new());
    }
    let rows = &mut crossings.rows[..h];
    for vertices in outlines {
        rows.iter_mut().for_each(Vec::clear);
        let n = vertices.len();
        for i in 0..n {
            let ([u0, v0], [u1, v1]) = (vertices[i], vertices[(i + 1) % n]);
            let (from, to, way) = if v0 <= v1 { (v0, v1, 1) } else { (v1, v0, -1) };
            let first = from.ceil().max(0.0) as usize;
            // Half open: a vertex on a row belongs to the side below it only.
            let mut v = first;
            while (v as f64) < to && v < h {
                let part = (v as f64 - v0) / (v1 - v0);
                rows[v].push((u0 + part * (u1 - u0), way));
                v += 1;
            }
        }
        for (v, row) in rows.iter_mut().enumerate() {
            row.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            let mut winding = 0;
            for pair in row.windows(2) {
                winding += pair[0].1;
                if winding != 0 {
                    let from = pair[0].0.ceil().max(0.0) as usize;
                    let mut u = from;
                    while (u as f64) < pair[1].0 && u < w {
                        each(u, v);
                        u += 1;
                    }
                }
            }
        }
    }
}
