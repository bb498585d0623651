//! A level set with region and edge terms (Zhang, Matuszewski, Shark and Moore 2008).
//!
//! ```text
//!   phi_t = |grad phi| ( a (I - mu)  +  b div( g grad phi / |grad phi| ) )          phi > 0 inside
//!                         region            edge: shortest way along weak g
//! ```
//! `I` is the lightness contrast, `mu` a level between background and body, and `g` falls where `I` is steep. The method is
//! compact and sharp, and leaks where the larva is transparent. `phi` is kept near a distance function by a diffusion that
//! pulls its slope towards 1 (Li et al. 2010), so that it is never rebuilt. Only a band around the front is moved.

use super::coarse::Coarse;
use crate::profile::raster::plane::quantile;
use crate::profile::settings::LevelSetSettings;

/// Half the width of the band that is moved, blocks.
const BAND: f32 = 3.0;
const TIME_STEP: f32 = 0.3;
/// Weight of the pull towards slope 1. It is stable where its product with `TIME_STEP` is below 1/4.
const DISTANCE_PULL: f32 = 0.3;

/// The front rests when no block changes sides in so many steps.
const REST_STEPS: usize = 5;
/// Blocks of a row that are moved together where the front passes through one of them.
const CHUNK: usize = 8;

/// All maps have one more column on either side, which repeats its neighbour.
#[derive(Debug, Default)]
pub(in crate::profile) struct LevelSet {
    /// Above 0 inside.
    pub phi: Vec<f32>,
    /// The region term.
    pressure: Vec<f32>,
    stop: Vec<f32>,
    /// `grad phi / |grad phi|`, the same times `stop`, and its length. They are up to date at the front and beside it.
    normal: [Vec<f32>; 2],
    flow: [Vec<f32>; 2],
    slope: Vec<f32>,
    laplace: Vec<f32>,
    within: Vec<bool>,
    /// The blocks within the band, and the blocks that a step moves.
    near: Vec<bool>,
    front: Vec<bool>,
    /// Whether a chunk contains a part of the front, and whether it contains that or a block beside it.
    active: Vec<bool>,
    beside: Vec<bool>,
    scratch: Vec<f32>,
}

/// The places of a row of a map with its additional columns, and of the rows above and below.
#[derive(Clone, Copy)]
struct Rows {
    above: usize,
    here: usize,
    below: usize,
}

impl Rows {
    fn of(v: usize, coarse: &Coarse) -> Self {
        let row = |v: usize| v * (coarse.width + 2) + 1;
        Self { above: row(v.saturating_sub(1)), here: row(v), below: row((v + 1).min(coarse.height - 1)) }
    }

    /// The values left, right, above and below of `n` blocks from column `from` on.
    fn beside<'a, T>(&self, map: &'a [T], from: usize, n: usize) -> [&'a [T]; 4] {
        [self.here + from - 1, self.here + from + 1, self.above + from, self.below + from].map(|at| &map[at..at + n])
    }
}

/// The places of a chunk in a map with its additional columns.
fn own(chunk: usize, coarse: &Coarse) -> std::ops::Range<usize> {
    let chunks = coarse.width.div_ceil(CHUNK);
    let (here, from) = (Rows::of(chunk / chunks, coarse).here, chunk % chunks * CHUNK);
    here + from..here + (from + CHUNK).min(coarse.width)
}

/// Repeats the first and the last block of each row.
fn repeat_ends(map: &mut [f32], width: usize) {
    for row in map.chunks_exact_mut(width + 2) {
        (row[0], row[width + 1]) = (row[1], row[width]);
    }
}

