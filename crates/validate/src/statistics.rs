//! Statistics of many phantoms.

use carved_core::statistics::Spread;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Statistics of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    pub n: usize,
    pub mean: f64,
    /// With n - 1; 0 for a single value.
    pub sd: f64,
    /// The value farthest from 0.
    pub worst: f64,
}

impl Summary {
    pub fn of(values: &[f64]) -> Self {
        let Spread { n, mean, sd } = Spread::of(values).unwrap_or(Spread { n: 0, mean: 0.0, sd: None });
        let worst = values.iter().copied().fold(0.0, |worst: f64, v| if v.abs() > worst.abs() { v } else { worst });
        Self { n, mean, sd: sd.unwrap_or(0.0), worst }
    }

    /// Formats as mean ± sd, worst.
    pub fn signed(&self, digits: usize) -> String {
        let Self { mean, sd, worst, .. } = self;
        format!("{mean:+.digits$} ± {sd:.digits$}, worst {worst:+.digits$}")
    }
}

/// Share of the values that lie within `most` of 0, per cent.
pub fn share_within(values: &[f64], most: f64) -> f64 {
    100.0 * values.iter().filter(|v| v.abs() <= most).count() as f64 / values.len().max(1) as f64
}

/// Two-sided quantile of Student's t.
pub fn student(confidence: f64, degrees: usize) -> f64 {
    StudentsT::new(0.0, 1.0, degrees.max(1) as f64).map_or(f64::NAN, |t| t.inverse_cdf(0.5 + confidence / 2.0))
}

/// Variances and covariance of pairs, with n - 1: of the first, of the second, of both.
pub fn covariance(pairs: &[[f64; 2]]) -> [f64; 3] {
    let n = pairs.len();
    let mean = [0, 1].map(|i| pairs.iter().map(|p| p[i]).sum::<f64>() / n.max(1) as f64);
    let of =
        |i: usize, j: usize| pairs.iter().map(|p| (p[i] - mean[i]) * (p[j] - mean[j])).sum::<f64>() / n.saturating_sub(1).max(1) as f64;
    [of(0, 0), of(1, 1), of(0, 1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_of_four() {
        let s = Summary::of(&[1.0, 2.0, 3.0, -6.0]);
        assert!(
            s.n == 4 && s.mean.abs() < 1e-12 && (s.sd - (50.0f64 / 3.0).sqrt()).abs() < 1e-12 && (s.worst + 6.0).abs() < 1e-12,
            "{s:?}"
        );
        assert!((share_within(&[0.5, -0.5, 2.0, 3.0], 0.5) - 50.0).abs() < 1e-12);
        let [a, b, c] = covariance(&[[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]]);
        assert!((a - 1.0).abs() < 1e-12 && (b - 4.0).abs() < 1e-12 && (c - 2.0).abs() < 1e-12);
    }

    /// The paper's 2.787 is that of 25 degrees of freedom, but 25 beads have 24.
    #[test]
    fn students_t_of_25_beads() {
        assert!((student(0.99, 24) - 2.797).abs() < 5e-4 && (student(0.99, 25) - 2.787).abs() < 5e-4);
        assert!((student(0.95, 20) - 2.086).abs() < 5e-4);
    }
}
