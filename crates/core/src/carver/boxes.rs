//! Lookup for any projection: boxes of voxels are judged as a whole, and divided where the outline cuts them.
//!
//! The image of a box is bounded around the image of its centre `c`: with `u_c = u(c)`, the numerator of `u - u_c` is linear in
//! space and 0 at `c`, so over the box `|u - u_c| <= sum_a |p_0a - u_c p_2a| h_a / w_min`. A slack for the rounding of the
//! bound and of the voxels' own projection makes the bound rigorous. Whether its pixels are all inside or all outside is read
//! from a table of sums in four lookups.

use super::counts::{ROW, SIDE, Words, ones};
use super::definition::{ROUNDING, View};
use super::misses::{Missed, Verdict};

/// Voxels of a row that are judged together within a block.
const PIECE: usize = 8;

pub(super) struct Boxes<'a> {
    view: View<'a>,
    magnitude: [f64; 3],
    /// The pixels that the grid can reach, `[u0, u1) x [v0, v1)`, and their table of sums.
    reach: [usize; 4],
    sums: &'a mut Vec<u32>,
}

impl<'a> Boxes<'a> {
    /// `sums` is a buffer that is reused.
    pub fn new(view: View<'a>, sums: &'a mut Vec<u32>) -> Self {
        let counts = [0, 1, 2].map(|a| view.centres[a].len());
        let mut boxes = Self { view, magnitude: view.magnitude(), reach: [0; 4], sums };
        boxes.reach = match boxes.bound([0; 3], counts) {
            Bound::Pixels { lo, hi, .. } => [lo[0], hi[0] + 1, lo[1], hi[1] + 1],
            Bound::Nowhere => [0; 4],
            Bound::Unknown => [0, view.runs.width(), 0, view.runs.height()],
        };
        boxes.sum_up();
        boxes
    }

    /// `sums[v][u]` is the number of covered pixels left of `u` and above `v`, counted from the reach's corner.
    fn sum_up(&mut self) {
        let [u0, u1, v0, v1] = self.reach;
        let stride = u1 - u0 + 1;
        self.sums.clear();
        self.sums.resize(stride * (v1 - v0 + 1), 0);
        for v in v0..v1 {
            let (above, below) = self.sums.split_at_mut((v - v0 + 1) * stride);
            let (above, row) = (&above[(v - v0) * stride..], &mut below[..stride]);
            for &[start, end] in self.view.runs.row(v) {
                let (start, end) = (usize::from(start).clamp(u0, u1), usize::from(end).clamp(u0, u1));
                row[1 + start - u0..=end - u0].fill(1);
            }
            let mut covered = 0;
            for (sum, above) in row.iter_mut().zip(above) {
                covered += *sum;
                *sum = above + covered;
            }
        }
    }

    /// What the view misses of a block, from `lo` to before `hi`. `live` gives its rows with live voxels.
    pub fn missed(&self, lo: [usize; 3], hi: [usize; 3], live: &Words) -> Missed {
        match self.judge(lo, hi) {
            Verdict::Inside => return Missed::None,
            Verdict::Outside => return Missed::All,
            Verdict::Cut => {}
        }
        let mut words = [0; SIDE * SIDE];
        for from in (lo[0]..hi[0]).step_by(PIECE) {
            let (shift, to) = (from % ROW, (from + PIECE).min(hi[0]));
            let piece = |word: u64| word >> shift & ones(to - from);
            match self.judge([from, lo[1], lo[2]], [to, hi[1], hi[2]]) {
                Verdict::Inside => {}
                Verdict::Outside => words.iter_mut().for_each(|word| *word |= piece(u64::MAX) << shift),
                Verdict::Cut => {
                    for (row, word) in words.iter_mut().enumerate().filter(|(row, _)| piece(live[*row]) != 0) {
                        let (j, k) = (lo[1] + row % SIDE, lo[2] + row / SIDE);
                        let out = match self.judge([from, j, k], [to, j + 1, k + 1]) {
                            Verdict::Inside => 0,
                            Verdict::Outside => piece(u64::MAX),
                            Verdict::Cut => self.missed_of_row(from, to, j, k),
                        };
                        *word |= out << shift;
                    }
                }
            }
        }
        Missed::Some(words)
    }

    fn missed_of_row(&self, from: usize, to: usize, j: usize, k: usize) -> u64 {
        let rest = self.view.rest(j, k);
        (from..to).enumerate().fold(0, |out, (bit, i)| out | u64::from(!self.view.covers(i, &rest)) << bit)
    }

    /// What the view shows of the voxels from `lo` to before `hi`.
    fn judge(&self, lo: [usize; 3], hi: [usize; 3]) -> Verdict {
        let (lo, hi, whole) = match self.bound(lo, hi) {
            Bound::Pixels { lo, hi, whole } => (lo, hi, whole),
            Bound::Nowhere => return Verdict::Outside,
            Bound::Unknown => return Verdict::Cut,
        };
        // Both this bound and the reach contain every voxel's pixel, and so does their intersection.
        let [u0, u1, v0, v1] = self.reach;
        let (ua, ub) = (lo[0].max(u0), (hi[0] + 1).min(u1));
        let (va, vb) = (lo[1].max(v0), (hi[1] + 1).min(v1));
        if ua >= ub || va >= vb {
            return Verdict::Cut;
        }
        let stride = u1 - u0 + 1;
        let at = |u: usize, v: usize| self.sums[(v - v0) * stride + u - u0];
        let covered = (at(ub, vb) - at(ua, vb)) - (at(ub, va) - at(ua, va));
        // Where a specimen leaves the image the last column decides, which is among these pixels.
        if covered == 0 {
            Verdict::Outside
        } else if whole && covered as usize == (ub - ua) * (vb - va) {
            Verdict::Inside
        } else {
            Verdict::Cut
        }
    }

    fn bound(&self, lo: [usize; 3], hi: [usize; 3]) -> Bound {
        // The image of a box through glass is not that of its corners.
        if self.view.lookup.is_through_glass() {
            return Bound::Unknown;
        }
        let mut centre = [0.0; 3];
        let mut half = [0.0; 3];
        for a in 0..3 {
            let (first, last) = (self.view.centres[a][lo[a]], self.view.centres[a][hi[a] - 1]);
            centre[a] = 0.5 * (first + last);
            half[a] = 0.5 * (last - first);
        }
        let spread = |r: [f64; 3]| r[0].abs() * half[0] + r[1].abs() * half[1] + r[2].abs() * half[2];
        let at_centre = |r: &[f64; 4]| r[0] * centre[0] + r[1] * centre[1] + r[2] * centre[2] + r[3];
        let [ru, rv, rw] = self.view.rows;
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
        let sides = [self.view.runs.width(), self.view.runs.height()];
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
                return if axis == 0 && self.view.leaves.any() { Bound::Unknown } else { Bound::Nowhere };
            }
            whole &= first >= 0.0 && last < side;
            lo_px[axis] = first.max(0.0) as usize;
            hi_px[axis] = (last as usize).min(sides[axis] - 1);
        }
        Bound::Pixels { lo: lo_px, hi: hi_px, whole }
    }
}

enum Bound {
    /// The pixels from `lo` to `hi`, both included. `whole` when the image's border cut nothing off the bound.
    Pixels { lo: [usize; 2], hi: [usize; 2], whole: bool },
    /// Entirely outside of the image or behind the camera.
    Nowhere,
    /// Part of the box may lie behind the camera, or where a specimen that leaves the image continues.
    Unknown,
}
