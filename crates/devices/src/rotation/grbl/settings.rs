//! The `[rotation]` table of a Grbl controller.

use crate::DeviceError;
use crate::outputs::{self, OutputSettings, OutputTable, SETTLE_MOST_MS};
use crate::rotation::driver::serial_driver;
use crate::rotation::{Port, Reference};
use crate::setting::{ANSWER_MOST_MS, BAUD_LEAST, BAUD_MOST, HOMING_MOST_MS, in_range};
use carved_core::range::{OutOfRange, Range, Ranged};
use carved_core::ranges;
use serde::{Deserialize, Serialize};

/// How a Grbl controller is connected, and the settings that it must have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct GrblSettings {
    /// Serial port, by its name or by its USB adapter's serial number.
    pub port: Port,
    /// Speed of the serial line. Grbl 1.1 has 115200.
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
    /// The expected firmware. Any other greeting is refused.
    #[serde(default)]
    pub dialect: Dialect,
    /// Longest wait for the answer to a line, ms.
    #[serde(default = "default_answer_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub answer_timeout_ms: u32,
    /// Longest homing cycle, ms.
    #[serde(default = "default_homing_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub homing_timeout_ms: u32,
    /// Outputs that switch a light or a valve, by name: lower-case letters, digits and `_`.
    #[serde(default, skip_serializing_if = "OutputTable::is_empty")]
    pub outputs: OutputTable<GrblPin>,
}

/// An output of a Grbl controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum GrblPin {
    /// M7. Grbl 1.1 has it only if it was built with `ENABLE_M7`.
    MistCoolant,
    /// M8. Not with a sampler on wires, whose output "the specimen is done" it is.
    FloodCoolant,
    /// M3 at full speed (`$30`), and M5. Laser mode (`$32`) must be off.
    Spindle,
}

impl Ranged for OutputSettings<GrblPin> {
    const RANGES: &'static [Range<Self>] = ranges![settle_ms: 0.0, SETTLE_MOST_MS, "ms";];
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
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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

/// Slowest speed and acceleration that are meant, in units/min and units/s^2.
pub(super) const SLOWEST: f64 = 1e-3;
/// Fastest speed and acceleration that are meant, in units/min and units/s^2.
pub(super) const FASTEST: f64 = 1e9;

impl Ranged for GrblSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        baud: BAUD_LEAST, BAUD_MOST, "baud";
        steps_per_unit: 1.0, u32::MAX as f64, "(ratio of steps and units)";
        max_rate_units_per_min: SLOWEST, FASTEST, "units/min";
        acceleration_units_per_s2: SLOWEST, FASTEST, "units/s^2";
        answer_timeout_ms: 1.0, ANSWER_MOST_MS, "ms";
        homing_timeout_ms: 1.0, HOMING_MOST_MS, "ms";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        outputs::outside(&self.outputs)
    }
}

impl GrblSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        in_range(super::DEVICE, self)?;
        outputs::check(super::DEVICE, &self.outputs)?;
        let [num, den] = self.steps_per_unit;
        if f64::from(num) / f64::from(den) > MOST_STEPS_PER_UNIT {
            let (name, found) = ("steps_per_unit".into(), format!("[{num}, {den}]"));
            return Err(DeviceError::Setting { device: super::DEVICE, name, found, rule: "the ratio must be at most 400".into() });
        }
        Ok(())
    }
}

serial_driver!(GrblSettings, super::Grbl::link, |settings, translation| super::Grbl::with_translation(settings, translation));