impl LevelSet {
    /// Starts from the parts that are clearly darker than `mu` and moves the front.
    pub fn run(&mut self, coarse: &Coarse, settings: &LevelSetSettings) {
        let (w, h) = (coarse.width, coarse.height);
        let mu = self.level_between(coarse, settings);
        let size = (w + 2) * h;
        let [nu, nv] = &mut self.normal;
        let [fu, fv] = &mut self.flow;
        for map in [&mut self.phi, &mut self.pressure, &mut self.stop, nu, nv, fu, fv, &mut self.slope, &mut self.laplace] {
            map.clear();
            map.resize(size, 0.0);
        }
        for set in [&mut self.within, &mut self.near, &mut self.front] {
            set.clear();
            set.resize(size, false);
        }
        for v in 0..h {
            let at = Rows::of(v, coarse).here;
            let (smooth, within) = (&coarse.smooth[0][v * w..(v + 1) * w], &coarse.within[v * w..(v + 1) * w]);
            self.within[at..at + w].copy_from_slice(within);
            // There is no specimen outside of the walls; the front never gets there.
            let start = smooth.iter().zip(within).map(|(i, within)| if *within { (i - mu).clamp(-BAND, BAND) } else { -BAND });
            self.phi[at..at + w].iter_mut().zip(start).for_each(|(phi, start)| *phi = start);
            let pressure = smooth.iter().map(|i| settings.region as f32 * ((i - mu) / mu).clamp(-1.0, 1.0));
            self.pressure[at..at + w].iter_mut().zip(pressure).for_each(|(to, pressure)| *to = pressure);
            let (above, below) = (&coarse.smooth[0][v.saturating_sub(1) * w..][..w], &coarse.smooth[0][(v + 1).min(h - 1) * w..][..w]);
            for (u, stop) in self.stop[at..at + w].iter_mut().enumerate() {
                let (du, dv) = (smooth[(u + 1).min(w - 1)] - smooth[u.saturating_sub(1)], below[u] - above[u]);
                *stop = 1.0 / (1.0 + (du * du + dv * dv) / (mu * mu));
            }
        }
        self.keep_away_from_background(coarse);
        self.active.fill(true);
        self.beside.fill(true);
        repeat_ends(&mut self.phi, w);
        let mut flipped = 0;
        for step in 1..=settings.steps {
            self.find_front(coarse);
            self.find_normals(coarse);
            flipped += self.move_front(coarse, settings.edge as f32);
            if step % REST_STEPS == 0 {
                if flipped == 0 {
                    break;
                }
                flipped = 0;
            }
        }
        // Without the additional columns from here on.
        for v in 0..h {
            let at = Rows::of(v, coarse).here;
            self.phi.copy_within(at..at + w, v * w);
        }
        self.phi.truncate(w * h);
    }

    /// Computes `mu`: a share of the body's typical contrast, but clearly above the noise.
    fn level_between(&mut self, coarse: &Coarse, settings: &LevelSetSettings) -> f32 {
        let clear = settings.least_sigma as f32;
        self.scratch.clear();
        self.scratch.extend(coarse.smooth[0].iter().zip(&coarse.within).filter(|(i, w)| **w && **i > clear).map(|(i, _)| *i));
        (settings.level_share as f32 * quantile(&mut self.scratch, 0.5)).max(clear)
    }

    /// Leaves out the blocks that are further than `REACH` from every block above `mu`. The front never gets there, but the noise
    /// of the background is within the band.
    fn keep_away_from_background(&mut self, coarse: &Coarse) {
        const REACH: usize = 6;
        let (w, chunks) = (coarse.width, coarse.width.div_ceil(CHUNK));
        self.active.clear();
        for v in 0..coarse.height {
            let at = Rows::of(v, coarse).here;
            self.active.extend(self.phi[at..at + w].chunks(CHUNK).map(|chunk| chunk.iter().any(|phi| *phi > 0.0)));
        }
        self.beside.clear();
        self.beside.resize(self.active.len(), false);
        for (at, _) in self.active.iter().enumerate().filter(|(_, active)| **active) {
            let (v, chunk) = (at / chunks, at % chunks);
            for row in v.saturating_sub(REACH)..(v + REACH + 1).min(coarse.height) {
                (chunk.saturating_sub(1)..(chunk + 2).min(chunks)).for_each(|near| self.beside[row * chunks + near] = true);
            }
        }
        for (at, _) in self.beside.iter().enumerate().filter(|(_, beside)| !**beside) {
            self.phi[own(at, coarse)].fill(-BAND);
            self.within[own(at, coarse)].fill(false);
        }
    }

