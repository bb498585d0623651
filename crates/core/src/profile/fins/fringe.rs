//! The transparent fringe: fin folds and other parts of which little more than the border is visible.
//!
//! ```text
//!        . . . . . . . .  <- a line of a few grey values, two px wide, hundreds long
//!      .    as bright as   .
//!     ___ the background ____
//!    (______ body ___________)      along each normal of the body's outline: where, going inwards, does it get darker?
//! ```
//! Single pixels of a fin need not differ from the noise, nor from the background model's error. The border of the fin does,
//! once it is averaged along the outline and required to be continuous. The fringe is the path around the body that collects
//! the most border. Each place counts no more than a faint line would, so that no bubble or speck beside the larva attracts the
//! path. What is thin and much darker than any fin's border, a scratch or a grain, is removed beforehand.

use crate::profile::bore::{Bore, background::Contrast};
use crate::profile::raster::outline::{Crossings, Outlines, fill, normals, smooth_cyclic};
use crate::profile::raster::path::Path;
use crate::profile::raster::plane::{gaussian, quantile};
use crate::profile::settings::FringeSettings;

/// Number of times that the fringe is followed, each time from the previous result.
pub(in crate::profile) const ROUNDS: usize = 2;
/// Step along the outline, and smoothing length of the body's outline, px. Normals then do not cross nearby.
pub(in crate::profile) const STEP_PX: f64 = 2.0;
pub(in crate::profile) const OUTLINE_SMOOTHING_PX: f64 = 5.0;
/// Samples before the first distance: inside the outline.
const INNER: usize = 3;
/// Samples beyond the last distance: the bright side of the border.
pub(in crate::profile) const OUTER: usize = 11;
/// Samples inside of a border that are compared, and the fewest outside.
pub(in crate::profile) const INSIDE: usize = 5;
const LEAST_OUTSIDE: usize = 5;
/// Profile of a border from inside to outside: the fin, its line, the blur of the line; then the water. In bright field the
/// line takes twice as much light as the fin.
const FIN: f32 = 0.55;
const LINE: [f32; 3] = [1.1, 1.1, 0.25];
/// How nearly linear the background's error is over that profile: the squared px by which its slope is held near 0.
const SLOPE_PX2: f32 = 500.0;
/// Distance from a wall within which the wall's own line is visible, px.
pub(in crate::profile) const WALL_LINE_PX: f64 = 4.0;
/// Smallest share of the light that a mark takes, and smallest number of standard deviations of a pixel's noise. A fin's border
/// takes 2 %, also within the noise.
const MARK_SHARE: f32 = 0.04;
const MARK_SIGMA: f32 = 5.0;
/// Greatest width of a mark with its blur on either side, samples. What is wider is opaque.
const MARK_WIDTH: usize = 9;
const MARK_BLUR: usize = 2;

/// Finds the fringe. The memory is reused from frame to frame.
#[derive(Default)]
pub(in crate::profile) struct Fringe {
    kernel: Vec<f32>,
    inward: Vec<[f64; 2]>,
    /// Darkness along the normals, place by place, and its means along the outline.
    raw: Vec<f32>,
    mean: Vec<f32>,
    borders: Vec<f32>,
    filters: Filters,
    path: Path,
    runs: Vec<f32>,
    believed: Vec<bool>,
    vertices: Vec<[f64; 2]>,
    crossings: Crossings,
}

/// Roundness up to which an outline may have fins: its area over that of a disc with its length. Larvae are below 0.4.
const ROUND: f64 = 0.85;

/// Whether an outline is that of a bead. A disc has no fins, and its blurred rim looks like a fin's border.
pub(in crate::profile) fn is_disc(outline: &[[f64; 2]]) -> bool {
    let sides = || outline.iter().zip(outline.iter().cycle().skip(1));
    let twice_area: f64 = sides().map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
    let length: f64 = sides().map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1])).sum();
    std::f64::consts::TAU * twice_area.abs() > ROUND * length * length
}

