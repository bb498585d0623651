//! What keeps one wrong edge from moving a fit.

/// Standard deviations from which a residual counts in proportion instead of squared: 95 % as good as least squares where all
/// is well (Huber).
const KNEE: f64 = 1.345;

/// Weight of a residual that is so many standard deviations long.
pub(crate) fn huber(deviations: f64) -> f64 {
    if deviations.abs() <= KNEE { 1.0 } else { KNEE / deviations.abs() }
}

/// The median of magnitudes as a standard deviation.
pub(crate) fn mad_sd(values: &[f64]) -> f64 {
    1.4826 * median(values.iter().map(|v| v.abs()).collect())
}

/// 0 of none.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
