//! The transparent fringe: fin folds and whatever else shows by little more than its border.
//!
//! ```text
//!        . . . . . . . .  <- a line of a few grey values, two px wide, hundreds long
//!      .    as bright as   .
//!     ___ the background ____
//!    (______ body ___________)      along each normal of the body's outline: where, going inwards, does it get darker?
//! ```
//! No pixel of a fin need stand out from the noise, nor from what the background's model is off by. Its border does, once it
//! is averaged along the outline and asked to run on: the path around the body that gathers the most border, each place
//! counting no more than a faint line would, so that no bubble or speck beside the larva pulls it out.

use super::background::Bore;
use super::outline::{Crossings, Outlines, fill, normals, smooth_cyclic};
use super::path::Path;
use super::plane::{Plane, gaussian, quantile};
use super::settings::FringeSettings;

/// The fringe is followed this many times, each from what was found before.
pub(super) const ROUNDS: usize = 2;
/// Steps along the outline, and smoothing of the body's outline, px: normals that do not cross near by.
pub(super) const STEP_PX: f64 = 2.0;
pub(super) const OUTLINE_SMOOTHING_PX: f64 = 5.0;
/// Samples before the first distance: inside the outline.
const INNER: usize = 3;
/// Samples beyond the last distance: the bright side of the border.
const OUTER: usize = 11;
/// Width of the stripe inside a border that is compared, and of the border's own blur, px.
const INSIDE_PX: usize = 5;
const GAP_PX: usize = 3;
/// The glass' shade, which the background's model does not follow to a grey value, reaches this far into the bore, px.
const WALL_SHADE_PX: f64 = 6.0;

/// Finds the fringe; keeps its memory from frame to frame.
#[derive(Default)]
pub(super) struct Fringe {
    kernel: Vec<f32>,
    inward: Vec<[f64; 2]>,
    /// Darkness along the normals, place by place, and its means along the outline.
    raw: Vec<f32>,
    mean: Vec<f32>,
    borders: Vec<f32>,
    sums: Vec<f32>,
    path: Path,
    runs: Vec<f32>,
    believed: Vec<bool>,
    vertices: Vec<[f64; 2]>,
    crossings: Crossings,
}

impl Fringe {
    /// Adds to `inside`, the pixels of the bore's window, what lies between the outlines and their fringes.
    pub fn add(&mut self, outlines: &Outlines, darkness: &Plane, bore: &Bore, settings: &FringeSettings, inside: &mut [bool]) {
        let reach = (settings.reach_bore * bore.mean_px).round() as usize;
        if reach < 4 {
            return;
        }
        let samples = INNER + reach + OUTER;
        gaussian(settings.along_px / STEP_PX, &mut self.kernel);
        for outline in outlines.each() {
            self.inward.clear();
            normals(outline, &mut self.inward);
            self.raw.clear();
            for (p, n) in outline.iter().zip(&self.inward) {
                self.raw.extend((0..samples).map(|k| {
                    let s = k as f64 - INNER as f64;
                    darkness.sample(p[0] - s * n[0], p[1] - s * n[1])
                }));
            }
            self.mean.clear();
            self.mean.resize(self.raw.len(), 0.0);
            smooth_cyclic(&self.raw, samples, &self.kernel, &mut self.mean);
            self.gather(outline, bore, samples, reach, settings);
            self.follow(outline.len(), reach, settings);
            self.vertices.clear();
            let places = outline.iter().zip(&self.inward).zip(&self.path.chosen);
            self.vertices.extend(places.map(|((p, n), &d)| [p[0] - d as f64 * n[0], p[1] - d as f64 * n[1]]));
            fill(std::iter::once(self.vertices.as_slice()), (bore.width, bore.bottom), &mut self.crossings, |u, v| {
                if v >= bore.top {
                    inside[(v - bore.top) * bore.width + u] = true;
                }
            });
        }
    }

