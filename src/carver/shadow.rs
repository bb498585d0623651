//! What one view says of a box of voxels: wholly covered, wholly missed, or cut by the outline.
//!
//! The image of a box is bounded around the image of its centre `c`: with `u_c = u(c)`, the numerator of `u - u_c` is linear
//! in space and 0 at `c`, so over the box `|u - u_c| <= sum_a |p_0a - u_c p_2a| h_a / w_min`. A slack for every rounding, of
//! the bound and of the voxels' own projection, makes the bound rigorous. Whether its pixels are all inside or all outside
//! is read from a table of sums in four look-ups.

use super::bits::{BLOCK, Bits, NONE};
use crate::geometry::{Projection, VoxelGrid};
use crate::profile::Mask;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Inside,
    Outside,
    Cut,
}

pub(super) struct Shadow<'a> {
    mask: &'a Mask,
    rows: [[f64; 4]; 3],
    centres: [Vec<f64>; 3],
    /// Largest magnitude that the terms of each row sum up to: the scale of its rounding errors.
    magnitude: [f64; 3],
    /// The pixels that the grid can reach, `[u0, u1) x [v0, v1)`, and the sums over them.
    reach: [usize; 4],
    sums: Vec<u32>,
}

/// Generous bound of the rounding of one row: it takes four products, three sums and a quotient, half an ulp each.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

impl<'a> Shadow<'a> {
    /// `sums` is a buffer to be reused.
    pub fn new(grid: &VoxelGrid, mask: &'a Mask, projection: &Projection, sums: Vec<u32>) -> Self {
        let counts = grid.counts();
        let centres: [Vec<f64>; 3] = std::array::from_fn(|a| (0..counts[a]).map(|i| grid.centre(a, i)).collect());
        let rows = *projection.rows();
        let far: [f64; 3] = std::array::from_fn(|a| centres[a][0].abs().max(centres[a][counts[a] - 1].abs()));
        let magnitude = rows.map(|r| r[0].abs() * far[0] + r[1].abs() * far[1] + r[2].abs() * far[2] + r[3].abs());
        let mut shadow = Self { mask, rows, centres, magnitude, reach: [0; 4], sums };
        shadow.reach = match shadow.bound([0; 3], counts) {
            Bound::Pixels { lo, hi, .. } => [lo[0], hi[0] + 1, lo[1], hi[1] + 1],
            Bound::Nowhere => [0; 4],
            Bound::Unknown => [0, mask.width(), 0, mask.height()],
        };
        shadow.sum_up();
        shadow
    }

    pub fn into_sums(self) -> Vec<u32> {
        self.sums
    }

    /// `sums[v][u]` is the number of covered pixels left of `u` and above `v`, counted from the reach's corner.
    fn sum_up(&mut self) {
        let [u0, u1, v0, v1] = self.reach;
        let stride = u1 - u0 + 1;
        self.sums.clear();
        self.sums.resize(stride * (v1 - v0 + 1), 0);
        for v in v0..v1 {
            let (above, below) = self.sums.split_at_mut((v - v0 + 1) * stride);
            let above = &above[(v - v0) * stride..];
            let mut row = 0;
            for ((sum, above), pixel) in below[1..stride].iter_mut().zip(&above[1..]).zip(&self.mask.row(v)[u0..u1]) {
                row += u32::from(*pixel != 0);
                *sum = above + row;
            }
        }
    }

    /// What the view says of the voxels from `lo` to before `hi`.
    pub fn judge(&self, lo: [usize; 3], hi: [usize; 3]) -> Verdict {
        let (lo, hi, whole) = match self.bound(lo, hi) {
            Bound::Pixels { lo, hi, whole } => (lo, hi, whole),
            Bound::Nowhere => return Verdict::Outside,
            Bound::Unknown => return Verdict::Cut,
        };
        // Both this bound and the reach hold every voxel's pixel, so their intersection does.
        let [u0, u1, v0, v1] = self.reach;
        let (ua, ub) = (lo[0].max(u0), (hi[0] + 1).min(u1));
        let (va, vb) = (lo[1].max(v0), (hi[1] + 1).min(v1));
        if ua >= ub || va >= vb {
            return Verdict::Cut;
        }
        let stride = u1 - u0 + 1;
        let at = |u: usize, v: usize| self.sums[(v - v0) * stride + u - u0];
        let covered = (at(ub, vb) - at(ua, vb)) - (at(ub, va) - at(ua, va));
        if covered == 0 {
            Verdict::Outside
        } else if whole && covered as usize == (ub - ua) * (vb - va) {
            Verdict::Inside
        } else {
            Verdict::Cut
        }
    }

