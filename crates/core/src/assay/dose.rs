//! The response to a dose: a four-parameter logistic curve by least squares.
//!
//! ```text
//!   y(c) = a + (b - a) / (1 + (EC50 / c)^h),   y(0) = a,   h > 0
//!
//!   b ─              ____      a, b     responses at dose 0 and at a very large dose
//!               _,-'           EC50     dose of half the effect
//!   a ─ _____,-'               h        Hill slope, > 0: whether the response rises or falls is in b - a
//!           EC50
//! ```
//! For given EC50 and h the curve is linear in a and b. So a grid over ln EC50 and ln h finds the valley, and Levenberg-Marquardt
//! with all four parameters its floor.

use super::summary::student;
use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use std::f64::consts::LN_10;

/// A fitted number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// The value.
    pub value: f64,
    /// Its standard deviation, of the curve linearised at the solution.
    pub sd: f64,
    /// 95 % confidence interval, by Student's t with n - 4 degrees of freedom.
    pub interval_95: [f64; 2],
}

/// A curve fitted to the responses to one compound.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DoseResponse {
    /// Number of values.
    pub n: usize,
    /// Number of different doses, with dose 0.
    pub doses: usize,
    /// Response at dose 0 (a).
    pub at_zero: Parameter,
    /// Response at a very large dose (b).
    pub at_infinity: Parameter,
    /// Decimal logarithm of the EC50.
    pub log10_ec50: Parameter,
    /// Hill slope (h).
    pub hill: Parameter,
    /// Dose of half the effect, in the unit of the doses.
    pub ec50: f64,
    /// 95 % confidence interval of the EC50: that of its logarithm.
    pub ec50_interval_95: [f64; 2],
    /// Whether the EC50 lies between the smallest dose above 0 and the largest dose. Outside it is an extrapolation.
    pub ec50_is_within_doses: bool,
    /// Standard deviation of the values about the curve, with n - 4 degrees of freedom.
    pub residual_sd: f64,
    /// Probability of so good a curve if the dose had no effect (F test against the mean).
    pub p_no_effect: f64,
    /// Covariance of a, b, ln EC50 and ln h, of the curve linearised at the solution.
    pub covariance: [[f64; 4]; 4],
}

/// Why there is no curve.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DoseRefusal {
    /// Too few values.
    #[error("{values} wells have this number; a curve of four parameters needs at least {LEAST_VALUES}")]
    FewValues {
        /// Values given.
        values: usize,
    },
    /// Too few doses.
    #[error(
        "there are {doses} different doses, {above_zero} of them above 0; a curve needs at least {LEAST_DOSES}, {LEAST_ABOVE_ZERO} of them above 0"
    )]
    FewDoses {
        /// Different doses.
        doses: usize,
        /// Different doses above 0.
        above_zero: usize,
    },
    /// A value that is no number, or a dose below 0.
    #[error("dose {dose}, response {response}: a dose is a number of 0 or more, a response any number")]
    NotFinite {
        /// The dose.
        dose: f64,
        /// The response.
        response: f64,
    },
    /// The F test does not see an effect.
    #[error("the response does not depend on the dose within its scatter (F test, p = {p:.3}; a curve is stated up to {MOST_P})")]
    NoEffect {
        /// Probability of so good a curve without an effect.
        p: f64,
    },
    /// The fit ran to the border of its range.
    #[error("the doses do not show the slope: the Hill slope runs to {hill:.3}, the range is {} to {}. Doses nearer to the EC50 show it", HILL[0], HILL[1])]
    NoSlope {
        /// The slope where the search ended.
        hill: f64,
    },
    /// The covariance is singular.
    #[error("the doses do not determine all four parameters: add doses below and above the EC50")]
    Undetermined,
}

/// Parameters of the curve.
const PARAMETERS: usize = 4;
const LEAST_VALUES: usize = PARAMETERS + 1;
const LEAST_DOSES: usize = 4;
const LEAST_ABOVE_ZERO: usize = 3;
/// Slopes beyond these are a step or a straight line: no data of wells distinguish them.
const HILL: [f64; 2] = [0.1, 20.0];
const MOST_P: f64 = 0.05;
/// Steps of the grid: over the logarithm of the doses with a decade beyond either end, and over that of the slopes.
const GRID: [usize; 2] = [60, 24];
/// Passes after which the search ends. It converges in some ten.
const PASSES: usize = 200;

