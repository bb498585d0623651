//! A bounded search for the least value of a function: ranges of its unknowns, its end and its result.
//!
//! ```text
//!   Reach per unknown ── simplex ── Minimum
//! ```
//! The search works in steps: an unknown is 0 at its start and 1 a first step from it, whatever its unit.

/// The range of one unknown: start, bounds and length of a first step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reach {
    pub start: f64,
    pub low: f64,
    pub high: f64,
    pub step: f64,
}

impl Reach {
    /// A range that is as far up as down.
    pub fn about(start: f64, far: f64, step: f64) -> Self {
        Self { start, low: start - far, high: start + far, step }
    }

    fn value(&self, steps: f64) -> f64 {
        (self.start + steps * self.step).clamp(self.low, self.high)
    }

    /// Steps to the nearer bound.
    pub(super) fn room(&self, steps: f64) -> f64 {
        let [low, high] = self.ends();
        (high - steps).min(steps - low)
    }

    fn ends(&self) -> [f64; 2] {
        [(self.low - self.start) / self.step, (self.high - self.start) / self.step]
    }

    /// The nearest place within the bounds, in steps.
    pub(super) fn within(&self, steps: f64) -> f64 {
        let [low, high] = self.ends();
        steps.clamp(low, high)
    }
}

/// When a search ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Most evaluations of the function.
    pub evaluations: usize,
    /// The search ends when it looks no further than this share of a first step.
    pub share: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Minimum {
    pub at: Vec<f64>,
    pub value: f64,
    pub evaluations: usize,
    /// Whether the search ended because its steps were small enough, and not because it ran out of evaluations.
    pub converged: bool,
}

/// A function of steps that counts its evaluations and keeps the best one.
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

    /// A value that is no number counts as infinite.
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

/// Functions whose minimum the search must find.
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
