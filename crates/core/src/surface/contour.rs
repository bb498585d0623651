//! One view's outline as a signed distance, sampled at the pixels around it.
//!
//! ```text
//!  sides of the polygons, or of the mask's pixels ── nearest within the band ── + inside, - outside ── um at the grid's depth
//!        . . -3 -2 -1 | 1  2  3  3  3  3 | ..                bilinear between pixel centres
//! ```
//! A displacement in the image is converted to the length of the shortest displacement of the object that causes it, so that
//! distances in views with different scales along and across the capillary can be compared.

use crate::carver::Leaves;
use crate::geometry::{Lookup, Projection};
use crate::profile::{Mask, Polygon};

/// The width of the band, as a sample.
const WHOLE_BAND: f32 = i16::MAX as f32;
/// Edge of the tiles whose extremes are stored, px.
const TILE: usize = 4;

/// Why a view has no signed distances.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ContourError {
    /// The centre of the box is at or too close to the camera.
    #[error(
        "the middle of the voxel box lies {depth} um in front of the camera, where a voxel and a half are {voxel_px} px, in an image of {image_px} \
         px: no outline can be followed there. Check the projection, the box and their units"
    )]
    Depth {
        /// Depth of the box's centre, um.
        depth: f64,
        /// Width of a voxel and a half in the image, px.
        voxel_px: f64,
        /// Larger side of the image, px.
        image_px: usize,
    },
}

/// One view's outline as a signed distance, um, positive inside.
#[derive(Debug, Clone)]
pub struct Contour {
    /// The projection into the crop. Sample (0, 0) of the crop is at column 0, row 0.
    rows: [[f64; 4]; 3],
    /// Where rows of points along x are seen through glass.
    lookup: Lookup,
    columns: usize,
    lines: usize,
    /// Distances in 32767ths of the band: half the memory of `f32`, with a resolution of a thousandth of a um.
    samples: Vec<i16>,
    /// Smallest and largest distance that can be interpolated from the samples of each tile.
    tiles: Vec<[f32; 2]>,
    tile_columns: usize,
    band_um: f32,
}

/// Where a whole box lies in one view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// At least the width of the band away from the outline, on the inside.
    Inside,
    Outside,
    Near,
}