    /// Finds the blocks within the band, and those beside them. Only the chunks at the front and beside it can have changed since the last
    /// step.
    fn find_front(&mut self, coarse: &Coarse) {
        let (w, chunks) = (coarse.width, coarse.width.div_ceil(CHUNK));
        for (at, _) in self.active.iter().enumerate().filter(|(_, active)| **active) {
            let own = own(at, coarse);
            for (near, phi) in self.near[own.clone()].iter_mut().zip(&self.phi[own]) {
                *near = phi.abs() < BAND;
            }
        }
        for (at, active) in self.active.iter_mut().enumerate().filter(|(at, _)| self.beside[*at]) {
            let (rows, from, own) = (Rows::of(at / chunks, coarse), at % chunks * CHUNK, own(at, coarse));
            let (near, within) = (&self.near[own.clone()], &self.within[own.clone()]);
            let [left, right, above, below] = rows.beside(&self.near, from, own.len());
            *active = false;
            for (u, front) in self.front[own].iter_mut().enumerate() {
                let in_reach = near[u] | left[u] | right[u] | above[u] | below[u];
                *front = within[u] & in_reach;
                *active |= *front;
            }
        }
        self.beside.clear();
        self.beside.extend_from_slice(&self.active);
        for (at, _) in self.active.iter().enumerate().filter(|(_, active)| **active) {
            let (v, chunk) = (at / chunks, at % chunks);
            let row = Rows::of(v, coarse).here;
            let (from, last) = (chunk * CHUNK, ((chunk + 1) * CHUNK).min(w) - 1);
            self.beside[at - if v > 0 { chunks } else { 0 }] = true;
            self.beside[at + if v + 1 < coarse.height { chunks } else { 0 }] = true;
            self.beside[at - usize::from(chunk > 0 && self.front[row + from])] = true;
            self.beside[at + usize::from(chunk + 1 < chunks && self.front[row + last])] = true;
        }
    }

    /// Computes the maps that a step needs, at the front and beside it.
    fn find_normals(&mut self, coarse: &Coarse) {
        let (w, chunks) = (coarse.width, coarse.width.div_ceil(CHUNK));
        let [nu, nv] = &mut self.normal;
        let [fu, fv] = &mut self.flow;
        for (at, _) in self.beside.iter().enumerate().filter(|(_, beside)| **beside) {
            let (rows, from) = (Rows::of(at / chunks, coarse), at % chunks * CHUNK);
            let n = CHUNK.min(w - from);
            let own = rows.here + from..rows.here + from + n;
            let (phi, stop) = (&self.phi[own.clone()], &self.stop[own.clone()]);
            let [left, right, above, below] = rows.beside(&self.phi, from, n);
            let (nu, nv, fu, fv) = (&mut nu[own.clone()], &mut nv[own.clone()], &mut fu[own.clone()], &mut fv[own.clone()]);
            let (slope, laplace) = (&mut self.slope[own.clone()], &mut self.laplace[own]);
            for i in 0..n {
                let (du, dv) = ((right[i] - left[i]) * 0.5, (below[i] - above[i]) * 0.5);
                let length = (du * du + dv * dv).sqrt();
                let unit = 1.0 / if length > 1e-3 { length } else { 1e-3 };
                (nu[i], nv[i], slope[i]) = (du * unit, dv * unit, length);
                (fu[i], fv[i]) = (stop[i] * nu[i], stop[i] * nv[i]);
                laplace[i] = left[i] + right[i] + above[i] + below[i] - 4.0 * phi[i];
            }
        }
        repeat_ends(nu, w);
        repeat_ends(fu, w);
    }

