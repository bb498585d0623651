//! Volume and area of slices.

use super::cap::Cap;
use super::sections::{Section, Sections, all_around};
use crate::calibration::area_loss;
use crate::fins::FinSlice;
use crate::parallel::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Least distance of an outline from its centre, in mean radii, at which it counts as round.
const ROUND: f64 = 0.4;

impl Sections {
    /// Volume of the slices as they are: [`Self::volume_bias_um3`] is still in it.
    pub(super) fn volume_um3(&self) -> f64 {
        let areas = self.areas_um2();
        let n = areas.len();
        if n < 2 {
            return 0.0;
        }
        let inner: f64 = areas.windows(2).map(|w| f64::midpoint(w[0], w[1])).sum::<f64>() * self.step_um;
        // Error of the trapezoidal rule, from the slopes at both ends.
        let bend = (areas[n - 1] - areas[n - 2] - (areas[1] - areas[0])) * self.step_um / 12.0;
        inner - bend + self.caps().iter().map(|c| c.volume_um3()).sum::<f64>()
    }

    /// What errors of the edges add to the volume on average: spurious harmonics enclose less.
    pub(super) fn volume_bias_um3(&self) -> f64 {
        self.area_bias_um2 * self.step_um
    }

    /// What shifts of single views do to the volume: mean and standard deviation. Their odd harmonics are in the outline of
    /// every slice, and reduce its area. The part of the shifts that is no harmonic says how far views are shifted.
    pub(super) fn shift_bias_um3(&self) -> [f64; 2] {
        let each = 4.0 * self.shift_variance_um2 / self.without.len() as f64;
        let lost: Vec<f64> = (3..=self.harmonics).step_by(2).map(|k| FRAC_PI_2 * area_loss(k) * each).collect();
        let length = self.slices.len() as f64 * self.step_um;
        [-length * lost.iter().sum::<f64>(), length * lost.iter().map(|l| l * l).sum::<f64>().sqrt()]
    }

    /// Standard deviation on another turn, by jackknife over the views.
    pub(super) fn volume_sd_um3(&self) -> f64 {
        jackknife_sd(self.without.iter().map(|c| c.volume)).hypot(self.shift_bias_um3()[1])
    }

    pub(super) fn area_sd_um2(&self) -> f64 {
        jackknife_sd(self.without.iter().map(|c| c.outline))
    }

    pub(super) fn area_um2(&self) -> f64 {
        let rings: Vec<f64> = (0..self.slices.len()).into_par_iter().map(|i| self.ring(&self.slices, i)).collect();
        let inner: f64 = rings.windows(2).map(|w| f64::midpoint(w[0], w[1])).sum::<f64>() * self.step_um;
        inner + self.caps().iter().map(|c| c.area_um2()).sum::<f64>()
    }

    /// Area of the surface of these slices per um of x: `Int (h + h'') sqrt(1 + h_x^2) dtheta`.
    pub(super) fn ring(&self, slices: &[Section], at: usize) -> f64 {
        const DIRECTIONS: u32 = 96;
        let n = slices.len();
        let (before, after) = (at.saturating_sub(1), (at + 1).min(n - 1));
        let (a, here, b) = (&slices[before], &slices[at], &slices[after]);
        let across = (after - before) as f64 * self.step_um;
        // About its own centre the squared distance of a round outline falls evenly up to the very end of the specimen, where
        // its radius falls as a root.
        let centred = |section: &Section, (sin, cos): (f64, f64), theta: f64| {
            section.at(theta) - section.support.coefficients[1] * cos - section.support.coefficients[2] * sin
        };
        let moves = [1, 2].map(|k| (b.support.coefficients[k] - a.support.coefficients[k]) / across);
        let step = TAU / f64::from(DIRECTIONS);
        all_around(DIRECTIONS)
            .map(|theta| {
                let (sin, cos) = theta.sin_cos();
                let [before, own, after] = [a, here, b].map(|section| centred(section, (sin, cos), theta));
                let shrinks = if own > ROUND * here.support.coefficients[0] {
                    (after * after - before * before) / (2.0 * own)
                } else {
                    // The squared distance of a fin's edge is hardly different from 0.
                    after - before
                };
                let slope = shrinks / across + moves[0] * cos + moves[1] * sin;
                // A fin's corner is spread over a step, which keeps its length.
                let fins = here.fins.as_ref().map_or(0.0, |fins| {
                    let [left, middle, right] = [theta - step, theta, theta + step].map(|theta| fins.at(theta));
                    middle + (left - 2.0 * middle + right) / (step * step)
                });
                (here.support.curvature_radius(theta) + fins) * slope.hypot(1.0)
            })
            .sum::<f64>()
            * step
    }

    /// Number of views that show the slices.
    pub(crate) fn views(&self) -> usize {
        self.without.len()
    }

    /// Length of all fins along the capillary, of that of the specimen.
    pub(crate) fn fins_share(&self) -> f64 {
        let fins: usize = self.slices.iter().filter_map(|s| s.fins.as_ref()).map(FinSlice::fins).sum();
        fins as f64 / self.slices.len().max(1) as f64
    }

    /// What fins that stand out further by so many um add to volume (um^3) and area (um^2).
    pub(crate) fn with_fins_further_out(&self, by_um: f64) -> [f64; 2] {
        let changes: Vec<[f64; 2]> = self
            .slices
            .par_iter()
            .filter_map(|slice| {
                let fins = slice.fins.as_ref()?.further_out(by_um);
                let moved = Section { fins: Some(fins), ..slice.clone() };
                Some([moved.area_um2() - slice.area_um2(), moved.perimeter_um() - slice.perimeter_um()])
            })
            .collect();
        changes.iter().fold([0.0; 2], |sum, change| [0, 1].map(|i| sum[i] + change[i] * self.step_um))
    }

    /// From end to end along the capillary.
    pub(super) fn length_um(&self) -> f64 {
        (self.slices.len() as f64 - 1.0) * self.step_um + self.caps().iter().map(|c| c.length_um).sum::<f64>()
    }

    fn caps(&self) -> [Cap; 2] {
        let n = self.slices.len();
        let squares = |i: usize| self.slices[i].support.coefficients[0].powi(2);
        [(0, 1.min(n - 1), self.open[0]), (n - 1, n.saturating_sub(2), self.open[1])].map(|(end, next, open)| {
            if open {
                return Cap { square_um2: 0.0, length_um: 0.0 };
            }
            let fall = ((squares(next) - squares(end)) / self.step_um).max(1e-9);
            let square = self.slices[end].area_um2().max(0.0) / PI;
            Cap { square_um2: square, length_um: (square / fall).min(2.0 * self.step_um) }
        })
    }
}

/// Standard deviation of a number from its changes when each view is left out (jackknife).
fn jackknife_sd(without: impl ExactSizeIterator<Item = f64> + Clone) -> f64 {
    let n = without.len() as f64;
    let mean = without.clone().sum::<f64>() / n;
    ((n - 1.0) / n * without.map(|d| (d - mean).powi(2)).sum::<f64>()).sqrt()
}
