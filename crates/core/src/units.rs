//! Units as types, where a mix-up would turn a motor or spoil a number.
//!
//! Angles are `f64` in radians (`omega`), as in the formulas. Names of lengths end in `_um`.

use crate::range::Numbers;
use serde::{Deserialize, Serialize};

/// A position of a stepper axis, counted in whole motor steps from the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(transparent)]
pub struct Steps(pub i64);

impl std::ops::Add for Steps {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl std::fmt::Display for Steps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} steps", self.0)
    }
}

/// Motor steps of one revolution of the capillary, as the exact ratio `num / den` (microsteps times gear), never a float.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(try_from = "[u32; 2]", into = "[u32; 2]")]
pub struct StepsPerRevolution {
    num: u32,
    den: u32,
}

/// Why a ratio is not a number of steps per revolution.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("steps_per_revolution is [{num}, {den}]; both numbers must be at least 1")]
pub struct BadStepsPerRevolution {
    num: u32,
    den: u32,
}

impl StepsPerRevolution {
    /// The ratio `num / den`.
    ///
    /// # Errors
    /// A zero on either side of the ratio.
    pub fn new(num: u32, den: u32) -> Result<Self, BadStepsPerRevolution> {
        if num == 0 || den == 0 {
            return Err(BadStepsPerRevolution { num, den });
        }
        Ok(Self { num, den })
    }

    /// The step nearest to the fraction `part / of` of one revolution. Rounding each absolute target is off by at most half a
    /// step and closes the turn; rounding relative moves does not.
    pub fn nearest(self, part: u32, of: u32) -> Steps {
        let (num, den) = (i128::from(self.num) * i128::from(part), i128::from(self.den) * i128::from(of));
        Steps(((2 * num + den).div_euclid(2 * den)) as i64)
    }

    /// The angle by which `steps` steps turn the capillary, rad; positive for positive steps.
    pub fn angle(self, steps: Steps) -> f64 {
        std::f64::consts::TAU * steps.0 as f64 * f64::from(self.den) / f64::from(self.num)
    }
}

/// The direction in which positive motor steps turn the capillary: `1` moves the near wall to larger v, `-1` to smaller.
/// Silhouettes cannot show it, so it is verified once per rig with a marked capillary and then configured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(extend("enum" = [1, -1])))]
#[serde(try_from = "i8", into = "i8")]
pub enum Sense {
    /// Positive steps move the near wall to larger v.
    #[default]
    Positive,
    /// Positive steps move the near wall to smaller v.
    Negative,
}

/// A sense of rotation that is neither 1 nor -1.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("sense is {0}; it must be 1 or -1")]
pub struct BadSense(i8);

impl Sense {
    /// `1` or `-1`.
    pub fn sign(self) -> f64 {
        f64::from(i8::from(self))
    }

    /// The angle omega of the view taken at position `steps`, rad.
    pub fn omega(self, steps: Steps, per_revolution: StepsPerRevolution) -> f64 {
        match self {
            Self::Positive => per_revolution.angle(steps),
            // 0 - x instead of -x: the first view's angle is 0, never -0.
            Self::Negative => 0.0 - per_revolution.angle(steps),
        }
    }
}

impl TryFrom<i8> for Sense {
    type Error = BadSense;
    fn try_from(sign: i8) -> Result<Self, BadSense> {
        match sign {
            1 => Ok(Self::Positive),
            -1 => Ok(Self::Negative),
            other => Err(BadSense(other)),
        }
    }
}

impl From<Sense> for i8 {
    fn from(s: Sense) -> Self {
        match s {
            Sense::Positive => 1,
            Sense::Negative => -1,
        }
    }
}

impl TryFrom<[u32; 2]> for StepsPerRevolution {
    type Error = BadStepsPerRevolution;
    fn try_from([num, den]: [u32; 2]) -> Result<Self, Self::Error> {
        Self::new(num, den)
    }
}

impl Numbers for StepsPerRevolution {
    fn numbers(&self) -> Vec<f64> {
        [self.num, self.den].numbers()
    }
}

impl From<StepsPerRevolution> for [u32; 2] {
    fn from(s: StepsPerRevolution) -> Self {
        [s.num, s.den]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absolute_targets_err_by_at_most_half_a_step_and_close_the_turn() {
        let spr = StepsPerRevolution::new(500, 1).unwrap();
        for of in [4, 7, 12, 14, 21, 28, 42, 84] {
            for part in 0..=of {
                let exact = 500.0 * f64::from(part) / f64::from(of);
                assert!((spr.nearest(part, of).0 as f64 - exact).abs() <= 0.5, "{part}/{of}");
            }
            assert_eq!(spr.nearest(of, of), Steps(500));
        }
    }

    #[test]
    fn a_gear_ratio_stays_exact_over_many_turns() {
        let spr = StepsPerRevolution::new(64_000, 3).unwrap();
        assert_eq!(spr.nearest(3, 1), Steps(64_000));
        assert!((spr.angle(Steps(64_000)) - 3.0 * std::f64::consts::TAU).abs() < 1e-12);
        assert!(StepsPerRevolution::new(500, 0).is_err());
    }

    #[test]
    fn the_sense_turns_the_sign_of_omega_and_nothing_else_is_a_sense() {
        let spr = StepsPerRevolution::new(500, 1).unwrap();
        assert!((Sense::Negative.omega(Steps(125), spr) + std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!(Sense::Negative.omega(Steps(0), spr).is_sign_positive());
        assert_eq!(Sense::try_from(0), Err(BadSense(0)));
    }
}