impl Contour {
    /// The distances of one view. `outlines` are those that `mask` was filled from; without any, the sides of the mask's pixels
    /// are the outline. Distances are valid up to `reach_um`, measured at the depth of `centre`.
    ///
    /// # Errors
    ///
    /// A camera at or close to the box's centre, where distances have no scale.
    pub fn new(
        mask: &Mask,
        outlines: &[Polygon],
        projection: &Projection,
        leaves: Leaves,
        centre: [f64; 3],
        reach_um: f64,
    ) -> Result<Self, ContourError> {
        let metric = Metric::at(projection, centre);
        let [wide, high] = metric.span_px(reach_um);
        let (depth, voxel_px, image_px) = (projection.depth(centre), wide.max(high), mask.width().max(mask.height()));
        // Values that are not numbers fail every comparison.
        if !(depth > 0.0 && voxel_px < image_px as f64 && metric.pixel_um().is_finite()) {
            return Err(ContourError::Depth { depth, voxel_px, image_px });
        }
        // Samples around the outline must be exact where a point within reach is interpolated from them: up to a pixel's
        // diagonal.
        let band_um = reach_um + 2.0 * metric.pixel_um();
        let sides: Vec<[[f64; 2]; 2]> = if outlines.is_empty() {
            pixel_sides(mask)
        } else {
            outlines.iter().flat_map(|p| (0..p.vertices.len()).map(|i| [p.vertices[i], p.vertices[(i + 1) % p.vertices.len()]])).collect()
        };
        let border = Border { width: mask.width() as f64, height: mask.height() as f64, leaves, px_per_um: metric.span_px(1.0) };
        let sides: Vec<_> = sides.into_iter().filter(|side| !border.is_left_through(side)).collect();
        let margin = metric.span_px(band_um).map(|px| px.ceil() + 1.0);
        let bound = |axis: usize, sign: f64| sides.iter().flatten().map(|p| sign * p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let low: [f64; 2] = std::array::from_fn(|a| if sides.is_empty() { 0.0 } else { (-bound(a, -1.0) - margin[a]).floor() });
        let high: [f64; 2] = std::array::from_fn(|a| if sides.is_empty() { 1.0 } else { (bound(a, 1.0) + margin[a]).ceil() });
        let [columns, lines] = [0, 1].map(|a| (high[a] - low[a]) as usize + 1);

        let mut squares = vec![(band_um * band_um) as f32; columns * lines];
        for [a, b] in &sides {
            let [from, to] = [a, b].map(|p| [p[0] - low[0], p[1] - low[1]]);
            metric.draw(from, to, band_um, columns, &mut squares);
        }
        // What lies beyond the border is not known. The outline is assumed to continue in the direction in which it reaches the
        // border.
        let end = [mask.width(), mask.height()].map(|n| n.max(1) as f64 - 1.0);
        let sample = |n: usize| {
            let (u, v) = ((n % columns) as f64 + low[0], (n / columns) as f64 + low[1]);
            // Beyond a side through which it leaves, the specimen is assumed to continue as in the last column of the image.
            let least = if leaves.left { 0.0 } else { f64::NEG_INFINITY };
            let most = if leaves.right { end[0] } else { f64::INFINITY };
            let column = ((u.clamp(least, most) - low[0]) as usize).min(columns - 1);
            let distance = squares[n / columns * columns + column].sqrt();
            let signed = if mask.covers(u.clamp(0.0, end[0]), v.clamp(0.0, end[1])) { distance } else { -distance };
            signed.min(border.inside_um(u, v).clamp(-band_um, band_um) as f32)
        };
        let samples: Vec<f32> = (0..columns * lines).map(sample).collect();
        let p = projection.rows();
        let shifted = |row: usize| std::array::from_fn(|c| p[row][c] - low[row] * p[2][c]);
        let (tiles, tile_columns) = extremes(&samples, columns, lines);
        let band_um = band_um as f32;
        let samples = samples.iter().map(|um| (um / band_um * WHOLE_BAND).round() as i16).collect();
        Ok(Self {
            rows: [shifted(0), shifted(1), p[2]],
            lookup: projection.lookup(),
            columns,
            lines,
            samples,
            tiles,
            tile_columns,
            band_um,
        })
    }

    /// Where all points of a box between two corners lie.
    pub(super) fn side(&self, low: [f64; 3], high: [f64; 3]) -> Side {
        let (mut from, mut to) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for n in 0..8 {
            let corner: [f64; 3] = std::array::from_fn(|a| if n >> a & 1 == 0 { low[a] } else { high[a] });
            let [y, z] = self.lookup.apparent([corner[1], corner[2]]);
            let [u, v, w] = self.rows.map(|r| r[0] * corner[0] + r[1] * y + r[2] * z + r[3]);
            if w <= 0.0 {
                return Side::Near;
            }
            for (a, at) in [u / w, v / w].into_iter().enumerate() {
                from[a] = from[a].min(at);
                to[a] = to[a].max(at);
            }
        }
        // A hundredth of a pixel is added for the rounding of the points in between, and a pixel where glass bends the box.
        let more = if self.lookup.is_through_glass() { 1.0 } else { 0.01 };
        let tile = |at: f64, end: usize| (at.clamp(0.0, (end - 1) as f64) as usize) / TILE;
        let [first, last] =
            [(from, -more), (to, more)].map(|(at, more)| [tile(at[0] + more, self.columns), tile(at[1] + more, self.lines)]);
        let (mut least, mut largest) = (f32::INFINITY, f32::NEG_INFINITY);
        for row in first[1]..=last[1] {
            for [low, high] in &self.tiles[row * self.tile_columns..][first[0]..=last[0]] {
                least = least.min(*low);
                largest = largest.max(*high);
            }
        }
        // The band was squared and its root taken again, which rounds it.
        let band_um = 0.999 * self.band_um;
        match (least, largest) {
            (low, _) if low >= band_um => Side::Inside,
            (_, high) if high <= -band_um => Side::Outside,
            _ => Side::Near,
        }
    }

    pub(super) fn band_um(&self) -> f32 {
        self.band_um
    }

    /// Distances of the points `start + n step e_x`, um.
    pub(super) fn row<const N: usize>(&self, start: [f64; 3], step: f64) -> [f32; N] {
        let [y, z] = self.lookup.apparent([start[1], start[2]]);
        let at = self.rows.map(|r| r[0] * start[0] + ((r[1] * y + r[2] * z) + r[3]));
        // In the small coordinates of the crop `f32` has a resolution of a ten-thousandth of a pixel.
        let at = at.map(|x| x as f32);
        let by = self.rows.map(|r| (r[0] * step) as f32);
        // The last sample is outside by the whole band, and so is every value between it and the next.
        let (right, bottom) = (below(self.columns - 1), below(self.lines - 1));
        let w: [f32; N] = std::array::from_fn(|n| at[2] + n as f32 * by[2]);
        let u: [f32; N] = std::array::from_fn(|n| clamp((at[0] + n as f32 * by[0]) / w[n], right));
        let v: [f32; N] = std::array::from_fn(|n| clamp((at[1] + n as f32 * by[1]) / w[n], bottom));
        // Whole columns and rows. Processors convert to `i32` in one instruction.
        let (i, j) = (u.map(|u| u as i32), v.map(|v| v as i32));
        let (s, t): ([f32; N], [f32; N]) = (std::array::from_fn(|n| u[n] - i[n] as f32), std::array::from_fn(|n| v[n] - j[n] as f32));
        let mut corners = [[0.0; 4]; N];
        for n in 0..N {
            let first = j[n] as usize * self.columns + i[n] as usize;
            let (upper, lower) = (&self.samples[first..][..2], &self.samples[first + self.columns..][..2]);
            corners[n] = [upper[0], upper[1], lower[0], lower[1]].map(f32::from);
        }
        let um = self.band_um / WHOLE_BAND;
        std::array::from_fn(|n| {
            let [a, b, c, d] = corners[n];
            let (upper, lower) = (a + s[n] * (b - a), c + s[n] * (d - c));
            if w[n] > 0.0 { um * (upper + t[n] * (lower - upper)) } else { -self.band_um }
        })
    }
}

/// The largest number below `n`.
fn below(n: usize) -> f32 {
    (n as f32).next_down()
}

/// Limits `x` to 0 and `end`; 0 for a value that is not a number.
fn clamp(x: f32, end: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < end { x } else { end }
}

/// The border of the image. Nothing is covered beyond it, except where the specimen leaves the image.
struct Border {
    width: f64,
    height: f64,
    leaves: Leaves,
    px_per_um: [f64; 2],
}

impl Border {
    /// Whether an outline runs along a side through which the specimen leaves. It is then not the specimen's outline.
    fn is_left_through(&self, side: &[[f64; 2]; 2]) -> bool {
        (self.leaves.left && side.iter().all(|p| p[0] < 0.5)) || (self.leaves.right && side.iter().all(|p| p[0] > self.width - 1.5))
    }

