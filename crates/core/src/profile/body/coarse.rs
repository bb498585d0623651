//! The bore at the resolution at which the specimen is found: some 60 rows across, for any scale of the camera.
//!
//! Blocks of pixels are averaged, which halves the noise and quarters the work. The edge is later located in the pixels
//! themselves, to a fraction of a pixel. High contrast counts by its logarithm: an eye is not a hundred times more specimen
//! than a fin, and photon noise and texture grow with contrast.

use crate::profile::bore::{Bore, background::Contrast};
use crate::profile::raster::plane::quantile;

/// Number of rows across the bore to aim at.
const ROWS: f64 = 60.0;
/// Contrast from which on the logarithm is used, standard deviations.
const BEND: f32 = 6.0;
/// Smallest noise that is assumed, grey values: the possible error of the background's model.
const MODEL_GREY: f64 = 0.6;

/// Contrast maps at working resolution, in standard deviations of their own noise.
#[derive(Debug, Default)]
pub(in crate::profile) struct Coarse {
    pub width: usize,
    pub height: usize,
    /// Pixels per side of a block.
    pub step: usize,
    pub lightness: Vec<f32>,
    /// All 0 for grey pictures.
    pub colour: Vec<f32>,
    /// Lightness and colour, slightly smoothed.
    pub smooth: [Vec<f32>; 2],
    /// Share of the light that is missing.
    pub opacity: Vec<f32>,
    /// Blocks whose middle lies between the walls.
    pub within: Vec<bool>,
    scratch: Vec<f32>,
}

/// Contrast as it is compared.
pub(in crate::profile) fn bent(sigmas: f32) -> f32 {
    sigmas.signum() * BEND * (1.0 + sigmas.abs() / BEND).ln()
}

impl Coarse {
    pub fn fill(&mut self, bore: &Bore, contrast: &Contrast, wall_margin_px: f64) {
        self.step = ((bore.mean_px / ROWS).round() as usize).max(1);
        (self.width, self.height) = (bore.width.div_ceil(self.step), bore.height().div_ceil(self.step));
        let grey = contrast.colour.is_empty();
        average(&contrast.lightness.data, bore, self.step, &mut self.scratch, &mut self.lightness);
        average(&contrast.darkness.data, bore, self.step, &mut self.scratch, &mut self.opacity);
        self.opacity.iter_mut().for_each(|o| *o /= contrast.all_light);
        if grey {
            self.colour.clear();
            self.colour.resize(self.lightness.len(), 0.0);
        } else {
            average(&contrast.colour, bore, self.step, &mut self.scratch, &mut self.colour);
        }
        self.mark_within(bore, wall_margin_px);
        // The error of the model in the unit of the maps, which is a pixel's noise.
        let model = (MODEL_GREY / contrast.noise_grey.max(1e-3)) as f32;
        normalise(&mut self.lightness, self.width, model, &mut self.scratch);
        if !grey {
            normalise(&mut self.colour, self.width, model, &mut self.scratch);
        }
        for (smooth, map) in self.smooth.iter_mut().zip([&self.lightness, &self.colour]) {
            binomial(map, self.width, self.height, &mut self.scratch, smooth);
        }
    }

    /// Maps for tests: the given lightness, no colour, no walls.
    #[cfg(test)]
    pub fn of_lightness(width: usize, lightness: Vec<f32>) -> Self {
        let mut coarse = Self { width, height: lightness.len() / width, step: 1, ..Self::default() };
        coarse.colour = vec![0.0; lightness.len()];
        coarse.within = vec![true; lightness.len()];
        coarse.lightness = lightness;
        for (smooth, map) in coarse.smooth.iter_mut().zip([&coarse.lightness, &coarse.colour]) {
            binomial(map, width, coarse.height, &mut coarse.scratch, smooth);
        }
        coarse
    }

    fn mark_within(&mut self, bore: &Bore, margin_px: f64) {
        self.within.clear();
        self.within.resize(self.width * self.height, false);
        let middle = (self.step - 1) as f64 / 2.0;
        for k in 0..self.width {
            let u = ((k * self.step) as f64 + middle).min((bore.width - 1) as f64);
            let (from, to) = (bore.walls.upper.inner.at(u) + margin_px, bore.walls.lower.inner.at(u) - margin_px);
            for t in 0..self.height {
                let v = (bore.top + t * self.step) as f64 + middle;
                self.within[t * self.width + k] = v >= from && v <= to;
            }
        }
    }
}

