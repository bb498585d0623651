//! Statistics of samples, and fits that are robust against single wrong values.
//!
//! ```text
//!   values ── mean, sd, median, quantiles       (day, value) ── straight line
//!   rows, values ── least squares ── residuals ── weights by Huber ─┐
//!                        ▲──────────────────────────────────────────┘
//! ```
//! Quantiles differ in the value that they take where the share falls between two values. Each rule has one function, whose name says
//! which: [`lower_quantile`], [`upper_quantile`] and [`median`], which is the mean of both at a half. The many grey values of a frame
//! have their own selection, of the nearest rank (`profile/raster/plane.rs`), which writes over its input.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// The mean. 0 without values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The value of this rank in the sorted values, or the last one. `None` without values.
fn of_rank(mut values: Vec<f64>, rank: usize) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    Some(*values.select_nth_unstable_by(rank.min(last), f64::total_cmp).1)
}

/// The value at `share` (0 to 1) of the sorted values; between two of them the lower one. `None` without values.
pub fn lower_quantile(values: Vec<f64>, share: f64) -> Option<f64> {
    let rank = share * values.len().saturating_sub(1) as f64;
    of_rank(values, rank as usize)
}

/// The value at `share` (0 to 1) of the sorted values, each of which takes the same share; between two of them the upper one. `None`
/// without values.
pub fn upper_quantile(values: Vec<f64>, share: f64) -> Option<f64> {
    let rank = share * values.len() as f64;
    of_rank(values, rank as usize)
}

/// The median; of an even number of values the mean of the middle two, as in numpy. `None` without values.
pub fn median(values: Vec<f64>) -> Option<f64> {
    let lower = lower_quantile(values.clone(), 0.5)?;
    Some(f64::midpoint(lower, upper_quantile(values, 0.5)?))
}

/// The median; of an even number of values the upper one of the middle two. 0 without values.
pub fn upper_median(values: Vec<f64>) -> f64 {
    upper_quantile(values, 0.5).unwrap_or(0.0)
}

/// The median of the magnitudes, scaled to a standard deviation.
pub(crate) fn mad_sd(values: &[f64]) -> f64 {
    1.4826 * upper_median(values.iter().map(|v| v.abs()).collect())
}

/// Number, mean and standard deviation (divisor n - 1) of values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Number of values.
    pub n: usize,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation. `None` of a single value.
    pub sd: Option<f64>,
}

impl Spread {
    /// The statistics of `values`. `None` without any.
    pub fn of(values: &[f64]) -> Option<Self> {
        let n = values.len();
        let mean = (n > 0).then(|| mean(values))?;
        let sd = (n > 1).then(|| (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n as f64 - 1.0)).sqrt());
        Some(Self { n, mean, sd })
    }

    /// Standard deviation of the mean. `None` of a single value.
    pub fn sd_of_mean(&self) -> Option<f64> {
        self.sd.map(|sd| sd / (self.n as f64).sqrt())
    }
}

/// A straight line fitted to points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Slope of the line, unit of the values per unit of the places.
    pub slope: f64,
    /// Standard deviation of the slope, from the scatter about the line. `None` with two points.
    pub slope_sd: Option<f64>,
}

impl Line {
    /// The line through points, each (place, value), by least squares. `None` where all points are at one place.
    pub fn through(points: &[[f64; 2]]) -> Option<Self> {
        let n = points.len() as f64;
        let mean = [0, 1].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / n);
        let squares: f64 = points.iter().map(|[at, _]| (at - mean[0]).powi(2)).sum();
        // Without points it is 0, too.
        if squares <= 0.0 {
            return None;
        }
        let slope = points.iter().map(|[at, value]| (at - mean[0]) * (value - mean[1])).sum::<f64>() / squares;
        let misfit: f64 = points.iter().map(|[at, value]| (value - mean[1] - slope * (at - mean[0])).powi(2)).sum();
        let slope_sd = (points.len() > 2).then(|| (misfit / (n - 2.0) / squares).sqrt());
        Some(Self { slope, slope_sd })
    }
}

/// Residual, in standard deviations, beyond which it counts linearly instead of squared. For normally distributed values the
/// fit has 95 % of the efficiency of least squares (Huber).
const KNEE: f64 = 1.345;

/// Weight of a residual of this many standard deviations.
pub(crate) fn huber(deviations: f64) -> f64 {
    if deviations.abs() <= KNEE { 1.0 } else { KNEE / deviations.abs() }
}

/// The coefficients whose sums over the rows are nearest to the values, by weighted least squares. Each row comes with its
/// value and weight. `held` is added to the normal equations. `None` where the rows do not determine all coefficients.
pub(crate) fn fit<const N: usize>(
    rows: impl IntoIterator<Item = (SVector<f64, N>, f64, f64)>,
    held: SMatrix<f64, N, N>,
) -> Option<SVector<f64, N>> {
    let (mut normal, mut right) = (held, SVector::zeros());
    for (row, value, weight) in rows {
        normal += weight * row * row.transpose();
        right += weight * value * row;
    }
    Some(normal.cholesky()?.solve(&right))
}