    fn inside_um(&self, u: f64, v: f64) -> f64 {
        let left = if self.leaves.left { f64::INFINITY } else { u + 0.5 };
        let right = if self.leaves.right { f64::INFINITY } else { self.width - 0.5 - u };
        let along = left.min(right) / self.px_per_um[0];
        let across = (v + 0.5).min(self.height - 0.5 - v) / self.px_per_um[1];
        along.min(across)
    }
}

/// Sides between inside and outside pixels, and those of inside pixels at the image's border.
fn pixel_sides(mask: &Mask) -> Vec<[[f64; 2]; 2]> {
    let (w, h) = (mask.width(), mask.height());
    let inside = |u: usize, v: usize| u < w && v < h && mask.get(u, v);
    let is_empty = |v: usize| v >= h || mask.row(v).iter().all(|&p| p == 0);
    let mut sides = Vec::new();
    let mut empty_above = true;
    for v in 0..=h {
        let empty = is_empty(v);
        if !(empty && empty_above) {
            for u in 0..=w {
                let here = inside(u, v);
                let at = [u as f64 - 0.5, v as f64 - 0.5];
                // Pixels before the first one wrap to huge numbers, which are outside.
                if here != inside(u.wrapping_sub(1), v) {
                    sides.push([at, [at[0], at[1] + 1.0]]);
                }
                if here != inside(u, v.wrapping_sub(1)) {
                    sides.push([at, [at[0] + 1.0, at[1]]]);
                }
            }
        }
        empty_above = empty;
    }
    sides
}

/// For each tile the extremes of the samples from which its points are interpolated, including those of the next column and
/// row.
fn extremes(samples: &[f32], columns: usize, lines: usize) -> (Vec<[f32; 2]>, usize) {
    let tile_columns = columns.div_ceil(TILE);
    let mut tiles = vec![[f32::INFINITY, f32::NEG_INFINITY]; tile_columns * lines.div_ceil(TILE)];
    for (row, line) in tiles.chunks_exact_mut(tile_columns).zip(0..) {
        for v in TILE * line..(TILE * line + TILE + 1).min(lines) {
            let values = &samples[v * columns..(v + 1) * columns];
            for (tile, column) in row.iter_mut().zip(0..) {
                for &value in &values[TILE * column..(TILE * column + TILE + 1).min(columns)] {
                    *tile = [tile[0].min(value), tile[1].max(value)];
                }
            }
        }
    }
    (tiles, tile_columns)
}

/// Converts a displacement in the image, px, to um: `|W d|`, where `W W^T` is the inverse of `J J^T` and `J` is the derivative
/// of the image by the object.
struct Metric {
    w: [[f64; 2]; 2],
    /// `J J^T`, px^2 / um^2.
    gain: [[f64; 2]; 2],
}

impl Metric {
    fn at(projection: &Projection, centre: [f64; 3]) -> Self {
        let p = projection.rows();
        let [u, v, w] = p.map(|r| r[0] * centre[0] + r[1] * centre[1] + r[2] * centre[2] + r[3]);
        let w = if w.abs() > f64::MIN_POSITIVE { w } else { f64::MIN_POSITIVE };
        let j: [[f64; 3]; 2] = [(0, u / w), (1, v / w)].map(|(row, at)| std::array::from_fn(|c| (p[row][c] - at * p[2][c]) / w));
        let gain: [[f64; 2]; 2] = std::array::from_fn(|a| std::array::from_fn(|b| (0..3).map(|c| j[a][c] * j[b][c]).sum()));
        // The inverse of the lower triangular root of the gain.
        let l00 = gain[0][0].sqrt();
        let l10 = gain[1][0] / l00;
        let l11 = (gain[1][1] - l10 * l10).sqrt();
        Self { w: [[1.0 / l00, 0.0], [-l10 / (l00 * l11), 1.0 / l11]], gain }
    }