/// Means of blocks. Those at the far ends are means of the pixels that exist. `across` is memory.
fn average(data: &[f32], bore: &Bore, step: usize, across: &mut Vec<f32>, out: &mut Vec<f32>) {
    out.clear();
    for rows in data[..bore.width * bore.height()].chunks(bore.width * step) {
        let height = rows.len() / bore.width;
        across.clear();
        across.extend_from_slice(&rows[..bore.width]);
        for row in rows[bore.width..].chunks_exact(bore.width) {
            across.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
        }
        let whole = across.chunks_exact(step);
        let rest = whole.remainder();
        let share = 1.0 / (step * height) as f32;
        out.extend(whole.map(|block| block.iter().sum::<f32>() * share));
        if !rest.is_empty() {
            out.push(rest.iter().sum::<f32>() / (rest.len() * height) as f32);
        }
    }
}

/// Divides a map by its noise and applies the logarithm. The noise is that of the calmest quarter of all differences of blocks
/// two apart, which share no pixel of the mosaic.
fn normalise(map: &mut [f32], width: usize, least: f32, scratch: &mut Vec<f32>) {
    scratch.clear();
    scratch.extend(map.chunks_exact(width).flat_map(|row| row.windows(3).map(|w| (w[2] - w[0]).abs())));
    let sigma = quantile(scratch, 0.25) / (0.3186 * std::f32::consts::SQRT_2);
    let unit = 1.0 / sigma.hypot(least).max(1e-6);
    for m in map {
        *m = bent(*m * unit);
    }
}

/// Smooths with (1 2 1) / 4 along and across.
fn binomial(map: &[f32], w: usize, h: usize, across: &mut Vec<f32>, out: &mut Vec<f32>) {
    across.clear();
    for row in map.chunks_exact(w) {
        across.extend((0..w).map(|u| (row[u.saturating_sub(1)] + 2.0 * row[u] + row[(u + 1).min(w - 1)]) / 4.0));
    }
    out.clear();
    for v in 0..h {
        let (above, below) = (v.saturating_sub(1) * w, (v + 1).min(h - 1) * w);
        out.extend((0..w).map(|u| (across[above + u] + 2.0 * across[v * w + u] + across[below + u]) / 4.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::synthetic::{Noise, bore};

    #[test]
    fn blocks_are_means_also_where_they_are_cut() {
        let data: Vec<f32> = (0..5 * 3).map(|i| i as f32).collect();
        let mut out = Vec::new();
        average(&data, &bore(5, 3), 2, &mut Vec::new(), &mut out);
        assert_eq!(out, [3.0, 5.0, 6.5, 10.5, 12.5, 14.0]);
    }

    /// A body in a fifth of the map does not count as noise.
    #[test]
    fn noise_is_1_after_normalising() {
        let (width, height) = (120, 60);
        let mut noise = Noise::new(3);
        let mut map: Vec<f32> =
            (0..width * height).map(|i| 0.4 * noise.next() as f32 + if i % width < width / 5 { 20.0 } else { 0.0 }).collect();
        normalise(&mut map, width, 0.0, &mut Vec::new());
        let straight = |b: f32| b.signum() * BEND * ((b.abs() / BEND).exp() - 1.0);
        let empty: Vec<f32> = (0..map.len()).filter(|i| i % width > width / 5).map(|i| straight(map[i])).collect();
        let sigma = (empty.iter().map(|m| m * m).sum::<f32>() / empty.len() as f32).sqrt();
        // 5700 numbers tell it to 1 %; the quartile of their differences to 2 %, and the body's edge adds as much.
        assert!((sigma - 1.0).abs() < 0.06, "{sigma}");
    }

    #[test]
    fn a_model_error_counts_as_noise() {
        let mut map = vec![0.0, 8.0, 0.0, 0.0, 0.0, 0.0];
        normalise(&mut map, 6, 2.0, &mut Vec::new());
        assert!((map[1] - bent(4.0)).abs() < 1e-5, "{}", map[1]);
    }
}
