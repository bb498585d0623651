//! The `[rotation]` table of a VAST behind its trigger bridge.

use super::DEVICE;
use crate::rotation::Port;
use crate::rotation::TranslationSettings;
use crate::rotation::driver::Driver;
use crate::rotation::pace::{FASTEST_DEG_PER_S, Pace, SLOWEST_DEG_PER_S};
use crate::setting::{ANSWER_MOST_MS, BAUD_LEAST, BAUD_MOST, HOMING_MOST_MS, in_range};
use crate::{DeviceError, RotationAxis};
use carved_core::range::{OutOfRange, Range, Ranged};
use carved_core::ranges;
use carved_core::units::StepsPerRevolution;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Duration;

/// How the bridge is connected, the path of VAST's list, and the speed of VAST.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct VastBridgeSettings {
    /// Serial port of the Arduino, by its name or by its USB serial number.
    pub port: Port,
    /// Speed of the serial line.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Path of VAST's `external.txt` on this computer (its folder is shared). Write the whole path: a relative one begins in the working
    /// directory of the daemon.
    pub list: PathBuf,
    /// The list's `x_position`, um.
    #[serde(default)]
    pub x_position_um: i32,
    /// The list's `tray_LED`: whether the lamp of the tray is on.
    #[serde(default = "yes")]
    pub tray_led: bool,
    /// Speed of the rotation, deg/s; measure it. An arrival before half the time of a turn at this speed does not count.
    pub speed_deg_per_s: f64,
    /// A turn has failed this long after one and a half times its time, ms.
    #[serde(default = "default_turn_margin_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub turn_margin_ms: u32,
    /// Longest wait after the specimen was reported as loaded until VAST has it in the first position, ms.
    #[serde(default = "default_first_arrival_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub first_arrival_timeout_ms: u32,
    /// Longest wait for the bridge's `OK`, ms.
    #[serde(default = "default_answer_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub answer_timeout_ms: u32,
    /// Whether VAST needs a trigger after the last view to continue.
    #[serde(default = "yes")]
    pub end_with_trigger: bool,
}

fn default_baud() -> u32 {
    115_200
}

fn yes() -> bool {
    true
}

fn default_turn_margin_ms() -> u32 {
    2000
}

fn default_first_arrival_timeout_ms() -> u32 {
    120_000
}

fn default_answer_timeout_ms() -> u32 {
    1000
}

impl Ranged for VastBridgeSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        baud: BAUD_LEAST, BAUD_MOST, "baud";
        x_position_um: -1e6, 1e6, "um";
        speed_deg_per_s: SLOWEST_DEG_PER_S, FASTEST_DEG_PER_S, "deg/s";
        turn_margin_ms: 1.0, ANSWER_MOST_MS, "ms";
        first_arrival_timeout_ms: 1.0, HOMING_MOST_MS, "ms";
        answer_timeout_ms: 1.0, ANSWER_MOST_MS, "ms";
    ];
}

impl VastBridgeSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range, or steps that the list cannot express.
    pub fn check(&self, per_revolution: StepsPerRevolution) -> Result<(), DeviceError> {
        in_range(DEVICE, self)?;
        if self.list.file_name().is_none() {
            let (name, found) = ("list".into(), self.list.display().to_string());
            return Err(DeviceError::Setting { device: DEVICE, name, found, rule: "it must be the path of VAST's external.txt".into() });
        }
        super::list::hundredths_per_step(per_revolution).map(|_| ())
    }

    pub(super) fn pace(&self) -> Pace {
        Pace { speed_deg_per_s: self.speed_deg_per_s, margin: Duration::from_millis(self.turn_margin_ms.into()) }
    }

    pub(super) fn answer_timeout(&self) -> Duration {
        Duration::from_millis(self.answer_timeout_ms.into())
    }

    pub(super) fn first_arrival_timeout(&self) -> Duration {
        Duration::from_millis(self.first_arrival_timeout_ms.into())
    }
}

impl Driver for VastBridgeSettings {
    fn out_of_range(&self) -> Vec<OutOfRange> {
        self.outside()
    }

    fn check_on(&self, per_revolution: StepsPerRevolution) -> Result<(), DeviceError> {
        self.check(per_revolution)
    }

    fn open(&self, per_revolution: StepsPerRevolution, _: Option<TranslationSettings>) -> Result<Box<dyn RotationAxis>, DeviceError> {
        Ok(Box::new(super::VastBridge::open(self.clone(), per_revolution)?))
    }

    fn serial(&self) -> Option<(&Port, u32)> {
        Some((&self.port, self.baud))
    }

    fn connect_to(&mut self, address: String) {
        self.port = Port::Path(address);
    }
}