/// The same, repeated, each time with Huber's weights of the previous residuals. The scatter is taken as `sd_least` at least.
pub(crate) fn fit_robust<const N: usize>(
    rows: &[(SVector<f64, N>, f64)],
    held: SMatrix<f64, N, N>,
    times: usize,
    sd_least: f64,
) -> Option<SVector<f64, N>> {
    let mut weights = vec![1.0; rows.len()];
    let mut found = None;
    for _ in 0..times {
        let solved = fit(rows.iter().zip(&weights).map(|(&(row, value), &weight)| (row, value, weight)), held)?;
        let left: Vec<f64> = rows.iter().map(|(row, value)| value - row.dot(&solved)).collect();
        let sd = mad_sd(&left).max(sd_least);
        weights = left.iter().map(|r| huber(r / sd)).collect();
        found = Some(solved);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    fn near(found: f64, wanted: f64) {
        assert!((found - wanted).abs() < 1e-9 * wanted.abs().max(1e-3), "{found} is not {wanted}");
    }

    #[test]
    fn a_sample_has_its_mean_spread_and_middle() {
        let spread = Spread::of(&[1.0, 2.0, 3.0, -6.0]).unwrap();
        near(spread.mean, 0.0);
        near(spread.sd.unwrap(), (50.0f64 / 3.0).sqrt());
        near(spread.sd_of_mean().unwrap(), (50.0f64 / 12.0).sqrt());
        assert_eq!((Spread::of(&[2.0]).unwrap().sd, Spread::of(&[])), (None, None));
        let four = vec![5.0, 1.0, 3.0, 4.0];
        near(upper_median(four.clone()), 4.0);
        near(median(four.clone()).unwrap(), 3.5);
        near(median(vec![5.0, 1.0, 3.0]).unwrap(), 3.0);
        assert_eq!((0.0, median(Vec::new())), (upper_median(Vec::new()), None));
        for (share, lower, upper) in [(0.0, 1.0, 1.0), (0.3, 1.0, 3.0), (0.5, 3.0, 4.0), (0.75, 4.0, 5.0), (1.0, 5.0, 5.0)] {
            near(lower_quantile(four.clone(), share).unwrap(), lower);
            near(upper_quantile(four.clone(), share).unwrap(), upper);
        }
        // Of 1, 2, 3 the middle; 9 moves nothing.
        near(mad_sd(&[-1.0, 3.0, -9.0, 2.0, -2.0]), 1.4826 * 2.0);
        near(mean(&[]), 0.0);
    }

    // numpy.polyfit([0, 1, 3], [1, 2, 3], 1) gives 9 / 14; residuals' squares sum to 1 / 14 over squares of 14 / 3.
    #[test]
    fn a_line_has_its_slope_and_how_well_it_is_known() {
        let line = Line::through(&[[0.0, 1.0], [1.0, 2.0], [3.0, 3.0]]).unwrap();
        near(line.slope, 9.0 / 14.0);
        near(line.slope_sd.unwrap(), (1.0_f64 / 14.0 / (14.0 / 3.0)).sqrt());
        assert_eq!(Line::through(&[[2.0, 1.0], [2.0, 5.0]]), None);
        assert_eq!(Line::through(&[]), None);
        assert_eq!(Line::through(&[[0.0, 1.0], [2.0, 5.0]]), Some(Line { slope: 2.0, slope_sd: None }));
    }

    /// 3 + 2 t, with one of 20 values 100 off: least squares takes on a twentieth of it and more, the robust fit next to nothing.
    #[test]
    fn one_wrong_value_does_not_move_a_robust_fit() {
        let rows: Vec<(Vector2<f64>, f64)> =
            (0..20).map(|i| (Vector2::new(1.0, f64::from(i)), 3.0 + 2.0 * f64::from(i) + if i == 4 { 100.0 } else { 0.0 })).collect();
        let plain = fit(rows.iter().map(|&(row, value)| (row, value, 1.0)), Matrix2::zeros()).unwrap();
        let robust = fit_robust(&rows, Matrix2::zeros(), 6, 0.01).unwrap();
        assert!((plain[0] - 3.0).abs() > 5.0, "{plain}");
        assert!((robust - Vector2::new(3.0, 2.0)).norm() < 0.1, "{robust}");
        // A value alone tells no line, unless something holds it.
        assert!(fit_robust(&rows[..1], Matrix2::zeros(), 2, 0.01).is_none());
        assert!(fit_robust(&rows[..1], Matrix2::identity(), 2, 0.01).is_some());
    }
}
