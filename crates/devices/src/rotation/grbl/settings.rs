//! The `[rotation]` table of a Grbl controller.

use crate::DeviceError;
use crate::rotation::{Port, Reference};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How a Grbl controller is connected, and the settings that it must have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GrblSettings {
    /// Serial port, by its name or by its USB adapter's serial number.
    pub port: Port,
    /// Baud; Grbl 1.1 speaks 115200.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// The axis that turns the capillary.
    #[serde(default)]
    pub axis: AxisLetter,
    /// Motor steps per controller unit ($100 for X) as an exact ratio `[num, den]`, at most 400. The controller reports thousandths of
    /// a unit, which must resolve a step.
    pub steps_per_unit: [u32; 2],
    /// Speed of every turn, units/min. The controller must allow it ($110 for X).
    pub max_rate_units_per_min: f64,
    /// Acceleration the controller must reach, units/s^2 ($120 for X). Deadlines are computed from it.
    pub acceleration_units_per_s2: f64,
    /// How step 0 is found.
    pub reference: Reference,
    /// The expected firmware; any of both if left out.
    #[serde(default)]
    pub dialect: Dialect,
    /// Longest wait for the answer to a line, ms.
    #[serde(default = "default_answer_timeout_ms")]
    pub answer_timeout_ms: u32,
    /// Longest homing cycle, ms.
    #[serde(default = "default_homing_timeout_ms")]
    pub homing_timeout_ms: u32,
}

fn default_baud() -> u32 {
    115_200
}

fn default_answer_timeout_ms() -> u32 {
    1000
}

fn default_homing_timeout_ms() -> u32 {
    30_000
}

/// Grbl's axes in the order of its position reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum AxisLetter {
    #[default]
    /// First axis.
    X,
    /// Second axis.
    Y,
    /// Third axis.
    Z,
    /// Fourth axis; grblHAL only, as those after it.
    A,
    /// Fifth axis.
    B,
    /// Sixth axis.
    C,
}

impl AxisLetter {
    pub(super) fn index(self) -> u16 {
        self as u16
    }
}

/// The firmware of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Dialect {
    /// Grbl or grblHAL, by its greeting.
    #[default]
    Auto,
    /// Grbl 1.1.
    Grbl,
    /// grblHAL 1.1.
    GrblHal,
}

/// Largest number of steps per unit. Half a thousandth of a unit, the rounding of a report, is then a fifth of a step.
pub(super) const MOST_STEPS_PER_UNIT: f64 = 400.0;

impl GrblSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        let bad = |name, found: String, rule: &str| Err(DeviceError::Setting { device: super::DEVICE, name, found, rule: rule.into() });
        let [num, den] = self.steps_per_unit;
        if num == 0 || den == 0 || f64::from(num) / f64::from(den) > MOST_STEPS_PER_UNIT {
            return bad("steps_per_unit", format!("[{num}, {den}]"), "both numbers must be at least 1 and the ratio at most 400");
        }
        for (name, value) in
            [("max_rate_units_per_min", self.max_rate_units_per_min), ("acceleration_units_per_s2", self.acceleration_units_per_s2)]
        {
            if !(value.is_finite() && value > 0.0) {
                return bad(name, value.to_string(), "it must be above 0");
            }
        }
        for (name, value) in [("answer_timeout_ms", self.answer_timeout_ms), ("homing_timeout_ms", self.homing_timeout_ms)] {
            if value == 0 {
                return bad(name, value.to_string(), "it must be at least 1");
            }
        }
        Ok(())
    }

    pub(super) fn answer_timeout(&self) -> Duration {
        Duration::from_millis(self.answer_timeout_ms.into())
    }

    pub(super) fn homing_timeout(&self) -> Duration {
        Duration::from_millis(self.homing_timeout_ms.into())
    }
}
