//! Mean shift in the joint domain of place and colour (Comaniciu and Meer 2002).
//!
//! ```text
//!   (u, v, lightness, colour)  ->  mean of all blocks within the spatial and the range bandwidth  ->  ...  ->  its mode
//! ```
//! Each block takes the contrast of the mode to which it climbs. Uniform parts are averaged over the whole window, so that a
//! fin fainter than the noise becomes visible. Parts that differ by more than the range bandwidth are not mixed, so that edges
//! remain, although they are soft where the specimen fades. The method keeps the whole larva.

use super::coarse::Coarse;
use super::settings::MeanShiftSettings;
use crate::parallel::prelude::*;

/// Blocks that the window reaches on each side of its middle: 9 of the bore's 60 rows. It is a constant so that the sums over a
/// row of the window are unrolled.
const REACH: usize = 4;
const SPAN: usize = 2 * REACH + 1;
const MOST_STEPS: usize = 6;
/// A contrast far from any other: used around the map and outside of the walls.
const NOWHERE: f32 = 1e9;

#[derive(Debug, Default)]
pub(super) struct MeanShift {
    padded: [Vec<f32>; 2],
    /// Modes of each block.
    pub lightness: Vec<f32>,
    pub colour: Vec<f32>,
}

impl MeanShift {
    pub fn run(&mut self, coarse: &Coarse, settings: &MeanShiftSettings) {
        let (w, h) = (coarse.width, coarse.height);
        let wide = w + 2 * REACH;
        for (padded, map) in self.padded.iter_mut().zip([&coarse.lightness, &coarse.colour]) {
            padded.clear();
            padded.resize(wide * (h + 2 * REACH), NOWHERE);
            for v in 0..h {
                for u in (0..w).filter(|u| coarse.within[v * w + u]) {
                    padded[(v + REACH) * wide + u + REACH] = map[v * w + u];
                }
            }
        }
        for (out, map) in [(&mut self.lightness, &coarse.lightness), (&mut self.colour, &coarse.colour)] {
            out.clear();
            out.extend_from_slice(map);
        }
        let [lightness, colour] = &self.padded;
        let window = Window { lightness, colour, wide, range2: (settings.range_sigma * settings.range_sigma) as f32 };
        let rows = self.lightness.par_chunks_mut(w).zip(self.colour.par_chunks_mut(w)).zip(coarse.within.par_chunks(w)).enumerate();
        rows.for_each(|(v, ((lightness, colour), within))| {
            for u in (0..w).filter(|u| within[*u]) {
                [lightness[u], colour[u]] = window.climb(u, v, h, [lightness[u], colour[u]]);
            }
        });
    }
}

/// The maps with a margin as wide as the window.
struct Window<'a> {
    lightness: &'a [f32],
    colour: &'a [f32],
    wide: usize,
    range2: f32,
}

impl Window<'_> {
    /// The mode to which the block at `(u, v)` climbs.
    fn climb(&self, u: usize, v: usize, height: usize, start: [f32; 2]) -> [f32; 2] {
        let width = self.wide - 2 * REACH;
        let (mut u, mut v) = (u, v);
        let [mut l, mut c] = start;
        for _ in 0..MOST_STEPS {
            let (mut n, mut du, mut dv, mut dl, mut dc) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for j in 0..SPAN {
                let from = (v + j) * self.wide + u;
                let (ls, cs) = (&self.lightness[from..from + SPAN], &self.colour[from..from + SPAN]);
                let (mut row_n, mut row_u, mut row_l, mut row_c) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
                for i in 0..SPAN {
                    let (x, y) = (ls[i] - l, cs[i] - c);
                    let near = f32::from(x * x + y * y <= self.range2);
                    row_n += near;
                    row_u += near * (i as f32 - REACH as f32);
                    // Outside of the maps the difference is huge but finite: times 0 it is still 0.
                    row_l += near * x;
                    row_c += near * y;
                }
                n += row_n;
                du += row_u;
                dv += row_n * (j as f32 - REACH as f32);
                dl += row_l;
                dc += row_c;
            }
            if n < 1.0 {
                break;
            }
            let (next_u, next_v) = ((u as f32 + du / n).round() as usize, (v as f32 + dv / n).round() as usize);
            let still = (next_u, next_v) == (u, v) && (dl * dl + dc * dc) < 0.01 * n * n;
            (u, v) = (next_u.min(width - 1), next_v.min(height - 1));
            l += dl / n;
            c += dc / n;
            if still {
                break;
            }
        }
        [l, c]
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::Noise;
    use super::*;

    const WIDTH: usize = 60;
    const HEIGHT: usize = 40;

    /// Mean and standard deviation of the modes left and right of a noisy step in the middle, `beside` blocks and more from it.
    fn sides(step: f32, beside: usize) -> [(f32, f32); 2] {
        let mut noise = Noise::new(11);
        let map = (0..WIDTH * HEIGHT).map(|i| noise.next() as f32 + if i % WIDTH < WIDTH / 2 { 0.0 } else { step }).collect();
        let mut shift = MeanShift::default();
        shift.run(&Coarse::of_lightness(WIDTH, map), &MeanShiftSettings::default());
        [0..WIDTH / 2 - beside, WIDTH / 2 + beside..WIDTH].map(|columns| {
            let modes: Vec<f32> = (0..WIDTH * HEIGHT).filter(|i| columns.contains(&(i % WIDTH))).map(|i| shift.lightness[i]).collect();
            let mean = modes.iter().sum::<f32>() / modes.len() as f32;
            (mean, (modes.iter().map(|m| (m - mean) * (m - mean)).sum::<f32>() / modes.len() as f32).sqrt())
        })
    }

    /// A full window averages 81 blocks: 0.11 is left of a noise of 1, more where the window is cut.
    #[test]
    fn a_step_keeps_its_two_levels_and_each_becomes_flat() {
        let [left, right] = sides(3.0, REACH + 1);
        assert!(left.0.abs() < 0.15 && (right.0 - 3.0).abs() < 0.15, "{left:?} {right:?}");
        assert!(left.1 < 0.4 && right.1 < 0.4, "{left:?} {right:?}");
    }

    #[test]
    fn a_step_as_small_as_the_noise_shows_in_every_block() {
        let [left, right] = sides(1.0, REACH + 1);
        assert!(right.0 - left.0 > 0.8, "{left:?} {right:?}");
        assert!(left.1 + right.1 < 0.5 * (right.0 - left.0), "{left:?} {right:?}");
    }

    #[test]
    fn what_is_beyond_the_walls_is_not_mixed_in() {
        let mut coarse = Coarse::of_lightness(WIDTH, (0..WIDTH * HEIGHT).map(|i| if i < 5 * WIDTH { 2.0 } else { 0.0 }).collect());
        coarse.within[..5 * WIDTH].fill(false);
        let mut shift = MeanShift::default();
        shift.run(&coarse, &MeanShiftSettings::default());
        assert!(shift.lightness[5 * WIDTH..].iter().all(|m| m.abs() < 1e-5));
    }
}
