//! The level of each row of the empty bore: its grey under even light.

use super::known_light::KnownLight;
use super::light::{ACROSS, Light};
use super::table::Table;
use crate::profile::bore::{Bore, MARGIN_PX};
use crate::profile::raster::plane::quantile;

/// Smallest noise that is accepted for 8-bit frames, grey values. Quantisation alone is 0.3.
const LEAST_NOISE: f32 = 0.5;
/// The same for a cell.
const LEAST_CELL_NOISE: f32 = 0.25;
/// The shade of a wall and its blur reach this far into the bore. There each row is estimated by itself.
const WALL_SHADE_PX: usize = 10;
/// How strongly a row is smoothed with its neighbours, as a share of its distance from that shade.
const LEANING: f32 = 0.35;

/// The levels of the rows. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Levels {
    /// Grey value over light for every cell, and smoothed along the capillary.
    even: Vec<f32>,
    smooth: Vec<f32>,
    /// The light in every cell.
    lit: Vec<f32>,
    across: [Vec<f32>; ACROSS],
    /// Level of each row.
    pub profile: Vec<f32>,
    /// Number of cells that agree with it.
    support: Vec<f32>,
    scratch: Vec<f32>,
}

impl Levels {
    /// Fits the light and stores the level of each row in `profile`.
    pub fn estimate(&mut self, table: &Table) -> Light {
        let mut light = Light::even();
        self.even_out(table, &light);
        let mut sigma = self.roughness(table);
        self.brightest(table);
        // Each round trusts the estimate more: from 2 % of the level down to the noise alone.
        for tolerance in [0.02, 0.01, 0.0] {
            self.slide_to_modes(table, sigma);
            light = light.fitted(table, &self.profile, |level| (tolerance * level).max(2.5 * sigma));
            self.even_out(table, &light);
            sigma = self.spread(table, sigma);
        }
        self.slide_to_modes(table, sigma);
        light
    }

    /// Divides the table by the light.
    fn even_out(&mut self, table: &Table, light: &Light) {
        light.over(table, &mut self.across, &mut self.lit);
        self.even.clear();
        self.even.extend(table.values.iter().zip(&self.lit).map(|(grey, light)| grey / light));
    }

    /// Noise of a cell from the differences of neighbours. The lower quartile is used, because a specimen's texture fills the
    /// upper half.
    fn roughness(&mut self, table: &Table) -> f32 {
        let cols = table.cols;
        self.scratch.clear();
        let rows = self.even.chunks_exact(cols).step_by(2);
        self.scratch.extend(rows.flat_map(|row| row.windows(2).step_by(2).map(|pair| (pair[1] - pair[0]).abs())));
        // A quarter of normally distributed numbers lies within 0.3186 standard deviations; a difference has the noise of two
        // cells.
        (quantile(&mut self.scratch, 0.25) / (0.3186 * std::f32::consts::SQRT_2)).max(LEAST_CELL_NOISE)
    }

    /// First level of each row: that of its brightest cells. Neighbours are averaged, because a bright speck is narrow.
    fn brightest(&mut self, table: &Table) {
        let cols = table.cols;
        let reach = (cols / 64).max(1);
        let share = 1.0 / (2 * reach + 1) as f32;
        self.profile.clear();
        for row in self.even.chunks_exact(cols) {
            self.smooth.clear();
            let mut sum: f32 = row[..reach.min(cols)].iter().sum();
            for k in 0..cols {
                if k + reach < cols {
                    sum += row[k + reach];
                }
                if k > reach {
                    sum -= row[k - reach - 1];
                }
                let n = (k + reach + 1).min(cols) - k.saturating_sub(reach);
                self.smooth.push(sum * if n == 2 * reach + 1 { share } else { 1.0 / n as f32 });
            }
            // A specimen that nearly fills the picture leaves some 4 % of a row free. The edge of that part must not count as
            // brighter than empty.
            self.profile.push(quantile(&mut self.smooth, 0.98).max(1.0));
        }
    }

    /// Moves each row's level to the nearest mode: a body that is nearly as bright as the light and fills its row must not
    /// become the background.
    fn slide_to_modes(&mut self, table: &Table, sigma: f32) {
        self.support.clear();
        for (row, level) in self.even.chunks_exact(table.cols).zip(&mut self.profile) {
            let first = *level;
            let mut support = 0.0;
            for _ in 0..3 {
                let (sum, n) = agreeing(row, *level, first, 2.5 * sigma);
                support = n;
                let mean = if n > 0.0 { (first + sum / n).clamp(first - sigma, first + sigma) } else { *level };
                if (mean - *level).abs() < 1e-3 * sigma {
                    break;
                }
                *level = mean;
            }
            *level = level.max(1.0);
            self.support.push(support);
        }
        self.lean_on_neighbours(table.rows);
    }

