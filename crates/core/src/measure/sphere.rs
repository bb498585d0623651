//! The sphere nearest to a set of points, by least squares of their distances from its surface.

use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};

/// A fitted sphere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SphereFit {
    /// Its diameter.
    pub diameter_um: f64,
    /// Root mean square distance of the points from the sphere's surface.
    pub rms_um: f64,
    /// Its centre.
    pub centre_um: [f64; 3],
}

/// Why points do not determine a sphere.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SphereError {
    /// Too few points.
    #[error("a sphere through {found} points is not determined; it takes at least 4")]
    TooFewPoints {
        /// Points given.
        found: usize,
    },
    /// The points lie in a plane, or nearly so.
    #[error(
        "the points lie in a plane or nearly so (the thinnest of their directions has {ratio:.1e} of the widest's spread): no one sphere is nearest"
    )]
    Flat {
        /// Least variance over the largest.
        ratio: f64,
    },
    /// The fit did not converge.
    #[error("the sphere fit did not settle within {steps} steps (last step {last_um:.1e} um): the points are not those of a sphere")]
    NotConverged {
        /// Steps done.
        steps: usize,
        /// Length of the last step, um.
        last_um: f64,
    },
}

const MAX_STEPS: usize = 50;
/// Below this ratio of variances the points span no volume that f64 could tell from a plane.
const FLAT: f64 = 1e-10;

/// Fits a sphere to points, um. It starts from the algebraic fit, a linear system, and refines it by Gauss-Newton on the
/// distances.
///
/// # Errors
/// [`SphereError`], with the reason.
pub fn fit_sphere(points: &[[f64; 3]]) -> Result<SphereFit, SphereError> {
    if points.len() < 4 {
        return Err(SphereError::TooFewPoints { found: points.len() });
    }
    let n = points.len() as f64;
    let mean: [f64; 3] = std::array::from_fn(|a| points.iter().map(|p| p[a]).sum::<f64>() / n);
    // Centred and scaled to about 1, the squares below keep their digits.
    let scale = (points.iter().map(|p| (0..3).map(|a| (p[a] - mean[a]).powi(2)).sum::<f64>()).sum::<f64>() / n).sqrt();
    if !(scale.is_finite() && scale > 0.0) {
        return Err(SphereError::Flat { ratio: 0.0 });
    }
    let scaled = || points.iter().map(|p| -> [f64; 3] { std::array::from_fn(|a| (p[a] - mean[a]) / scale) });
    let spread = nalgebra::Matrix3::from_fn(|i, j| scaled().map(|p| p[i] * p[j]).sum::<f64>() / n).symmetric_eigenvalues();
    let ratio = spread.min() / spread.max();
    if ratio < FLAT {
        return Err(SphereError::Flat { ratio: ratio.max(0.0) });
    }
    let not_solved = SphereError::Flat { ratio };

    // |p|^2 = 2 c p + (r^2 - |c|^2)
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for [x, y, z] in scaled() {
        let row = Vector4::new(x, y, z, 1.0);
        normal += row * row.transpose();
        right += row * (x * x + y * y + z * z);
    }
    let Some(solved) = normal.cholesky().map(|c| c.solve(&right)) else { return Err(not_solved) };
    let mut centre = [solved[0] / 2.0, solved[1] / 2.0, solved[2] / 2.0];
    let mut radius = (solved[3] + centre.iter().map(|c| c * c).sum::<f64>()).max(0.0).sqrt();

    let mut last = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for p in scaled() {
            let d: [f64; 3] = std::array::from_fn(|a| p[a] - centre[a]);
            let length = d.iter().map(|d| d * d).sum::<f64>().sqrt();
            if length > 0.0 {
                // The distance falls as the centre comes nearer and as the radius grows.
                let row = Vector4::new(d[0] / length, d[1] / length, d[2] / length, 1.0);
                normal += row * row.transpose();
                right += row * (length - radius);
            }
        }
        let Some(step) = normal.cholesky().map(|c| c.solve(&right)) else { return Err(not_solved) };
        (0..3).for_each(|a| centre[a] += step[a]);
        radius += step[3];
        last = step.norm();
        if last < 1e-12 {
            let square = |p: [f64; 3]| ((0..3).map(|a| (p[a] - centre[a]).powi(2)).sum::<f64>().sqrt() - radius).powi(2);
            return Ok(SphereFit {
                diameter_um: 2.0 * radius * scale,
                rms_um: (scaled().map(square).sum::<f64>() / n).sqrt() * scale,
                centre_um: std::array::from_fn(|a| mean[a] + centre[a] * scale),
            });
        }
    }
    Err(SphereError::NotConverged { steps: MAX_STEPS, last_um: last * scale })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points spread evenly over a part of a sphere by the golden angle, each off by `noise` to either side in turn.
    fn cap(count: usize, share: f64, noise: f64) -> Vec<[f64; 3]> {
        (0..count)
            .map(|i| {
                let z = 1.0 - 2.0 * share * (i as f64 + 0.5) / count as f64;
                let (s, turn) = ((1.0 - z * z).sqrt(), 2.399_963 * i as f64);
                let r = 256.0 + if i % 2 == 0 { noise } else { -noise };
                [120.0 + r * s * turn.cos(), 15.0 + r * s * turn.sin(), -20.0 + r * z]
            })
            .collect()
    }

    #[test]
    fn a_sphere_comes_back_from_the_whole_and_from_a_cap() {
        for (share, tolerance) in [(1.0, 1e-9), (0.2, 1e-7)] {
            let fit = fit_sphere(&cap(400, share, 0.0)).unwrap();
            assert!((fit.diameter_um - 512.0).abs() < tolerance && fit.rms_um < tolerance, "{fit:?}");
            assert!([120.0, 15.0, -20.0].iter().zip(fit.centre_um).all(|(a, b)| (a - b).abs() < tolerance), "{fit:?}");
        }
    }

    /// Noise of +-2 um, half each way, cancels in the radius to 2 / sqrt(n) and stays in the rms.
    #[test]
    fn noise_stays_in_the_rms() {
        let fit = fit_sphere(&cap(2000, 1.0, 2.0)).unwrap();
        assert!((fit.diameter_um - 512.0).abs() < 3.0 * 2.0 * 2.0 / 2000f64.sqrt(), "{fit:?}");
        assert!((fit.rms_um - 2.0).abs() < 0.01, "{fit:?}");
    }

    #[test]
    fn what_determines_no_sphere_is_named() {
        assert_eq!(fit_sphere(&[[0.0; 3]; 3]), Err(SphereError::TooFewPoints { found: 3 }));
        assert_eq!(fit_sphere(&[[1.0; 3]; 9]), Err(SphereError::Flat { ratio: 0.0 }));
        let flat: Vec<[f64; 3]> = cap(100, 1.0, 0.0).into_iter().map(|[x, y, _]| [x, y, 0.3 * x + 7.0]).collect();
        assert!(matches!(fit_sphere(&flat), Err(SphereError::Flat { .. })));
    }
}