impl Fringe {
    /// Adds the area between the outlines and their fringes to `inside`, the pixels of the bore's window.
    pub fn add(&mut self, outlines: &Outlines, contrast: &Contrast, bore: &Bore, settings: &FringeSettings, inside: &mut [bool]) {
        let reach = (settings.reach_bore * bore.mean_px).round() as usize;
        if reach < 4 {
            return;
        }
        let samples = INNER + reach + OUTER;
        gaussian(settings.along_px / STEP_PX, &mut self.kernel);
        let mark = mark(contrast.all_light);
        for outline in outlines.each() {
            self.inward.clear();
            normals(outline, &mut self.inward);
            self.raw.clear();
            for (p, n) in outline.iter().zip(&self.inward) {
                self.raw.extend((0..samples).map(|k| {
                    let s = k as f64 - INNER as f64;
                    // This map has even noise, also where there is little light.
                    contrast.lightness.sample(p[0] - s * n[0], p[1] - s * n[1])
                }));
            }
            self.raw.chunks_exact_mut(samples).for_each(|normal| clear_marks(normal, mark));
            self.mean.clear();
            self.mean.resize(self.raw.len(), 0.0);
            smooth_cyclic(&self.raw, samples, &self.kernel, &mut self.mean);
            self.gather(outline, bore, samples, reach, settings);
            self.follow(outline.len(), reach, settings);
            self.fill_believed(outline, bore, inside);
        }
    }

    /// Adds what lies between the outline and the fringe to `inside`, stretch by stretch. Elsewhere the outline is not touched: it is
    /// smoother than the body.
    fn fill_believed(&mut self, outline: &[[f64; 2]], bore: &Bore, inside: &mut [bool]) {
        let steps = outline.len();
        let (chosen, inward) = (&self.path.chosen, &self.inward);
        let place = |i: usize, out_px: f64| {
            let (p, n) = (outline[i % steps], inward[i % steps]);
            [p[0] - out_px * n[0], p[1] - out_px * n[1]]
        };
        // Begins where nothing is believed, so that no stretch is cut in two; or anywhere, all the way round.
        let from = chosen.iter().position(|d| *d == 0).unwrap_or(0);
        let mut at = from;
        while at < from + steps {
            let first = at;
            at += (first..from + steps).take_while(|i| chosen[i % steps] > 0).count();
            if at == first {
                at += 1;
                continue;
            }
            // With a step more at either end, where the fringe meets the outline.
            let stretch = first + steps - 1..=at + steps;
            self.vertices.clear();
            self.vertices.extend(stretch.clone().map(|i| place(i, chosen[i % steps] as f64)));
            self.vertices.extend(stretch.rev().map(|i| place(i, -(INNER as f64))));
            fill(std::iter::once(self.vertices.as_slice()), (bore.width, bore.bottom), &mut self.crossings, |u, v| {
                if v >= bore.top {
                    inside[(v - bore.top) * bore.width + u] = true;
                }
            });
        }
    }

    /// Computes how much of a border there is at each distance. There is none before the edge of the body is passed; near the
    /// wall and behind something opaque there can be none.
    fn gather(&mut self, outline: &[[f64; 2]], bore: &Bore, samples: usize, reach: usize, settings: &FringeSettings) {
        let last_u = (bore.width - 1) as f64;
        let opaque = settings.opaque_sigma as f32;
        self.borders.clear();
        for ((p, n), mean) in outline.iter().zip(&self.inward).zip(self.mean.chunks_exact(samples)) {
            let open = |k: &usize| {
                let s = *k as f64 - INNER as f64;
                let (u, v) = (p[0] - s * n[0], p[1] - s * n[1]);
                let (upper, lower) = (bore.walls.upper.inner.at(u) + WALL_LINE_PX, bore.walls.lower.inner.at(u) - WALL_LINE_PX);
                u >= 0.0 && u <= last_u && v >= upper && v <= lower
            };
            let passed = |k: &usize| mean[*k] < OUTSIDE_SIGMA || (mean[*k] < FAINT_SIGMA && mean[k + 1] > LEVEL * mean[*k]);
            let first = (INNER + 1..INNER + reach).find(passed).unwrap_or(samples);
            let last = (first..samples).take_while(|k| open(k) && mean[*k] <= opaque).last().unwrap_or(0);
            self.borders.extend((0..reach).map(|d| {
                let at = INNER + d;
                let (inner, outer) = (at.saturating_sub(INSIDE).max(first), (at + OUTER + 1).min(last + 1));
                if at < first + 2 {
                    0.0
                } else if outer < at + LEAST_OUTSIDE {
                    f32::NEG_INFINITY
                } else {
                    self.filters.of(at - inner, outer - at).iter().zip(&mean[inner..outer]).map(|(w, m)| w * m).sum()
                }
            }));
        }
    }