    /// Moves the front by one step. Returns the number of blocks that change sides.
    fn move_front(&mut self, coarse: &Coarse, edge: f32) -> usize {
        let mut flipped = 0;
        let (w, chunks) = (coarse.width, coarse.width.div_ceil(CHUNK));
        for (at, _) in self.active.iter().enumerate().filter(|(_, active)| **active) {
            let (rows, from) = (Rows::of(at / chunks, coarse), at % chunks * CHUNK);
            let n = CHUNK.min(w - from);
            let own = rows.here + from..rows.here + from + n;
            let ([nu_left, nu_right, ..], [fu_left, fu_right, ..]) =
                (rows.beside(&self.normal[0], from, n), rows.beside(&self.flow[0], from, n));
            let ([.., nv_above, nv_below], [.., fv_above, fv_below]) =
                (rows.beside(&self.normal[1], from, n), rows.beside(&self.flow[1], from, n));
            let (slope, laplace, pressure) = (&self.slope[own.clone()], &self.laplace[own.clone()], &self.pressure[own.clone()]);
            let (front, phi) = (&self.front[own.clone()], &mut self.phi[own]);
            for i in 0..n {
                let curvature = (fu_right[i] - fu_left[i] + fv_below[i] - fv_above[i]) * 0.5;
                let bend = (nu_right[i] - nu_left[i] + nv_below[i] - nv_above[i]) * 0.5;
                let steep = if slope[i] > 0.2 { slope[i] } else { 0.2 };
                let change = steep * (pressure[i] + edge * curvature) + DISTANCE_PULL * (laplace[i] - bend);
                let moved = (phi[i] + TIME_STEP * change).clamp(-BAND, BAND);
                let moved = if front[i] { moved } else { phi[i] };
                flipped += u32::from((moved > 0.0) != (phi[i] > 0.0));
                phi[i] = moved;
            }
        }
        repeat_ends(&mut self.phi, w);
        flipped as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::synthetic::{Noise, blurred_step};

    const SIZE: usize = 60;
    const RADIUS: f64 = 15.0;

    /// What the front encloses of a disc of contrast 15 under noise of 1, with something beside it.
    fn found(beside: impl Fn(f64, f64) -> f64) -> (Vec<bool>, LevelSet) {
        let mut noise = Noise::new(5);
        let map = (0..SIZE * SIZE).map(|i| {
            let (u, v) = ((i % SIZE) as f64 - 29.5, (i / SIZE) as f64 - 29.5);
            let disc = blurred_step(RADIUS - u.hypot(v), 0.7);
            (15.0 * disc + (1.0 - disc) * beside(u, v) + noise.next()) as f32
        });
        let coarse = Coarse::of_lightness(SIZE, map.collect());
        let mut set = LevelSet::default();
        set.run(&coarse, &LevelSetSettings::default());
        assert!(set.phi.iter().all(|phi| phi.is_finite() && phi.abs() <= BAND));
        (set.phi.iter().map(|phi| *phi > 0.0).collect(), set)
    }

    fn radius(inside: &[bool]) -> f64 {
        (inside.iter().filter(|i| **i).count() as f64 / std::f64::consts::PI).sqrt()
    }

    /// The level is 0.4 of the contrast, so the front stands a little outside half height: 0.25 of the blur of 0.7 and the
    /// smoothing's 0.7 together.
    #[test]
    fn a_disc_is_found_with_its_area() {
        let (inside, _) = found(|_, _| 0.0);
        assert!((radius(&inside) - RADIUS - 0.25).abs() < 0.3, "{}", radius(&inside));
    }

    /// What is clearly darker than nothing and fainter than the level is lost, which is why it is not used alone.
    #[test]
    fn a_transparent_side_is_lost() {
        let (inside, _) = found(|u, v| if u > 0.0 && v.abs() < 8.0 { 2.5 } else { 0.0 });
        let beyond = (0..SIZE * SIZE).filter(|i| inside[*i] && (i % SIZE) as f64 - 29.5 > RADIUS + 2.0).count();
        assert!(beyond <= 2 && (radius(&inside) - RADIUS).abs() < 0.8, "{beyond} blocks beyond, radius {}", radius(&inside));
    }

    /// Through a side without an edge it runs on as far as the dark goes, but not into what is brighter than the background.
    #[test]
    fn it_leaks_into_the_dark_and_never_into_the_bright() {
        let (inside, _) = found(|u, v| {
            if u > 0.0 && v.abs() < 6.0 {
                9.0
            } else if u < 0.0 {
                -9.0
            } else {
                0.0
            }
        });
        let count = |of: &dyn Fn(f64, f64) -> bool| {
            (0..SIZE * SIZE).filter(|i| inside[*i] && of((i % SIZE) as f64 - 29.5, (i / SIZE) as f64 - 29.5)).count()
        };
        assert!(count(&|u, v| u > 20.0 && v.abs() < 5.0) > 80, "the arm is taken");
        assert_eq!(count(&|u, v| u < 0.0 && u.hypot(v) > RADIUS + 1.5), 0);
    }
}
