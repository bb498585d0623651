//! The true steps of a turn, from the rows in which a specimen beside the axis is seen.
//!
//! ```text
//!  row(s) = axis + a cos(2 pi s / P) + b sin(2 pi s / P)        s: commanded steps, P: steps of a turn
//! ```

use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A circular path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Orbit {
    /// Steps of one turn.
    pub period_steps: f64,
    /// Row of the axis, px.
    pub axis_px: f64,
    /// Distance of the specimen from the axis, px.
    pub radius_px: f64,
    /// Root mean square distance of the rows from the path, px.
    pub residual_px: f64,
}

/// Periods that are tried, as multiples of the expected one.
const TRIED: [f64; 2] = [1.0 / 16.0, 4.0];
const TRIALS: u32 = 4000;
/// Least radius, px: the row of a bead is known to about a tenth of this.
const LEAST_RADIUS_PX: f64 = 1.0;
/// Most residual, in radii.
const MOST_RESIDUAL: f64 = 0.2;

/// The path of a specimen that was seen at `[steps, row]`. `None` if it does not move on a circle.
pub fn orbit(places: &[[f64; 2]], expected_steps: f64) -> Option<Orbit> {
    let [least, most] = TRIED.map(f64::ln);
    let period = |trial: u32| expected_steps * (least + (most - least) * f64::from(trial) / f64::from(TRIALS)).exp();
    let coarse = (0..=TRIALS).filter_map(|trial| fit(places, period(trial))).min_by(|a, b| a.residual_px.total_cmp(&b.residual_px))?;
    let width = (most - least) / f64::from(TRIALS);
    let fine = |trial: i32| fit(places, coarse.period_steps * (width * f64::from(trial) / 500.0).exp());
    let best = (-1000..=1000).filter_map(fine).min_by(|a, b| a.residual_px.total_cmp(&b.residual_px))?;
    (best.radius_px >= LEAST_RADIUS_PX && best.residual_px <= MOST_RESIDUAL * best.radius_px).then_some(best)
}

/// Least squares for one period.
fn fit(places: &[[f64; 2]], period_steps: f64) -> Option<Orbit> {
    if places.len() < 6 {
        return None;
    }
    let waves = |steps: f64| {
        let (sin, cos) = (TAU * steps / period_steps).sin_cos();
        nalgebra::Vector3::new(1.0, cos, sin)
    };
    let (mut normal, mut right) = (nalgebra::Matrix3::zeros(), nalgebra::Vector3::zeros());
    for [steps, row] in places {
        let w = waves(*steps);
        normal += w * w.transpose();
        right += w * *row;
    }
    let found = normal.cholesky()?.solve(&right);
    let square = places.iter().map(|[steps, row]| (row - found.dot(&waves(*steps))).powi(2)).sum::<f64>() / places.len() as f64;
    // A long period makes an arc of a huge circle of any slow drift.
    let radius_px = found.y.hypot(found.z);
    let rows = places.iter().map(|p| p[1]);
    let spread = rows.clone().fold(f64::MIN, f64::max) - rows.fold(f64::MAX, f64::min);
    (radius_px <= 2.0 * spread).then_some(Orbit { period_steps, axis_px: found.x, radius_px, residual_px: square.sqrt() })
}

/// The whole number of steps that a motor is likely to have: a multiple of 100 where one is near.
pub fn likely(period_steps: f64) -> u32 {
    let round = (period_steps / 100.0).round() * 100.0;
    if round > 0.0 && (period_steps / round - 1.0).abs() < 0.007 { round as u32 } else { period_steps.round() as u32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(true_steps: f64, radius: f64, commanded: f64) -> Option<Orbit> {
        let fine = (0..8).map(|i| commanded / 64.0 * f64::from(i));
        let coarse = (0..=32).map(|i| commanded / 16.0 * f64::from(i));
        let place = |steps: f64| [steps, 511.0 + radius * (TAU * steps / true_steps + 0.7).sin() + 0.05 * (steps * 12.9898).sin()];
        orbit(&fine.chain(coarse).map(place).collect::<Vec<_>>(), commanded)
    }

    #[test]
    fn the_true_steps_are_found_from_a_wrong_number() {
        for (true_steps, commanded) in [(500.0, 500.0), (500.0, 400.0), (500.0, 1000.0), (6400.0, 3200.0), (500.0, 6400.0), (200.0, 400.0)]
        {
            let found = seen(true_steps, 6.0, commanded).unwrap();
            assert!((found.period_steps / true_steps - 1.0).abs() < 0.005, "{true_steps} as {commanded}: {found:?}");
            assert!((found.axis_px - 511.0).abs() < 0.2 && (found.radius_px - 6.0).abs() < 0.2, "{found:?}");
            assert_eq!(likely(found.period_steps), true_steps as u32);
        }
        assert_eq!((likely(533.4), likely(40.2), likely(3199.0)), (533, 40, 3200));
    }

    #[test]
    fn what_does_not_circle_has_no_period() {
        assert!(seen(500.0, 0.3, 500.0).is_none());
        assert!(orbit(&[[0.0, 1.0]; 5], 500.0).is_none() && orbit(&[[0.0, 1.0]; 9], 500.0).is_none());
    }
}