    /// How much of a border there is at each distance: the darkness of some px inside less that of some px outside. Where the
    /// body's own edge is not yet passed there is none; near the wall and behind something opaque there can be none.
    fn gather(&mut self, outline: &[[f64; 2]], bore: &Bore, samples: usize, reach: usize, settings: &FringeSettings) {
        let last_u = (bore.width - 1) as f64;
        let opaque = settings.opaque_sigma as f32;
        self.borders.clear();
        for ((p, n), mean) in outline.iter().zip(&self.inward).zip(self.mean.chunks_exact(samples)) {
            let open = |k: &usize| {
                let s = *k as f64 - INNER as f64;
                let (u, v) = (p[0] - s * n[0], p[1] - s * n[1]);
                let (upper, lower) = (bore.walls.upper.inner.at(u) + WALL_SHADE_PX, bore.walls.lower.inner.at(u) - WALL_SHADE_PX);
                u >= 0.0 && u <= last_u && v >= upper && v <= lower
            };
            let passed = |k: &usize| mean[*k] < OUTSIDE_SIGMA || (mean[*k] < FAINT_SIGMA && mean[k + 1] > mean[*k]);
            let first = (INNER + 1..INNER + reach).find(passed).unwrap_or(samples);
            let last = (first..samples).take_while(|k| open(k) && mean[*k] <= opaque).last().unwrap_or(0);
            self.sums.clear();
            self.sums.push(0.0);
            let mut sum = 0.0;
            self.sums.extend(mean.iter().map(|m| {
                sum += m;
                sum
            }));
            let mean_of = |from: usize, upto: usize| (self.sums[upto] - self.sums[from]) / (upto - from) as f32;
            self.borders.extend((0..reach).map(|d| {
                let at = INNER + d;
                let (inner, outer) = (at.saturating_sub(INSIDE_PX).max(first), (at + OUTER + 1).min(last + 1));
                if at < first + 2 {
                    0.0
                } else if outer < at + GAP_PX + 3 {
                    f32::NEG_INFINITY
                } else {
                    // In units of what chance does with that few samples.
                    let (n, m) = ((at + 2 - inner) as f32, (outer - at - GAP_PX) as f32);
                    (mean_of(inner, at + 2) - mean_of(at + GAP_PX, outer)) / (1.0 / n + 1.0 / m).sqrt()
                }
            }));
        }
    }

    /// What passes for a border by chance: the standard deviation of all places, most of which show none.
    fn chance(&mut self) -> f32 {
        self.raw.clear();
        self.raw.extend(self.borders.iter().filter(|b| b.is_finite() && **b != 0.0).map(|b| b.abs()));
        quantile(&mut self.raw, 0.5) / 0.6745
    }

    /// Follows the border around and takes back what chance alone would give.
    fn follow(&mut self, steps: usize, reach: usize, settings: &FringeSettings) {
        let chance = self.chance().max(1e-3);
        let (bar, most) = (settings.bar as f32, settings.most as f32);
        self.path.costs.clear();
        self.path.costs.extend(self.borders.iter().enumerate().map(|(i, border)| match i % reach {
            0 => 0.0,
            _ if *border == f32::NEG_INFINITY => BLOCKED,
            _ if *border == 0.0 => 0.0,
            _ => bar - (border / chance).clamp(-most, most),
        }));
        self.path.cheapest(steps, reach, settings.kink as f32);
        // Along the found path chance gives more than its mean, as the path looks for it: what is believed must be clearly more.
        let found = |i: usize| (self.borders[i * reach + self.path.chosen[i]] / chance).clamp(-most, most);
        let window = (settings.run_px / STEP_PX / 2.0) as usize;
        self.runs.clear();
        self.runs.extend((0..steps).map(|i| {
            let near = (0..=2 * window).map(|k| (i + k + steps * (window / steps + 1) - window) % steps);
            let (sum, n) = near.filter(|&j| self.path.chosen[j] > 0).fold((0.0, 0), |(s, n), j| (s + found(j), n + 1));
            if self.path.chosen[i] > 0 && 2 * n > window { sum / n as f32 } else { 0.0 }
        }));
        // What is believed goes on, both ways around, as long as some border is left.
        let least = settings.least as f32;
        self.believed.clear();
        self.believed.extend(self.runs.iter().map(|run| *run >= least));
        for i in (0..2 * steps).chain((0..2 * steps).rev()) {
            let (here, neighbours) = (i % steps, [(i + 1) % steps, (i + steps - 1) % steps]);
            self.believed[here] |= self.runs[here] >= GOES_ON * least && neighbours.iter().any(|&j| self.believed[j]);
        }
        for (chosen, believed) in self.path.chosen.iter_mut().zip(&self.believed) {
            if !believed {
                *chosen = 0;
            }
        }
    }
}