    /// The voxels among `live` that this view misses; `lo` to before `hi` is at most one block.
    pub fn misses(&self, lo: [usize; 3], hi: [usize; 3], live: &Bits) -> Bits {
        let mut missed = NONE;
        for k in lo[2]..hi[2] {
            let layer = live[k - lo[2]];
            for j in lo[1]..hi[1] {
                let shift = BLOCK * (j - lo[1]);
                let row = layer >> shift & 0xff;
                if row == 0 {
                    continue;
                }
                let out = match self.judge([lo[0], j, k], [hi[0], j + 1, k + 1]) {
                    Verdict::Inside => 0,
                    Verdict::Outside => row,
                    Verdict::Cut => row & !self.covered_row(lo[0], hi[0], j, k),
                };
                missed[k - lo[2]] |= out << shift;
            }
        }
        missed
    }

    /// The definition, voxel by voxel: rounds as [`Projection::project`] and samples as [`Mask::covers`] do.
    fn covered_row(&self, lo: usize, hi: usize, j: usize, k: usize) -> u64 {
        let (y, z) = (self.centres[1][j], self.centres[2][k]);
        let rest = self.rows.map(|r| (r[1] * y + r[2] * z) + r[3]);
        let (width, height) = (self.mask.width() as f64, self.mask.height() as f64);
        let mut covered = 0;
        for (bit, &x) in self.centres[0][lo..hi].iter().enumerate() {
            let [u, v, w]: [f64; 3] = std::array::from_fn(|c| self.rows[c][0] * x + rest[c]);
            let (u, v) = (u / w + 0.5, v / w + 0.5);
            // Within these limits truncation is floor.
            if w > 0.0 && u >= 0.0 && v >= 0.0 && u < width && v < height && self.mask.get(u as usize, v as usize) {
                covered |= 1 << bit;
            }
        }
        covered
    }

    fn bound(&self, lo: [usize; 3], hi: [usize; 3]) -> Bound {
        let mut centre = [0.0; 3];
        let mut half = [0.0; 3];
        for a in 0..3 {
            let (first, last) = (self.centres[a][lo[a]], self.centres[a][hi[a] - 1]);
            centre[a] = 0.5 * (first + last);
            half[a] = 0.5 * (last - first);
        }
        let spread = |r: [f64; 3]| r[0].abs() * half[0] + r[1].abs() * half[1] + r[2].abs() * half[2];
        let at_centre = |r: &[f64; 4]| r[0] * centre[0] + r[1] * centre[1] + r[2] * centre[2] + r[3];
        let [ru, rv, rw] = &self.rows;
        let w = at_centre(rw);
        let reach = spread([rw[0], rw[1], rw[2]]) + ROUNDING * self.magnitude[2];
        if w + reach <= 0.0 {
            return Bound::Nowhere;
        }
        let w_min = w - reach;
        if w_min <= 0.0 {
            return Bound::Unknown;
        }
        let inverse = 1.0 / w_min;
        let mut lo_px = [0; 2];
        let mut hi_px = [0; 2];
        let mut whole = true;
        let sides = [self.mask.width(), self.mask.height()];
        for (axis, row) in [ru, rv].into_iter().enumerate() {
            let mid = at_centre(row) / w;
            let slack = ROUNDING * ((self.magnitude[axis] + mid.abs() * self.magnitude[2]) * inverse + mid.abs() + 1.0);
            let width = spread([row[0] - mid * rw[0], row[1] - mid * rw[1], row[2] - mid * rw[2]]) * inverse * (1.0 + ROUNDING) + slack;
            let (first, last) = (mid - width + 0.5, mid + width + 0.5);
            let side = sides[axis] as f64;
            if !(first.is_finite() && last.is_finite()) {
                return Bound::Unknown;
            }
            if last < 0.0 || first >= side {
                return Bound::Nowhere;
            }
            whole &= first >= 0.0 && last < side;
            lo_px[axis] = first.max(0.0) as usize;
            hi_px[axis] = (last as usize).min(sides[axis] - 1);
        }
        Bound::Pixels { lo: lo_px, hi: hi_px, whole }
    }
}

enum Bound {
    /// The pixels from `lo` to `hi`, both included; `whole` when nothing of the bound was cut off by the image's border.
    Pixels { lo: [usize; 2], hi: [usize; 2], whole: bool },
    /// Outside the image or behind the camera as a whole.
    Nowhere,
    /// Some of the box may lie behind the camera.
    Unknown,
}