    /// The response that arises by chance: the standard deviation over all places, most of which show no border.
    fn chance(&mut self) -> f32 {
        self.raw.clear();
        self.raw.extend(self.borders.iter().filter(|b| b.is_finite() && **b != 0.0).map(|b| b.abs()));
        quantile(&mut self.raw, 0.5) / 0.6745
    }

    /// Follows the border around and subtracts what chance alone would give.
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
        // Along the path chance gives more than its mean, because the path seeks high values. An accepted border must therefore
        // be clearly stronger.
        let found = |i: usize| (self.borders[i * reach + self.path.chosen[i]] / chance).clamp(-most, most);
        let window = (settings.run_px / STEP_PX / 2.0) as usize;
        self.runs.clear();
        self.runs.extend((0..steps).map(|i| {
            let near = (0..=2 * window).map(|k| (i + k + steps * (window / steps + 1) - window) % steps);
            let (sum, n) = near.filter(|&j| self.path.chosen[j] > 0).fold((0.0, 0), |(s, n), j| (s + found(j), n + 1));
            if self.path.chosen[i] > 0 && n > window { sum / n as f32 } else { 0.0 }
        }));
        // An accepted border is continued in both directions as long as some border is left.
        let least = settings.least as f32;
        self.believed.clear();
        self.believed.extend(self.runs.iter().map(|run| *run >= least));
        for i in (0..2 * steps).chain((0..2 * steps).rev()) {
            let (here, neighbours) = (i % steps, [(i + 1) % steps, (i + steps - 1) % steps]);
            self.believed[here] |= self.runs[here] >= GOES_ON * least && neighbours.iter().any(|&j| self.believed[j]);
        }
        for (i, (chosen, believed)) in self.path.chosen.iter_mut().zip(&self.believed).enumerate() {
            // In the blur of the body's edge there is no border.
            if !believed || *chosen <= INNER && self.borders[i * reach + *chosen] == 0.0 {
                *chosen = 0;
            }
        }
    }
}

/// Matched filters of a border by the number of samples that they cover.
pub(in crate::profile) struct Filters(Vec<Vec<f32>>);

impl Filters {
    /// For `inside` samples before the border and `outside` from it on.
    pub fn of(&self, inside: usize, outside: usize) -> &[f32] {
        &self.0[inside * (OUTER + 2) + outside]
    }

    /// The profile of the border without its level and slope, which an uneven background has as well. White noise of 1 gives 1.
    fn made(inside: usize, outside: usize) -> Vec<f32> {
        let course = |k: usize| if k < inside { FIN } else { LINE.get(k - inside).copied().unwrap_or(0.0) };
        let n = (inside + outside) as f32;
        let middle = (n - 1.0) / 2.0;
        let level = (0..inside + outside).map(course).sum::<f32>() / n;
        let places = || (0..inside + outside).map(|k| (course(k) - level, k as f32 - middle));
        let slope = places().map(|(c, x)| c * x).sum::<f32>() / (places().map(|(_, x)| x * x).sum::<f32>() + SLOPE_PX2);
        let energy = places().map(|(c, x)| (c - slope * x).powi(2)).sum::<f32>();
        places().map(|(c, x)| (c - slope * x) / energy.sqrt().max(1e-3)).collect()
    }
}

impl Default for Filters {
    fn default() -> Self {
        Self((0..(INSIDE + 1) * (OUTER + 2)).map(|i| Self::made(i / (OUTER + 2), i % (OUTER + 2))).collect())
    }
}

/// Contrast from which on something thin is a mark and no fin's border.
pub(in crate::profile) fn mark(all_light: f32) -> f32 {
    (MARK_SHARE * all_light).max(MARK_SIGMA)
}

/// Removes from a normal, outside of the body, what is thin and darker than `mark`.
fn clear_marks(normal: &mut [f32], mark: f32) {
    let Some(outside) = normal.iter().position(|d| *d < mark / 2.0) else { return };
    let mut at = outside;
    while at < normal.len() {
        let width = normal[at..].iter().take_while(|d| **d > mark).count();
        let beyond = at + width;
        // What continues beyond the last sample may have any width.
        if (1..=MARK_WIDTH).contains(&width) && beyond < normal.len() {
            let (from, upto) = (at.saturating_sub(MARK_BLUR).max(outside), (beyond + MARK_BLUR).min(normal.len()));
            normal[from..upto].fill(0.0);
        }
        at = beyond + 1;
    }
}

