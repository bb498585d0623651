//! The `[rotation]` table of a Zaber controller.

use crate::outputs::{self, OutputSettings, OutputTable, SETTLE_MOST_MS};
use crate::rotation::driver::serial_driver;
use crate::rotation::knowledge::travel_time;
use crate::rotation::{Port, Reference};
use crate::setting::{ANSWER_MOST_MS, BAUD_LEAST, BAUD_MOST, HOMING_MOST_MS, in_range};
use crate::{DeviceError, EvenMotion};
use carved_core::range::{OutOfRange, Range, Ranged};
use carved_core::ranges;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How a Zaber controller is connected, and the settings that it must have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct ZaberSettings {
    /// Serial port, by its name or by its USB adapter's serial number.
    pub port: Port,
    /// Speed of the serial line. The ASCII protocol has 115200.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Address of the device in its chain.
    #[serde(default = "default_number")]
    pub device: u8,
    /// The axis that turns the capillary.
    #[serde(default = "default_number")]
    pub axis: u8,
    /// The controller's `resolution`: microsteps per full step.
    pub resolution: u32,
    /// The controller's `maxspeed`: microsteps/s times 1.6384.
    pub maxspeed: u32,
    /// The controller's `accel`: microsteps/s^2 times 1.6384 / 10000.
    pub accel: u32,
    /// Largest difference between encoder and counter after a move, microsteps. Leave it out without an encoder.
    #[serde(default)]
    pub encoder_tolerance_steps: Option<u32>,
    /// How step 0 is found.
    pub reference: Reference,
    /// Longest wait for an answer, ms.
    #[serde(default = "default_answer_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub answer_timeout_ms: u32,
    /// Longest homing, ms.
    #[serde(default = "default_homing_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub homing_timeout_ms: u32,
    /// Outputs that switch a light or a valve, by name: lower-case letters, digits and `_`.
    #[serde(default, skip_serializing_if = "OutputTable::is_empty")]
    pub outputs: OutputTable<ZaberPin>,
}

/// The channel of a digital output (`io set do`), counted from 1. A controller refuses one that it lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(transparent)]
pub struct ZaberPin(pub u8);

impl carved_core::range::Numbers for ZaberPin {
    fn numbers(&self) -> Vec<f64> {
        vec![self.0.into()]
    }
}

impl Ranged for OutputSettings<ZaberPin> {
    const RANGES: &'static [Range<Self>] = ranges![
        pin: 1.0, 4.0, "(number of the channel)";
        settle_ms: 0.0, SETTLE_MOST_MS, "ms";
    ];
}

fn default_baud() -> u32 {
    115_200
}

fn default_number() -> u8 {
    1
}

fn default_answer_timeout_ms() -> u32 {
    300
}

fn default_homing_timeout_ms() -> u32 {
    30_000
}

/// The protocol's unit of speed, per microstep/s.
const SPEED_UNIT: f64 = 1.6384;
/// The protocol's unit of acceleration, per microstep/s^2.
const ACCELERATION_UNIT: f64 = SPEED_UNIT / 10_000.0;

/// A speed in the controller's unit as microsteps/s.
pub(super) fn steps_per_s(speed: u32) -> f64 {
    f64::from(speed) / SPEED_UNIT
}

impl Ranged for ZaberSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        baud: BAUD_LEAST, BAUD_MOST, "baud";
        device: 1.0, 99.0, "(address)";
        axis: 1.0, 9.0, "(number)";
        resolution: 1.0, 256.0, "microsteps per full step";
        maxspeed: 1.0, u32::MAX as f64, "(the controller's unit)";
        accel: 1.0, u32::MAX as f64, "(the controller's unit)";
        encoder_tolerance_steps: 1.0, u32::MAX as f64, "microsteps";
        answer_timeout_ms: 1.0, ANSWER_MOST_MS, "ms";
        homing_timeout_ms: 1.0, HOMING_MOST_MS, "ms";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        outputs::outside(&self.outputs)
    }
}

impl ZaberSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        in_range(super::DEVICE, self)?;
        outputs::check(super::DEVICE, &self.outputs)
    }

    /// The longest time that a healthy controller needs for a move.
    pub(super) fn travel_time(&self, steps: i64) -> Duration {
        self.travel_time_at(steps, self.maxspeed)
    }

    /// The same for a move with its own speed, in the controller's unit.
    pub(super) fn travel_time_at(&self, steps: i64, speed: u32) -> Duration {
        travel_time(steps, steps_per_s(speed), self.motion().acceleration_steps_per_s2) + self.answer_timeout()
    }

    /// Speed and acceleration of every move.
    pub(super) fn motion(&self) -> EvenMotion {
        EvenMotion { fastest_steps_per_s: steps_per_s(self.maxspeed), acceleration_steps_per_s2: f64::from(self.accel) / ACCELERATION_UNIT }
    }

    /// A speed in the controller's unit; `None` above `maxspeed`, or if it rounds to 0.
    pub(super) fn speed(&self, steps_per_s: f64) -> Option<u32> {
        let speed = (steps_per_s * SPEED_UNIT).round();
        (speed >= 1.0 && speed <= f64::from(self.maxspeed)).then_some(speed as u32)
    }
}

serial_driver!(ZaberSettings, super::Zaber::link, |settings, _| super::Zaber::open(settings));