    fn um(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        [self.w[0][0] * u, self.w[1][0] * u + self.w[1][1] * v]
    }

    /// The larger side of a pixel.
    fn pixel_um(&self) -> f64 {
        let length = |d: [f64; 2]| self.um(d)[0].hypot(self.um(d)[1]);
        length([1.0, 0.0]).max(length([0.0, 1.0]))
    }

    /// How far displacements of that length reach along u and v, px.
    fn span_px(&self, um: f64) -> [f64; 2] {
        [0, 1].map(|a| um * self.gain[a][a].sqrt())
    }

    /// Lowers the squared distances of the samples around a side to the distance to that side.
    fn draw(&self, a: [f64; 2], b: [f64; 2], band_um: f64, columns: usize, squares: &mut [f32]) {
        let reach = self.span_px(band_um);
        let range = |axis: usize| {
            let (low, high) = (a[axis].min(b[axis]) - reach[axis], a[axis].max(b[axis]) + reach[axis]);
            low.ceil().max(0.0) as usize..=high.floor().max(0.0) as usize
        };
        let along = self.um([b[0] - a[0], b[1] - a[1]]);
        let length2 = along[0] * along[0] + along[1] * along[1];
        let share = if length2 > 0.0 { 1.0 / length2 } else { 0.0 };
        for v in range(1) {
            let line = &mut squares[v * columns..(v + 1) * columns];
            for u in range(0) {
                let to = self.um([u as f64 - a[0], v as f64 - a[1]]);
                let t = ((to[0] * along[0] + to[1] * along[1]) * share).clamp(0.0, 1.0);
                let off = [to[0] - t * along[0], to[1] - t * along[1]];
                line[u] = line[u].min((off[0] * off[0] + off[1] * off[1]) as f32);
            }
        }
    }
}
