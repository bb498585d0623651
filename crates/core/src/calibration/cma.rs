//! CMA-ES: an evolution strategy that adapts a covariance matrix, within bounds. The same seed gives the same search.
//!
//! ```text
//!   draw lambda points of N(mean, sigma^2 C) ─► put them within bounds ─► rank ─► mean of the better half
//!        ▲                                                                          │
//!        └──── C: path and spread of the steps taken ◄── sigma: length of their path ┘
//! ```
//! Source: Hansen, The CMA Evolution Strategy: A Tutorial (arXiv:1604.00772), with its standard constants and without the
//! negative update. A point beyond a bound is moved onto the bound, and the strategy learns from the moved point.

use super::search::{Counted, Minimum, Reach, Stop};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Searches for the least value of `function`.
pub(crate) fn minimise(reach: &[Reach], stop: Stop, seed: u64, function: impl FnMut(&[f64]) -> f64) -> Minimum {
    let mut function = Counted::new(reach, function);
    let mut draw = Normal(seed);
    let n = reach.len();
    let learn = Learning::new(n);
    let mut mean = DVector::zeros(n);
    let mut sigma = 1.0;
    let mut covariance = DMatrix::<f64>::identity(n, n);
    let (mut path, mut sigma_path) = (DVector::zeros(n), DVector::zeros(n));
    let mut generation = 0;
    loop {
        let eigen = covariance.clone().symmetric_eigen();
        // Rounding can make an eigenvalue of 0 negative.
        let axes = eigen.eigenvalues.map(|v| v.max(1e-30).sqrt());
        if sigma * axes.max() <= stop.share || !sigma.is_finite() {
            return function.found(sigma.is_finite());
        }
        if function.evaluations + learn.lambda > stop.evaluations {
            return function.found(false);
        }
        let mut drawn: Vec<(DVector<f64>, f64)> = (0..learn.lambda)
            .map(|_| {
                let z = DVector::from_fn(n, |i, _| axes[i] * draw.next());
                let at: DVector<f64> = &mean + sigma * (&eigen.eigenvectors * z);
                let at = DVector::from_fn(n, |i, _| reach[i].within(at[i]));
                let value = function.at(at.as_slice());
                ((at - &mean) / sigma, value)
            })
            .collect();
        drawn.sort_by(|a, b| a.1.total_cmp(&b.1));
        let step: DVector<f64> = drawn.iter().zip(&learn.weights).map(|((y, _), &w)| y * w).sum();
        mean += sigma * &step;
        generation += 1;

        let whitened = &eigen.eigenvectors * (eigen.eigenvectors.tr_mul(&step)).component_div(&axes);
        sigma_path = (1.0 - learn.c_sigma) * sigma_path + (learn.c_sigma * (2.0 - learn.c_sigma) * learn.mu_eff).sqrt() * whitened;
        let warmed = 1.0 - (1.0 - learn.c_sigma).powi(2 * generation);
        // A path that is long for its age says that sigma is too small; the covariance is not adapted until it has grown.
        let steady = sigma_path.norm() / warmed.sqrt() < (1.4 + 2.0 / (n as f64 + 1.0)) * learn.expected;
        let follow = f64::from(u8::from(steady));
        path = (1.0 - learn.c_path) * path + follow * (learn.c_path * (2.0 - learn.c_path) * learn.mu_eff).sqrt() * &step;
        let missed = (1.0 - follow) * learn.c_path * (2.0 - learn.c_path);
        covariance *= 1.0 - learn.c_1 - learn.c_mu + learn.c_1 * missed;
        covariance.ger(learn.c_1, &path, &path, 1.0);
        for ((y, _), weight) in drawn.iter().zip(&learn.weights) {
            covariance.ger(learn.c_mu * weight, y, y, 1.0);
        }
        sigma *= ((learn.c_sigma / learn.damping) * (sigma_path.norm() / learn.expected - 1.0)).min(1.0).exp();
    }
}