/// ln EC50 and ln h.
type Shape = [f64; 2];

/// Share of the effect at a dose.
fn share(dose: f64, [ln_ec50, ln_hill]: Shape) -> f64 {
    if dose <= 0.0 {
        return 0.0;
    }
    1.0 / (1.0 + (-(ln_hill.exp()) * (dose.ln() - ln_ec50)).exp())
}

/// a, b, ln EC50, ln h.
type Curve = Vector4<f64>;

fn value(dose: f64, curve: &Curve) -> f64 {
    curve[0] + (curve[1] - curve[0]) * share(dose, [curve[2], curve[3]])
}

fn misfit(points: &[[f64; 2]], curve: &Curve) -> f64 {
    points.iter().map(|&[dose, y]| (y - value(dose, curve)).powi(2)).sum()
}

/// Derivatives of the value by a, b, ln EC50 and ln h.
fn slopes(dose: f64, curve: &Curve) -> Vector4<f64> {
    let s = share(dose, [curve[2], curve[3]]);
    let steep = (curve[1] - curve[0]) * s * (1.0 - s) * curve[3].exp();
    let distance = if dose > 0.0 { dose.ln() - curve[2] } else { 0.0 };
    Vector4::new(1.0 - s, s, -steep, steep * distance)
}

impl DoseResponse {
    /// Fits a curve to points, each (dose, response).
    ///
    /// # Errors
    /// [`DoseRefusal`] where the points do not determine it.
    pub fn fit(points: &[[f64; 2]]) -> Result<Self, DoseRefusal> {
        let doses = checked(points)?;
        let n = points.len();
        let curve = polished(points, coarse(points, &doses).ok_or(DoseRefusal::Undetermined)?);
        let rest = misfit(points, &curve);
        let degrees = (n - PARAMETERS) as f64;
        let p = p_no_effect(points, rest, degrees);
        if p > MOST_P {
            return Err(DoseRefusal::NoEffect { p });
        }
        let hill = curve[3].exp();
        if !(HILL[0]..=HILL[1]).contains(&hill) {
            return Err(DoseRefusal::NoSlope { hill });
        }
        let normal: Matrix4<f64> = points.iter().map(|&[dose, _]| slopes(dose, &curve)).map(|s| s * s.transpose()).sum();
        let covariance = inverse(&normal).ok_or(DoseRefusal::Undetermined)? * (rest / degrees);
        let t = student(degrees).ok_or(DoseRefusal::FewValues { values: n })?;
        let parameter = |value: f64, sd: f64| Parameter { value, sd, interval_95: [value - t * sd, value + t * sd] };
        let sd = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let log10_ec50 = parameter(curve[2] / LN_10, sd(2) / LN_10);
        let ec50 = curve[2].exp();
        Ok(Self {
            n,
            doses: doses.len(),
            at_zero: parameter(curve[0], sd(0)),
            at_infinity: parameter(curve[1], sd(1)),
            log10_ec50,
            hill: parameter(hill, sd(3) * hill),
            ec50,
            ec50_interval_95: log10_ec50.interval_95.map(|log| 10f64.powf(log)),
            ec50_is_within_doses: doses.iter().any(|&d| d > 0.0 && d <= ec50) && doses.iter().any(|&d| d >= ec50),
            residual_sd: (rest / degrees).sqrt(),
            p_no_effect: p,
            covariance: covariance.into(),
        })
    }

    /// The mean response at a dose, by the curve, with the standard deviation and the interval that follow from those of its parameters.
    /// The interval is pointwise: it is that of one dose, not of the whole curve. `None` for a curve of too few values.
    pub fn at(&self, dose: f64) -> Option<Parameter> {
        let curve = Vector4::new(self.at_zero.value, self.at_infinity.value, self.ec50.ln(), self.hill.value.ln());
        let slopes = slopes(dose, &curve);
        let sd = (slopes.transpose() * Matrix4::from(self.covariance) * slopes)[0].max(0.0).sqrt();
        let t = student(self.n.checked_sub(PARAMETERS)? as f64)?;
        let value = value(dose, &curve);
        Some(Parameter { value, sd, interval_95: [value - t * sd, value + t * sd] })
    }
}

