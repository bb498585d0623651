//! A bounded search for the least value of a function: what its two methods share.
//!
//! ```text
//!   Reach per unknown ── simplex: few unknowns, few evaluations ──┬── Minimum
//!                     └─ cma: many, or a bumpy function ──────────┘
//! ```
//! Both work in steps: an unknown that is 0 at its start and 1 a first step from it, whatever its unit.

/// One unknown: where the search begins, how far it may go, and the length of a first step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reach {
    pub start: f64,
    pub low: f64,
    pub high: f64,
    pub step: f64,
}

impl Reach {
    /// As far up as down.
    pub fn about(start: f64, far: f64, step: f64) -> Self {
        Self { start, low: start - far, high: start + far, step }
    }

    fn value(&self, steps: f64) -> f64 {
        (self.start + steps * self.step).clamp(self.low, self.high)
    }

    /// Steps to the nearer end.
    pub(super) fn room(&self, steps: f64) -> f64 {
        let [low, high] = self.ends();
        (high - steps).min(steps - low)
    }

    fn ends(&self) -> [f64; 2] {
        [(self.low - self.start) / self.step, (self.high - self.start) / self.step]
    }

    /// The nearest place within reach, in steps.
    pub(super) fn within(&self, steps: f64) -> f64 {
        let [low, high] = self.ends();
        steps.clamp(low, high)
    }
}

/// When a search ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    pub evaluations: usize,
    /// What is still looked at lies within this share of a first step.
    pub share: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Minimum {
    pub at: Vec<f64>,
    pub value: f64,
    pub evaluations: usize,
    /// Within the share of a step, rather than out of evaluations.
    pub converged: bool,
}

/// A function of steps that counts its evaluations and keeps the best.
pub(super) struct Counted<'a, F> {
    pub reach: &'a [Reach],
    function: F,
    best: (Vec<f64>, f64),
    pub evaluations: usize,
}

impl<'a, F: FnMut(&[f64]) -> f64> Counted<'a, F> {
    pub fn new(reach: &'a [Reach], function: F) -> Self {
        Self { reach, function, best: (reach.iter().map(|r| r.value(0.0)).collect(), f64::INFINITY), evaluations: 0 }
    }

    /// What is no number is as bad as can be.
    pub fn at(&mut self, steps: &[f64]) -> f64 {
        let at: Vec<f64> = self.reach.iter().zip(steps).map(|(r, &s)| r.value(s)).collect();
        let value = (self.function)(&at);
        let value = if value.is_nan() { f64::INFINITY } else { value };
        self.evaluations += 1;
        if value < self.best.1 {
            self.best = (at, value);
        }
        value
    }

    pub fn found(self, converged: bool) -> Minimum {
        Minimum { at: self.best.0, value: self.best.1, evaluations: self.evaluations, converged }
    }
}

/// Functions that every method must get to the bottom of.
#[cfg(test)]
pub(super) mod bowls {
    use super::Reach;

    pub fn box_of(starts: &[f64], far: f64) -> Vec<Reach> {
        starts.iter().map(|&start| Reach { start, low: -far, high: far, step: 0.5 }).collect()
    }

    pub fn rosenbrock(x: &[f64]) -> f64 {
        x.windows(2).map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2)).sum()
    }

    /// Half axes from 1 to 1 / sqrt(condition), none of them along a coordinate; least, 0, where every coordinate is 0.7.
    pub fn ellipsoid(x: &[f64], condition: f64) -> f64 {
        let n = x.len();
        let off = nalgebra::DVector::from_iterator(n, x.iter().map(|v| v - 0.7));
        // The eigenvectors of a path: a rotation that mixes all coordinates.
        let along = |k: usize| {
            let wave = |i: usize| (std::f64::consts::PI * ((i + 1) * (k + 1)) as f64 / (n + 1) as f64).sin();
            nalgebra::DVector::from_fn(n, |i, _| wave(i)).normalize().dot(&off)
        };
        (0..n).map(|k| condition.powf(k as f64 / (n - 1) as f64) * along(k).powi(2)).sum()
    }

    /// Least, 0, at (1, 0.3): for a box of 1 that is on its upper side in the first coordinate, where the slope is not 0.
    pub fn beyond_the_bound(x: &[f64]) -> f64 {
        (x[0] - 3.0).powi(2) - 4.0 + (x[1] - 0.3).powi(2) + 0.5 * (x[0] - 1.0) * (x[1] - 0.3)
    }
}