/// Constants of the tutorial's table 1, for positive weights.
struct Learning {
    lambda: usize,
    weights: Vec<f64>,
    mu_eff: f64,
    c_sigma: f64,
    damping: f64,
    c_path: f64,
    c_1: f64,
    c_mu: f64,
    /// Expected length of a standard normal vector.
    expected: f64,
}

impl Learning {
    fn new(n: usize) -> Self {
        let d = n as f64;
        let lambda = 4 + (3.0 * d.ln()).floor().max(0.0) as usize;
        let raw: Vec<f64> = (1..=lambda / 2).map(|i| (f64::midpoint(lambda as f64, 1.0)).ln() - (i as f64).ln()).collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|w| w / sum).collect();
        let mu_eff = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let c_sigma = (mu_eff + 2.0) / (d + mu_eff + 5.0);
        let c_1 = 2.0 / ((d + 1.3).powi(2) + mu_eff);
        Self {
            lambda,
            weights,
            mu_eff,
            c_sigma,
            damping: 1.0 + 2.0 * (((mu_eff - 1.0) / (d + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma,
            c_path: (4.0 + mu_eff / d) / (d + 4.0 + 2.0 * mu_eff / d),
            c_1,
            c_mu: (1.0 - c_1).min(2.0 * (mu_eff - 2.0 + 1.0 / mu_eff) / ((d + 2.0).powi(2) + mu_eff)),
            expected: d.sqrt() * (1.0 - 1.0 / (4.0 * d) + 1.0 / (21.0 * d * d)),
        }
    }
}

/// Standard normal numbers from a seed: a counter through a mixer (`SplitMix64`), then Box and Muller.
struct Normal(u64);

impl Normal {
    fn next(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }

    /// In `0..1`, 53 bits.
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::super::search::bowls::*;
    use super::*;

    const STOP: Stop = Stop { evaluations: 20_000, share: 1e-8 };

    #[test]
    fn it_follows_a_bent_valley() {
        let found = minimise(&box_of(&[-1.2, 1.0, -0.5, 0.3], 5.0), STOP, 1, rosenbrock);
        assert!(found.converged && found.evaluations < 4000, "{found:?}");
        assert!(found.at.iter().all(|x| (x - 1.0).abs() < 1e-5), "{found:?}");
    }

    #[test]
    fn it_learns_a_turned_ellipsoid_of_condition_1e6() {
        let found = minimise(&box_of(&[-1.0; 6], 5.0), STOP, 2, |x| ellipsoid(x, 1e6));
        // Without an adapted covariance it takes a hundred times as many.
        assert!(found.converged && found.evaluations < 6000, "{found:?}");
        assert!(found.at.iter().all(|x| (x - 0.7).abs() < 1e-5), "{found:?}");
    }

    #[test]
    fn a_minimum_on_a_bound_is_found_there_and_nothing_beyond_is_asked() {
        let found = minimise(&box_of(&[-0.5, -0.9], 1.0), STOP, 3, |x| {
            assert!(x.iter().all(|v| v.abs() <= 1.0), "{x:?}");
            beyond_the_bound(x)
        });
        assert!(found.converged && (found.at[0] - 1.0).abs() < 1e-9 && (found.at[1] - 0.3).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn a_seed_is_a_search() {
        let of = |seed: u64| minimise(&box_of(&[-1.2, 1.0], 5.0), Stop { evaluations: 60, share: 1e-8 }, seed, rosenbrock);
        assert_eq!(of(7), of(7));
        assert_ne!(of(7).at, of(8).at);
        assert!(of(7).evaluations <= 60 && !of(7).converged);
    }

    #[test]
    fn its_numbers_are_normal() {
        let mut draw = Normal(5);
        let numbers: Vec<f64> = (0..100_000).map(|_| draw.next()).collect();
        let moment = |k: i32| numbers.iter().map(|x| x.powi(k)).sum::<f64>() / numbers.len() as f64;
        // Four standard errors: of the mean 0.013, of the square 0.018, of the fourth power 0.12.
        assert!(moment(1).abs() < 0.013 && (moment(2) - 1.0).abs() < 0.018 && (moment(4) - 3.0).abs() < 0.125, "{}", moment(4));
    }
}