/// Darkness below which the body's edge is passed, standard deviations of a pixel's noise.
const OUTSIDE_SIGMA: f32 = 0.8;
/// A believed fringe goes on while it shows this share of the border that is needed to be believed.
const GOES_ON: f32 = 0.75;
/// What is fainter than this may be fringe already.
const FAINT_SIGMA: f32 = 5.0;
/// Cost of a place that the fringe cannot reach.
const BLOCKED: f32 = 50.0;

#[cfg(test)]
mod tests {
    use super::super::outline::{Smoother, smoothed, trace};
    use super::super::synthetic::{Noise, blurred_step, bore, plane};
    use super::*;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 200;
    const BODY: f64 = 35.0;
    const RING: f64 = 52.0;

    fn place(u: f64, v: f64) -> (f64, f64) {
        (u - 160.0, v - 99.0)
    }

    /// Pixels added around a dark disc under noise of 1, with `beside` around it.
    fn added(beside: impl Fn(f64, f64) -> f64) -> Vec<bool> {
        let mut noise = Noise::new(17);
        let darkness = plane(WIDTH, HEIGHT, |u, v| {
            let (x, y) = place(u, v);
            let body = blurred_step(BODY - x.hypot(y), 1.0);
            40.0 * body + (1.0 - body) * beside(x, y) + noise.next()
        });
        let body: Vec<bool> = (0..WIDTH * HEIGHT)
            .map(|i| {
                let (x, y) = place((i % WIDTH) as f64, (i / WIDTH) as f64);
                x.hypot(y) < BODY
            })
            .collect();
        let (mut cracks, mut outlines) = (Outlines::default(), Outlines::default());
        trace(&body, WIDTH, 0, 12, &mut Vec::new(), &mut cracks);
        smoothed(&cracks, OUTLINE_SMOOTHING_PX, STEP_PX, &mut Smoother::default(), &mut outlines);
        let mut inside = body.clone();
        Fringe::default().add(&outlines, &darkness, &bore(WIDTH, HEIGHT), &FringeSettings::default(), &mut inside);
        inside.iter().zip(&body).map(|(now, before)| *now && !*before).collect()
    }

    fn count(added: &[bool], of: impl Fn(f64) -> bool) -> usize {
        (0..added.len())
            .filter(|&i| {
                let (x, y) = place((i % WIDTH) as f64, (i / WIDTH) as f64);
                added[i] && of(x.hypot(y))
            })
            .count()
    }

    /// 85 % of it: the border is placed some 2 px inside where it is, and nowhere outside.
    #[test]
    fn a_ring_as_faint_as_the_noise_is_found() {
        let added = added(|x, y| blurred_step(RING - x.hypot(y), 1.0));
        let ring = std::f64::consts::PI * (RING * RING - BODY * BODY);
        let (within, beyond) = (count(&added, |r| r < RING), count(&added, |r| r > RING + 2.0));
        assert!(within as f64 > 0.8 * ring && (beyond as f64) < 0.05 * ring, "{within} of {ring:.0}, {beyond} beyond");
    }

    #[test]
    fn nothing_is_added_where_nothing_is() {
        let added = added(|_, _| 0.0);
        // The smoothed outline lies up to a px beside the disc's pixels.
        assert!(count(&added, |r| r > BODY + 2.0) == 0, "{} px", count(&added, |r| r > BODY + 2.0));
    }

    #[test]
    fn an_opaque_blob_beside_is_not_taken() {
        let added = added(|x, y| 60.0 * blurred_step(12.0 - (x - 60.0).hypot(y), 1.0));
        let taken =
            (0..added.len()).filter(|i| added[*i] && (((i % WIDTH) as f64 - 220.0).hypot((i / WIDTH) as f64 - 99.0)) < 11.0).count();
        assert!(taken < 10, "{taken} px of the blob");
    }
}
