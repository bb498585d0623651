//! What errors of the edges add to the area of a slice: variances of its coefficients, from the residuals of its own views.
//!
//! ```text
//!   area = pi (a0^2 - sum_k loss(k) / 2 (a_k^2 + b_k^2))      on average too small by pi sum_k loss(k) / 2 (var a_k + var b_k) - pi var a0
//!   var = sigma^2 (B' W B)^-1                                 sigma^2: mean square of the noise
//!   residual = noise + side g(theta) + further harmonics      side: +1 lower edge, -1 upper edge
//! ```
//! `g` is what lower and upper edges do in opposite ways: a ray that is turned, a wrong tilt, a blurred edge that is found too high. It is a
//! smooth function of the direction and no noise. Where lower and upper edges alternate along theta, as for an odd number of views, it is
//! hardly in the series; where they coincide, it cancels. Further harmonics are those of corners. Both are fitted and not counted.

use super::sections::Section;
use super::smoothing::Smoother;
use crate::calibration::{Fit, Slice, basis};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Harmonics of `g`, and of the slice beyond its series, at most. More would leave too few residuals that are noise.
const OPPOSITE: usize = 4;
const FURTHER: usize = 4;
/// Fewest residuals that are left for the noise.
const FREE_LEAST: usize = 4;

/// What errors of the edges add to the area of slice `at` on average, um^2. It is negative: spurious harmonics enclose less. `directions` is the
/// number of directions from which the views see edges.
pub(super) fn area_bias_um2(section: &Section, smoother: &Smoother, found: &[(Slice, Fit)], at: usize, directions: usize) -> f64 {
    let (slice, fit) = &found[at];
    let residuals = smoother.residuals(section, found, slice);
    let Some(square_um2) = mean_square_um2(&residuals, slice, fit, directions) else { return 0.0 };
    let corners = section.corners();
    let inverse = fit.normal.inverse();
    let gain = |i: usize| if i == 0 { 1.0 } else { -corners.area_loss(i.div_ceil(2)) / 2.0 };
    // A robust fit follows an error by its weight as long as it is small, and no further beyond. `normal` counts every edge by its weight.
    let share = |of: &dyn Fn(f64) -> f64| fit.weights.iter().map(|weight| of(*weight)).sum::<f64>() / fit.weights.len() as f64;
    let (mean, small) = (share(&|weight| weight), share(&|weight| f64::from(u8::from(weight >= 1.0))));
    let robust = mean / small.max(SMALL_LEAST).powi(2);
    PI * square_um2 * robust * inverse.diagonal().iter().enumerate().map(|(i, variance)| gain(i) * variance).sum::<f64>()
}

/// Least share of edges with small errors. With fewer the fit is no longer nearly linear.
const SMALL_LEAST: f64 = 0.5;

/// Mean square of the errors of a slice's edges, each by its weight, um^2. `None` where the series takes up all of them.
fn mean_square_um2(residuals: &[f64], slice: &Slice, fit: &Fit, directions: usize) -> Option<f64> {
    let (edges, size) = (residuals.len(), fit.support.coefficients.len());
    let free = edges.checked_sub(size).filter(|free| *free > 0)?;
    // A whole number of harmonics, beside the mean.
    let opposite = free.saturating_sub(FREE_LEAST).min(2 * OPPOSITE + 1).min(size);
    let opposite = if opposite == 0 { 0 } else { (opposite - 1) / 2 * 2 + 1 };
    // A quarter of all edges is left, and no harmonic is fitted that the directions do not tell from a lower one.
    let further = (3 * edges / 4).saturating_sub(size + opposite).min(directions.saturating_sub(size + 1)) / 2;
    let further = further.min(FURTHER);
    let mut all = vec![0.0; size + 2 * further];
    let mut columns = DMatrix::zeros(edges, opposite + 2 * further);
    for (n, sight) in slice.sights.iter().enumerate() {
        basis(sight.tangent.theta, &mut all);
        (0..opposite).for_each(|k| columns[(n, k)] = sight.side.sign() * all[k]);
        (0..2 * further).for_each(|k| columns[(n, opposite + k)] = all[size + k]);
    }
    // The residuals have no part of the series; what the series explains of the columns is taken off these.
    let series = DMatrix::from_row_slice(edges, size, &fit.rows);
    let mixed = series.tr_mul(&columns);
    let own = columns.tr_mul(&columns) - mixed.tr_mul(&series.tr_mul(&series).cholesky()?.solve(&mixed));
    let right = columns.tr_mul(&DVector::from_column_slice(residuals));
    let total: f64 = residuals.iter().map(|r| r * r).sum();
    let (explained, taken) = own.cholesky().map_or((0.0, 0), |own| (right.dot(&own.solve(&right)), columns.ncols()));
    Some((total - explained).max(0.0) / (free - taken) as f64)
}
