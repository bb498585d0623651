//! Functions that combine evidence into probabilities, 0 to 1.

/// The logistic function of a threshold: 0.5 at `mid`, 0.9 at `width` above it, 0.1 at `width` below.
pub(in crate::profile) fn logistic(x: f64, mid: f64, width: f64) -> f64 {
    1.0 / (1.0 + (-(x - mid) / width * 9f64.ln()).exp())
}

/// The probability that at least one of several independent conditions holds.
pub(in crate::profile) fn noisy_or(of: impl IntoIterator<Item = f64>) -> f64 {
    1.0 - of.into_iter().map(|p| 1.0 - p).product::<f64>()
}
