//! The `[rotation]` table of a Zaber controller.

use crate::DeviceError;
use crate::rotation::knowledge::travel_time;
use crate::rotation::{Port, Reference};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How a Zaber controller is connected, and the settings that it must have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZaberSettings {
    /// Serial port, by its name or by its USB adapter's serial number.
    pub port: Port,
    /// Baud; 115200 for the ASCII protocol.
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
    /// Its `maxspeed`: microsteps/s times 1.6384.
    pub maxspeed: u32,
    /// Its `accel`: microsteps/s^2 times 1.6384 / 10000.
    pub accel: u32,
    /// Largest difference between encoder and counter after a move, microsteps. Leave it out without an encoder.
    #[serde(default)]
    pub encoder_tolerance_steps: Option<u32>,
    /// How step 0 is found.
    pub reference: Reference,
    /// Longest wait for an answer, ms.
    #[serde(default = "default_answer_timeout_ms")]
    pub answer_timeout_ms: u32,
    /// Longest homing, ms.
    #[serde(default = "default_homing_timeout_ms")]
    pub homing_timeout_ms: u32,
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
const MOST_DEVICES: u8 = 99;
const MOST_AXES: u8 = 9;

impl ZaberSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        for (name, value, most) in [
            ("device", self.device.into(), MOST_DEVICES.into()),
            ("axis", self.axis.into(), MOST_AXES.into()),
            ("resolution", self.resolution, 256),
            ("maxspeed", self.maxspeed, u32::MAX),
            ("accel", self.accel, u32::MAX),
            ("encoder_tolerance_steps", self.encoder_tolerance_steps.unwrap_or(1), u32::MAX),
            ("answer_timeout_ms", self.answer_timeout_ms, u32::MAX),
            ("homing_timeout_ms", self.homing_timeout_ms, u32::MAX),
        ] {
            if !(1..=most).contains(&value) {
                let rule = format!("it must be 1 to {most}");
                return Err(DeviceError::Setting { device: super::DEVICE, name, found: value.to_string(), rule });
            }
        }
        Ok(())
    }

    /// The longest time that a healthy controller needs for a move.
    pub(super) fn travel_time(&self, steps: i64) -> Duration {
        travel_time(steps, f64::from(self.maxspeed) / SPEED_UNIT, f64::from(self.accel) / ACCELERATION_UNIT) + self.answer_timeout()
    }

    pub(super) fn answer_timeout(&self) -> Duration {
        Duration::from_millis(self.answer_timeout_ms.into())
    }

    pub(super) fn homing_timeout(&self) -> Duration {
        Duration::from_millis(self.homing_timeout_ms.into())
    }
}