    /// Far from the walls the glass changes slowly from row to row. There a row that a specimen fills is estimated from its
    /// neighbours by a weighted straight line. The nearer to a wall, the fewer neighbours are used.
    fn lean_on_neighbours(&mut self, rows: usize) {
        self.scratch.clear();
        self.scratch.extend_from_slice(&self.profile);
        for t in 0..rows {
            let from_wall = t.min(rows - 1 - t).saturating_sub(MARGIN_PX + WALL_SHADE_PX);
            let reach = (from_wall as f32 * LEANING) as usize;
            if reach < 2 {
                continue;
            }
            let (mut w0, mut w1, mut w2, mut y0, mut y1) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for other in t - reach..=t + reach {
                let x = (other as f32 - t as f32) / (reach as f32 + 1.0);
                let weight = self.support[other] * self.support[other] * (1.0 - x * x);
                let y = self.scratch[other] - self.scratch[t];
                w0 += weight;
                w1 += weight * x;
                w2 += weight * x * x;
                y0 += weight * y;
                y1 += weight * x * y;
            }
            let det = w0 * w2 - w1 * w1;
            if det > 1e-3 * w0 * w0 {
                self.profile[t] = (self.scratch[t] + (y0 * w2 - y1 * w1) / det).max(1.0);
            }
        }
    }

    /// Noise of a cell from the distances of those cells that agree with the estimate. It is known to be `sigma` or less.
    fn spread(&mut self, table: &Table, sigma: f32) -> f32 {
        let cols = table.cols;
        let inner = MARGIN_PX + 2..table.rows.saturating_sub(MARGIN_PX + 2);
        self.scratch.clear();
        // Half of the rows determine it to 1 %.
        for t in inner.step_by(2) {
            let level = self.profile[t];
            self.scratch.extend(self.even[t * cols..(t + 1) * cols].iter().map(|e| (e - level).abs()).filter(|off| *off <= 3.0 * sigma));
        }
        (quantile(&mut self.scratch, 0.5) / 0.6745).clamp(LEAST_CELL_NOISE, sigma.max(LEAST_CELL_NOISE))
    }

    /// Noise of a pixel, grey values, from one pixel of each cell that shows the empty bore where the level is even.
    pub fn noise(&mut self, table: &Table, bore: &Bore, plane: &[u8], known: &KnownLight) -> f32 {
        let (rows, cols) = (table.rows, table.cols);
        self.scratch.clear();
        let sigma = self.spread(table, f32::MAX.sqrt()).min(self.roughness(table).max(LEAST_CELL_NOISE) * 2.0);
        self.scratch.clear();
        for t in (MARGIN_PX + rows / 8..rows.saturating_sub(MARGIN_PX + rows / 8)).step_by(2) {
            for k in 0..cols {
                let at = t * cols + k;
                if (self.even[at] - self.profile[t]).abs() > 2.5 * sigma {
                    continue;
                }
                let u = (k * table.stride + table.stride / 2).min(bore.width - 1);
                let v = bore.v_of(t as f64, u as f64).round();
                if v < bore.top as f64 || v >= bore.bottom as f64 {
                    continue;
                }
                let level = self.profile[t] * self.lit[at] * known.at(t as f64, u) / table.typical;
                self.scratch.push((f32::from(plane[v as usize * bore.width + u]) - level).abs());
            }
        }
        (quantile(&mut self.scratch, 0.5) / 0.6745).max(LEAST_NOISE)
    }
}

/// The cells of a row within `reach` of the level: the sum of their differences from `first`, and their number.
fn agreeing(row: &[f32], level: f32, first: f32, reach: f32) -> (f32, f32) {
    // Interleaved sums are added at once.
    const LANES: usize = 8;
    let (mut sums, mut counts) = ([0.0f32; LANES], [0.0f32; LANES]);
    let (chunks, rest) = row.as_chunks::<LANES>();
    let mut add = |k: usize, cell: f32| {
        let near = if (cell - level).abs() <= reach { 1.0 } else { 0.0 };
        sums[k] += near * (cell - first);
        counts[k] += near;
    };
    for chunk in chunks {
        (0..LANES).for_each(|k| add(k, chunk[k]));
    }
    rest.iter().enumerate().for_each(|(k, cell)| add(k, *cell));
    (sums.iter().sum(), counts.iter().sum())
}
