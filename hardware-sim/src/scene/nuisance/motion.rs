//! Motion blur: the whole image moves during the exposure, as with a vibrating camera.
//!
//! ```text
//!   from  - motion / 2  ...  0 (position of the ground truth)  ...  + motion / 2
//! ```
//! The motion is centred. An edge is blurred by the same amount to both sides, and its half level stays at the ground truth.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The uniform motion of the image during an exposure, along a straight line.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Motion {
    pub u_px: f64,
    pub v_px: f64,
}

/// Number of positions along the line that are averaged.
const PLACES: i32 = 32;

impl Motion {
    pub fn is_still(self) -> bool {
        self.u_px == 0.0 && self.v_px == 0.0
    }

    /// The mean of the image over the motion. Pixels at the border are repeated outwards.
    pub fn blurred(self, light: &[[f32; 3]], width: usize) -> Vec<[f32; 3]> {
        let height = light.len() / width.max(1);
        let taps = self.taps();
        let mut out = vec![[0.0f32; 3]; light.len()];
        out.par_chunks_mut(width.max(1)).enumerate().for_each(|(v, row)| {
            for (u, pixel) in row.iter_mut().enumerate() {
                for &(du, dv, weight) in &taps {
                    let from_u = (u as i64 + du).clamp(0, width as i64 - 1) as usize;
                    let from_v = (v as i64 + dv).clamp(0, height as i64 - 1) as usize;
                    let from = light[from_v * width + from_u];
                    *pixel = std::array::from_fn(|k| pixel[k] + weight * from[k]);
                }
            }
        });
        out
    }

    /// Whole-pixel shifts and their weights.
    fn taps(self) -> Vec<(i64, i64, f32)> {
        let reach = (self.u_px.abs().max(self.v_px.abs()) / 2.0).ceil() as i64 + 1;
        let side = 2 * reach + 1;
        let mut weights = vec![0.0f64; (side * side) as usize];
        for i in 0..PLACES {
            let along = (f64::from(i) + 0.5) / f64::from(PLACES) - 0.5;
            let (u, v) = (nearby(self.u_px * along), nearby(self.v_px * along));
            for (du, wu) in u {
                for (dv, wv) in v {
                    weights[((dv + reach) * side + du + reach) as usize] += wu * wv / f64::from(PLACES);
                }
            }
        }
        let shift = |i: usize| (i as i64 % side - reach, i as i64 / side - reach);
        weights.iter().enumerate().filter(|(_, w)| **w != 0.0).map(|(i, w)| (shift(i).0, shift(i).1, *w as f32)).collect()
    }
}

/// A fractional shift as a weighted sum of three whole shifts, by the parabola through them. The mean and the variance of the motion
/// stay exact. Linear interpolation between two would add blur.
fn nearby(shift: f64) -> [(i64, f64); 3] {
    let whole = shift.round();
    let (t, i) = (shift - whole, whole as i64);
    [(i - 1, t * (t - 1.0) / 2.0), (i, 1.0 - t * t), (i + 1, t * (t + 1.0) / 2.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_motion_has_mean_0_and_the_variance_of_a_uniform_distribution() {
        for motion in [Motion { u_px: 2.0, v_px: 0.0 }, Motion { u_px: 0.7, v_px: 1.3 }, Motion { u_px: -1.0, v_px: 2.6 }] {
            let taps = motion.taps();
            let sum = |f: &dyn Fn(f64, f64) -> f64| taps.iter().map(|&(u, v, w)| f64::from(w) * f(u as f64, v as f64)).sum::<f64>();
            assert!((sum(&|_, _| 1.0) - 1.0).abs() < 1e-6);
            assert!(sum(&|u, _| u).abs() < 1e-6 && sum(&|_, v| v).abs() < 1e-6, "{motion:?}");
            // 32 places instead of a line: less by 1/32^2.
            let even = 1.0 - 1.0 / f64::from(PLACES * PLACES);
            assert!((sum(&|u, _| u * u) - even * motion.u_px.powi(2) / 12.0).abs() < 1e-6, "{motion:?}");
            assert!((sum(&|_, v| v * v) - even * motion.v_px.powi(2) / 12.0).abs() < 1e-6, "{motion:?}");
            assert!((sum(&|u, v| u * v) - even * motion.u_px * motion.v_px / 12.0).abs() < 1e-6, "{motion:?}");
        }
    }
}