/// The different doses, in rising order.
fn checked(points: &[[f64; 2]]) -> Result<Vec<f64>, DoseRefusal> {
    if let Some(&[dose, response]) = points.iter().find(|[dose, y]| !(dose.is_finite() && *dose >= 0.0 && y.is_finite())) {
        return Err(DoseRefusal::NotFinite { dose, response });
    }
    if points.len() < LEAST_VALUES {
        return Err(DoseRefusal::FewValues { values: points.len() });
    }
    let mut doses: Vec<f64> = points.iter().map(|p| p[0]).collect();
    doses.sort_by(f64::total_cmp);
    doses.dedup();
    let above_zero = doses.iter().filter(|&&d| d > 0.0).count();
    if doses.len() < LEAST_DOSES || above_zero < LEAST_ABOVE_ZERO {
        return Err(DoseRefusal::FewDoses { doses: doses.len(), above_zero });
    }
    Ok(doses)
}

/// The best curve of a grid of shapes. `None` where no shape determines a and b.
fn coarse(points: &[[f64; 2]], doses: &[f64]) -> Option<Curve> {
    let least = doses.iter().copied().find(|&d| d > 0.0)?.ln() - LN_10;
    let most = doses.last()?.ln() + LN_10;
    let steps = |[low, high]: [f64; 2], n: usize| (0..=n).map(move |i| low + (high - low) * i as f64 / n as f64);
    let shapes = steps([least, most], GRID[0]).flat_map(|l| steps(HILL.map(f64::ln), GRID[1]).map(move |h| [l, h]));
    let fitted = shapes.filter_map(|shape| {
        let curve = linear(points, shape)?;
        Some((misfit(points, &curve), curve))
    });
    fitted.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, curve)| curve)
}

/// The curve of this shape with the best a and b.
fn linear(points: &[[f64; 2]], shape: Shape) -> Option<Curve> {
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for &[dose, y] in points {
        let s = share(dose, shape);
        let row = Vector2::new(1.0 - s, s);
        normal += row * row.transpose();
        right += row * y;
    }
    // Shapes that are flat over all doses do not determine a and b.
    let found = normal.cholesky().filter(|_| normal.determinant() > 1e-9)?.solve(&right);
    Some(Vector4::new(found[0], found[1], shape[0], shape[1]))
}

/// Levenberg-Marquardt from a curve, until the sum of squares does not fall any more.
fn polished(points: &[[f64; 2]], start: Curve) -> Curve {
    let (mut curve, mut best, mut damping) = (start, misfit(points, &start), 1e-3);
    for _ in 0..PASSES {
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for &[dose, y] in points {
            let row = slopes(dose, &curve);
            normal += row * row.transpose();
            right += row * (y - value(dose, &curve));
        }
        let held = normal + Matrix4::from_diagonal(&(normal.diagonal() * damping).add_scalar(f64::MIN_POSITIVE));
        let Some(step) = held.cholesky().map(|solver| solver.solve(&right)) else { break };
        let next = curve + step;
        let found = misfit(points, &next);
        if found.is_finite() && found <= best {
            let fell = best - found;
            (curve, best, damping) = (next, found, damping / 10.0);
            if fell <= 1e-15 * best {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    curve
}

/// The inverse of the normal matrix, scaled to a unit diagonal first: volumes and logarithms differ by ten powers of ten. `None` where it is
/// singular to rounding.
fn inverse(normal: &Matrix4<f64>) -> Option<Matrix4<f64>> {
    let scale = normal.diagonal().map(|d| 1.0 / d.sqrt());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scale = Matrix4::from_diagonal(&scale);
    let scaled = scale * normal * scale;
    let least = scaled.symmetric_eigenvalues().min();
    (least > 1e-12).then(|| scaled.try_inverse()).flatten().map(|inverse| scale * inverse * scale)
}

/// Probability that values without an effect are fitted so well: F test of the curve against the mean.
fn p_no_effect(points: &[[f64; 2]], rest: f64, degrees: f64) -> f64 {
    let mean = points.iter().map(|p| p[1]).sum::<f64>() / points.len() as f64;
    let total: f64 = points.iter().map(|p| (p[1] - mean).powi(2)).sum();
    if total <= 0.0 {
        return 1.0;
    }
    let parameters = (PARAMETERS - 1) as f64;
    let f = ((total - rest) / parameters) / (rest / degrees);
    if !f.is_finite() {
        // A curve without residuals.
        return 0.0;
    }
    FisherSnedecor::new(parameters, degrees).map_or(1.0, |d| d.sf(f.max(0.0)))
}

#[cfg(test)]
mod tests;
