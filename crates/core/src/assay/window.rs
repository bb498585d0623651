//! How far the controls of a plate are apart.

use super::Summary;
use serde::{Deserialize, Serialize};

/// The window between positive and negative controls.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// Z' = 1 - 3 (sd of the positive + sd of the negative) / |difference of the means|. 1 is ideal, above 0.5 an assay separates
    /// single wells well, below 0 the controls overlap (Zhang, Chung and Oldenburg, J. Biomol. Screen. 4, 67, 1999).
    pub z_prime: f64,
    /// Positive controls.
    pub positive: Summary,
    /// Negative controls.
    pub negative: Summary,
}

/// Why there is no Z'.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum WindowRefusal {
    /// Too few controls.
    #[error("{positive} positive and {negative} negative controls have this number; each needs at least {LEAST}")]
    Few {
        /// Positive controls with a number.
        positive: usize,
        /// Negative controls with a number.
        negative: usize,
    },
    /// The means are equal.
    #[error("positive and negative controls have the same mean, {mean}")]
    Equal {
        /// The mean.
        mean: f64,
    },
}

/// Least number of controls of a kind.
const LEAST: usize = 2;

impl Window {
    /// Compares the values of positive and negative controls.
    ///
    /// # Errors
    /// [`WindowRefusal`] where they do not determine Z'.
    pub fn of(positive: &[f64], negative: &[f64]) -> Result<Self, WindowRefusal> {
        let few = WindowRefusal::Few { positive: positive.len(), negative: negative.len() };
        let (p, n) = Summary::of(positive).zip(Summary::of(negative)).ok_or(few)?;
        let (sd_p, sd_n) = p.sd.zip(n.sd).ok_or(few)?;
        let apart = (p.mean - n.mean).abs();
        if apart <= 0.0 {
            return Err(WindowRefusal::Equal { mean: p.mean });
        }
        Ok(Self { z_prime: 1.0 - 3.0 * (sd_p + sd_n) / apart, positive: p, negative: n })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controls_have_the_z_prime_of_their_formula() {
        // Means 100 and 10, standard deviations 2 and 1: 1 - 3 x 3 / 90.
        let found = Window::of(&[98.0, 100.0, 102.0], &[9.0, 10.0, 11.0]).unwrap();
        assert!((found.z_prime - 0.9).abs() < 1e-12, "{found:?}");
        // The order of the two does not matter; controls that overlap have a negative one.
        let turned = Window::of(&[9.0, 10.0, 11.0], &[98.0, 100.0, 102.0]).unwrap();
        assert!((turned.z_prime - found.z_prime).abs() < 1e-12, "{turned:?}");
        assert!(Window::of(&[1.0, 5.0], &[2.0, 7.0]).unwrap().z_prime < 0.0);
    }

    #[test]
    fn controls_that_determine_nothing_are_refused_with_their_numbers() {
        assert_eq!(Window::of(&[1.0], &[2.0, 3.0]), Err(WindowRefusal::Few { positive: 1, negative: 2 }));
        assert_eq!(Window::of(&[], &[]), Err(WindowRefusal::Few { positive: 0, negative: 0 }));
        assert_eq!(Window::of(&[1.0, 3.0], &[2.0, 2.0]), Err(WindowRefusal::Equal { mean: 2.0 }));
    }
}
