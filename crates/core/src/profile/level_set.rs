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
use super::plane::quantile;
use super::settings::LevelSetSettings;

/// Half the width of the band that is moved, blocks.
const BAND: f32 = 3.0;
const TIME_STEP: f32 = 0.3;
/// Weight of the pull towards slope 1. It is stable where its product with `TIME_STEP` is below 1/4.
const DISTANCE_PULL: f32 = 0.3;

#[derive(Debug, Default)]
pub(super) struct LevelSet {
    /// Above 0 inside.
    pub phi: Vec<f32>,
    stop: Vec<f32>,
    next: Vec<f32>,
    /// `grad phi / |grad phi|` and its length. They are up to date at the blocks in `front` and beside them.
    normal: [Vec<f32>; 2],
    slope: Vec<f32>,
    /// The blocks that a step moves.
    front: Vec<usize>,
    /// Whether the normal of a block is up to date.
    known: Vec<bool>,
    scratch: Vec<f32>,
}

impl LevelSet {
    /// Starts from the parts that are clearly darker than `mu` and moves the front.
    pub fn run(&mut self, coarse: &Coarse, settings: &LevelSetSettings) {
        let (w, h) = (coarse.width, coarse.height);
        let size = w * h;
        let mu = self.level_between(coarse, settings);
        for field in [&mut self.stop, &mut self.next, &mut self.slope].into_iter().chain(&mut self.normal) {
            field.clear();
            field.resize(size, 0.0);
        }
        for v in 0..h {
            let (above, below) = (v.saturating_sub(1) * w, (v + 1).min(h - 1) * w);
            for u in 0..w {
                let (left, right) = (u.saturating_sub(1), (u + 1).min(w - 1));
                let (du, dv) = (
                    coarse.smooth[0][v * w + right] - coarse.smooth[0][v * w + left],
                    coarse.smooth[0][below + u] - coarse.smooth[0][above + u],
                );
                self.stop[v * w + u] = 1.0 / (1.0 + (du * du + dv * dv) / (mu * mu));
            }
        }
        self.phi.clear();
        // There is no specimen outside of the walls; the front never gets there.
        self.phi.extend(
            coarse.smooth[0].iter().zip(&coarse.within).map(|(i, within)| if *within { (i - mu).clamp(-BAND, BAND) } else { -BAND }),
        );
        for _ in 0..settings.steps {
            self.step(coarse, mu, settings);
        }
    }

    /// Computes `mu`: a share of the body's typical contrast, but clearly above the noise.
    fn level_between(&mut self, coarse: &Coarse, settings: &LevelSetSettings) -> f32 {
        let clear = settings.least_sigma as f32;
        self.scratch.clear();
        self.scratch.extend(coarse.smooth[0].iter().zip(&coarse.within).filter(|(i, w)| **w && **i > clear).map(|(i, _)| *i));
        (settings.level_share as f32 * quantile(&mut self.scratch, 0.5)).max(clear)
    }

    fn step(&mut self, coarse: &Coarse, mu: f32, settings: &LevelSetSettings) {
        let (w, h) = (coarse.width, coarse.height);
        let (region, edge) = (settings.region as f32, settings.edge as f32);
        self.find_front(coarse);
        let Self { phi, stop, next, normal: [nu, nv], slope, front, known, .. } = self;
        let beside = |i: usize| {
            let (u, v) = (i % w, i / w);
            [i - usize::from(u > 0), i + usize::from(u + 1 < w), i - if v > 0 { w } else { 0 }, i + if v + 1 < h { w } else { 0 }]
        };
        known.clear();
        known.resize(w * h, false);
        for &at in &*front {
            for i in beside(at).into_iter().chain([at]) {
                if std::mem::replace(&mut known[i], true) {
                    continue;
                }
                let [left, right, above, below] = beside(i);
                let (du, dv) = ((phi[right] - phi[left]) / 2.0, (phi[below] - phi[above]) / 2.0);
                let length = (du * du + dv * dv).sqrt();
                let unit = 1.0 / length.max(1e-3);
                (nu[i], nv[i], slope[i]) = (du * unit, dv * unit, length);
            }
        }
        next.copy_from_slice(phi);
        for &i in &*front {
            let [left, right, above, below] = beside(i);
            let flow = |i: usize, n: &[f32]| stop[i] * n[i];
            let curvature = (flow(right, nu) - flow(left, nu) + flow(below, nv) - flow(above, nv)) / 2.0;
            let pressure = ((coarse.smooth[0][i] - mu) / mu).clamp(-1.0, 1.0);
            let laplace = phi[left] + phi[right] + phi[above] + phi[below] - 4.0 * phi[i];
            let bend = (nu[right] - nu[left] + nv[below] - nv[above]) / 2.0;
            let change = slope[i].max(0.2) * (region * pressure + edge * curvature) + DISTANCE_PULL * (laplace - bend);
            next[i] = (phi[i] + TIME_STEP * change).clamp(-BAND, BAND);
        }
        std::mem::swap(phi, next);
    }

    /// Lists the blocks within the band, and those beside them, in the order of the map.
    fn find_front(&mut self, coarse: &Coarse) {
        let (w, h) = (coarse.width, coarse.height);
        self.front.clear();
        for v in 0..h {
            let row = |v: usize| &self.phi[v * w..(v + 1) * w];
            let (above, here, below) = (row(v.saturating_sub(1)), row(v), row((v + 1).min(h - 1)));
            let within = &coarse.within[v * w..(v + 1) * w];
            let near = |phi: f32| phi.abs() < BAND;
            self.front.extend(
                (0..w)
                    .filter(|&u| {
                        let beside = near(here[u.saturating_sub(1)]) | near(here[(u + 1).min(w - 1)]) | near(above[u]) | near(below[u]);
                        within[u] & (near(here[u]) | beside)
                    })
                    .map(|u| v * w + u),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{Noise, blurred_step};
    use super::*;

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
