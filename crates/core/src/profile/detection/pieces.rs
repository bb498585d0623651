//! The separate things in the bore, and the appearance of each.
//!
//! ```text
//!    bubble: black, lit in its middle      (#o#)        bead: clear with a black rim, round      (   )
//!    debris: small, dark or not             <#          larva: large, half transparent           ~~~~~~o
//! ```

use super::opacity::Grid;
use super::probability::{logistic, noisy_or};
use std::f64::consts::FRAC_PI_4;

/// Figures of one connected thing.
#[derive(Debug, Clone, Copy)]
pub(in crate::profile) struct Piece {
    pub label: u16,
    /// Whether the segmentation took it for the specimen or a part of it.
    pub in_mask: bool,
    /// Position of its left end.
    pub from_bore: f64,
    pub area_bore2: f64,
    /// Extent along and across the capillary.
    pub size_bore: [f64; 2],
    /// Share of its inner cells that transmit hardly any light.
    pub black: f64,
    /// Half its width where it is widest.
    pub half_width_bore: f64,
    /// Opacity next to its outline.
    pub rim: f64,
    /// Difference between the brightest place near its middle and its mean, share of the light.
    pub middle_light: f64,
}

/// Likelihoods of what a thing may be. The rest to 1 is the likelihood that it is nothing.
#[derive(Debug, Clone, Copy)]
pub(in crate::profile) struct Looks {
    pub larva: f64,
    pub bead: f64,
    pub bubble: f64,
    pub debris: f64,
}

/// Opacity from which a cell counts as black: an eye, air.
pub(in crate::profile) const BLACK: f32 = 0.9;
/// Smaller things are ignored: share of the squared bore (10 um in a bore of 650 um).
const SPECK_BORE2: f64 = 0.000_25;

impl Piece {
    /// Whether both have something in the same stretch of the capillary.
    pub fn beside(&self, other: &Self) -> bool {
        let to = |p: &Self| p.from_bore + p.size_bore[0];
        self.from_bore < to(other) && other.from_bore < to(self)
    }

    pub fn looks(&self) -> Looks {
        // Air is black almost to its outline. A living larva's eyes and pigment are at most a quarter of it.
        let opaque = logistic(self.black, 0.5, 0.12);
        let clear = 1.0 - opaque;
        // Air transmits light at normal incidence. A bead is clear except for its rim.
        let lit = logistic(self.middle_light, 0.15, 0.06);
        let [along, across] = self.size_bore;
        // An ellipse fills pi / 4 of its box. A plug fills more; a larva, a chip and a fibre fill less.
        let full = logistic(self.area_bore2 / (along * across) / FRAC_PI_4, 0.87, 0.05);
        // Glass in air magnifies only across the capillary, by at most 1.33.
        let ball = full * lit * logistic(-(along / across).ln().abs(), -0.38, 0.08) * logistic(self.rim, 0.45, 0.1);
        // No larva shows less than a square of half a bore, is as thin as a scratch, or is as clear as the water between
        // scratches.
        let large = logistic(self.area_bore2.ln(), 0.25f64.ln(), 0.5)
            * logistic(self.half_width_bore, 0.05, 0.015)
            * logistic(self.rim, 0.19, 0.04);
        let air = full * noisy_or([lit, large]);
        // A dead larva is opaque too, and long. Bubbles that touch are not.
        let long = logistic((along / across).ln(), 2.5f64.ln(), 0.3);
        // Dust on the glass and in the water is up to 6 px wide in a bore of 112 px.
        let there = logistic(self.area_bore2.ln(), 0.004f64.ln(), 0.5);
        Looks {
            bubble: there * opaque * (air + (1.0 - full) * large * (1.0 - long)),
            bead: there * clear * ball,
            larva: there * large * (opaque * (1.0 - full) * long + clear * (1.0 - ball)),
            debris: there * (1.0 - large) * (opaque * (1.0 - air) + clear * (1.0 - ball)),
        }
    }
}

/// The sums over the cells of one thing.
#[derive(Debug, Clone, Copy)]
struct Sums {
    cells: usize,
    masked: bool,
    inner: usize,
    black: usize,
    low: [usize; 2],
    high: [usize; 2],
    light: f64,
    rim: f64,
    rim_cells: usize,
    deepest: f32,
    middle: f64,
}