/// Darkness below which the edge of the body is passed, standard deviations of a pixel's noise.
const OUTSIDE_SIGMA: f32 = 0.8;
/// An accepted fringe is continued while it shows this share of the border that is needed for acceptance.
const GOES_ON: f32 = 0.75;
/// Fainter parts may already be fringe, standard deviations.
const FAINT_SIGMA: f32 = 5.0;
/// The blur of the body's edge falls to less than this share from one px to the next: to 0.53 at the edge itself for a blur of 1.6 px, and
/// to less further out. What falls less is level, as the inside of a fin.
const LEVEL: f32 = 0.7;
/// Cost of a place that the fringe cannot reach.
const BLOCKED: f32 = 50.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::raster::outline::{Smoother, smoothed, trace};
    use crate::profile::synthetic::{Noise, blurred_step, bore, plane};

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
        let contrast = Contrast { lightness: darkness, all_light: 100.0, ..Contrast::default() };
        Fringe::default().add(&outlines, &contrast, &bore(WIDTH, HEIGHT), &FringeSettings::default(), &mut inside);
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
    fn beads_are_discs_and_larvae_are_none() {
        let ellipse = |a: f64, b: f64| -> Vec<[f64; 2]> {
            (0..200).map(|i| f64::from(i) * std::f64::consts::TAU / 200.0).map(|t| [a * t.cos(), b * t.sin()]).collect()
        };
        assert!(is_disc(&ellipse(45.0, 45.0)) && is_disc(&ellipse(50.0, 42.0)), "a bead, and one through refracting glass");
        assert!(!is_disc(&ellipse(60.0, 30.0)) && !is_disc(&ellipse(300.0, 40.0)));
    }

    #[test]
    fn a_ring_as_faint_as_the_noise_is_found() {
        let added = added(|x, y| blurred_step(RING - x.hypot(y), 1.0));
        let ring = std::f64::consts::PI * (RING * RING - BODY * BODY);
        let (within, beyond) = (count(&added, |r| r < RING), count(&added, |r| r > RING + 2.0));
        assert!(within as f64 > 0.8 * ring && (beyond as f64) < 0.05 * ring, "{within} of {ring:.0}, {beyond} beyond");
    }

    /// Twice as dark as the noise up to its border, which has no line: the step alone shows it. A line's filter places a step up to 4 px
    /// inside of where it is.
    #[test]
    fn a_level_ring_beside_the_body_is_found() {
        for width in [5.0, 8.0, 14.0] {
            let edge = BODY + width;
            let added = added(|x, y| 2.0 * blurred_step(edge - x.hypot(y), 1.0));
            let ring = std::f64::consts::PI * (edge * edge - BODY * BODY);
            let (within, beyond) = (count(&added, |r| r < edge), count(&added, |r| r > edge + 2.0));
            assert!(within as f64 > 0.6 * ring && (beyond as f64) < 0.05 * ring, "{width}: {within} of {ring:.0}, {beyond} beyond");
        }
    }

    #[test]
    fn nothing_is_added_where_nothing_is() {
        let added = added(|_, _| 0.0);
        assert!(count(&added, |_| true) == 0, "{} px", count(&added, |_| true));
    }

    /// A line from the body outwards and one along it, each a hundred times as dark as the noise.
    #[test]
    fn scratches_are_not_followed_and_hide_no_ring() {
        let line = |x: f64, y: f64| 100.0 * (blurred_step(1.5 - (x - 0.4 * y).abs(), 1.0) + blurred_step(1.5 - (y - 62.0).abs(), 1.0));
        let alone = added(line);
        assert!(count(&alone, |r| r > BODY + 2.0) < 60, "{} px", count(&alone, |r| r > BODY + 2.0));
        let with = added(|x, y| blurred_step(RING - x.hypot(y), 1.0) + line(x, y));
        let ring = std::f64::consts::PI * (RING * RING - BODY * BODY);
        let (within, beyond) = (count(&with, |r| r < RING), count(&with, |r| r > RING + 2.0));
        assert!(within as f64 > 0.75 * ring && (beyond as f64) < 0.05 * ring, "{within} of {ring:.0}, {beyond} beyond");
    }

    #[test]
    fn an_opaque_blob_beside_is_not_taken() {
        let added = added(|x, y| 60.0 * blurred_step(12.0 - (x - 60.0).hypot(y), 1.0));
        let taken =
            (0..added.len()).filter(|i| added[*i] && (((i % WIDTH) as f64 - 220.0).hypot((i / WIDTH) as f64 - 99.0)) < 11.0).count();
        assert!(taken < 10, "{taken} px of the blob");
    }
}