impl Sums {
    const NONE: Self = Self {
        cells: 0,
        masked: false,
        inner: 0,
        black: 0,
        low: [usize::MAX; 2],
        high: [0; 2],
        light: 0.0,
        rim: 0.0,
        rim_cells: 0,
        deepest: 0.0,
        middle: 0.0,
    };
}

/// Finds the things in the bore. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(in crate::profile) struct Things {
    /// Label of each cell. 0 where there is nothing.
    pub labels: Vec<u16>,
    /// Sorted with the largest first.
    pub pieces: Vec<Piece>,
    stack: Vec<usize>,
    depth: Vec<f32>,
    sums: Vec<Sums>,
}

impl Things {
    pub fn find(&mut self, grid: &Grid) {
        let labels = &mut self.labels;
        labels.clear();
        labels.resize(grid.opacity.len(), 0);
        let mut count = 0u16;
        for at in 0..labels.len() {
            if grid.filled[at] && labels[at] == 0 && count < u16::MAX {
                count += 1;
                labels[at] = count;
                self.stack.push(at);
                spread(grid, labels, &mut self.stack, count);
            }
        }
        self.measure(grid, count.into());
        // Of two things of the same size the first one found stays first.
        self.pieces.sort_unstable_by(|a, b| b.area_bore2.total_cmp(&a.area_bore2).then(a.label.cmp(&b.label)));
    }

    fn measure(&mut self, grid: &Grid, count: usize) {
        let Self { labels, sums: all, depth, .. } = self;
        all.clear();
        all.resize(count, Sums::NONE);
        grid.depth(|at| labels[at] != 0, depth);
        let named = || labels.iter().enumerate().filter(|(_, label)| **label != 0).map(|(at, label)| (at, usize::from(*label) - 1));
        for (at, k) in named() {
            let sums = &mut all[k];
            sums.cells += 1;
            sums.masked |= grid.masked[at];
            // The outermost cell is half outside.
            if depth[at] > 1.0 {
                sums.inner += 1;
                sums.black += usize::from(grid.opacity[at] > BLACK);
            }
            sums.light += f64::from(1.0 - grid.opacity[at]);
            for (axis, place) in [at % grid.width, at / grid.width].into_iter().enumerate() {
                sums.low[axis] = sums.low[axis].min(place);
                sums.high[axis] = sums.high[axis].max(place);
            }
            if depth[at] > 1.0 && depth[at] < 3.0 {
                sums.rim += f64::from(grid.opacity[at]);
                sums.rim_cells += 1;
            }
            sums.deepest = sums.deepest.max(depth[at]);
        }
        for (at, k) in named() {
            if depth[at] >= 0.7 * all[k].deepest {
                all[k].middle = all[k].middle.max(f64::from(1.0 - grid.opacity[at]));
            }
        }
        let measured = all.iter().enumerate().map(|(k, s)| {
            let cells = s.cells.max(1) as f64;
            Piece {
                label: k as u16 + 1,
                in_mask: s.masked,
                from_bore: s.low[0] as f64 / grid.per_bore,
                area_bore2: s.cells as f64 / grid.per_bore.powi(2),
                size_bore: [0, 1].map(|axis| (s.high[axis] + 1).saturating_sub(s.low[axis]) as f64 / grid.per_bore),
                half_width_bore: f64::from(s.deepest) / grid.per_bore,
                black: s.black as f64 / s.inner.max(1) as f64,
                rim: s.rim / s.rim_cells.max(1) as f64,
                middle_light: s.middle - s.light / cells,
            }
        });
        self.pieces.clear();
        self.pieces.extend(measured.filter(|p| p.area_bore2 >= SPECK_BORE2));
    }
}

/// Labels everything that is connected to the cells on the stack.
fn spread(grid: &Grid, labels: &mut [u16], stack: &mut Vec<usize>, label: u16) {
    let w = grid.width;
    while let Some(at) = stack.pop() {
        let (left, right) = (at % w > 0, at % w + 1 < w);
        let near = [left.then(|| at - 1), right.then_some(at + 1), at.checked_sub(w), Some(at + w).filter(|&n| n < labels.len())];
        for next in near.into_iter().flatten() {
            if grid.filled[next] && labels[next] == 0 {
                labels[next] = label;
                stack.push(next);
            }
        }
    }
}
