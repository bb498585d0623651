//! The `[rotation]` table of a VAST behind its trigger bridge.

use super::DEVICE;
use crate::DeviceError;
use crate::rotation::Port;
use crate::rotation::pace::Pace;
use carved_core::units::StepsPerRevolution;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Duration;

/// How the bridge is reached, where VAST reads its list, and how fast it turns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VastBridgeSettings {
    /// Serial port of the Arduino, by its name or by its USB serial number.
    pub port: Port,
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// VAST's `external.txt`, as this computer sees it (its folder is shared).
    pub list: PathBuf,
    /// What the list's degrees mean to this VAST.
    pub degrees: Degrees,
    /// The list's `x_position`, um.
    #[serde(default)]
    pub x_position_um: i32,
    /// The list's `tray_LED`.
    #[serde(default = "yes")]
    pub tray_led: bool,
    /// How fast VAST turns, deg/s: measure. An arrival before half a turn's time, or a margin after one and a half, is none.
    pub speed_deg_per_s: f64,
    /// Time beyond one and a half of a turn's until it counts as failed, ms.
    #[serde(default = "default_turn_margin_ms")]
    pub turn_margin_ms: u32,
    /// Longest wait, once the specimen is said to be loaded, until VAST has it in the first position, ms.
    #[serde(default = "default_first_arrival_timeout_ms")]
    pub first_arrival_timeout_ms: u32,
    /// Longest wait for the bridge's `OK`, ms.
    #[serde(default = "default_answer_timeout_ms")]
    pub answer_timeout_ms: u32,
    /// Whether a trigger after the last view lets VAST go on.
    #[serde(default = "yes")]
    pub end_with_trigger: bool,
}

/// What the degrees of a line are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Degrees {
    /// A position of the axis.
    Absolute,
    /// A turn from the position of the line before.
    Relative,
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

impl VastBridgeSettings {
    /// # Errors
    /// Names the first value that no bridge can have.
    pub fn check(&self, per_revolution: StepsPerRevolution) -> Result<(), DeviceError> {
        let bad =
            |name, found: &str, rule: &str| Err(DeviceError::Setting { device: DEVICE, name, found: found.into(), rule: rule.into() });
        self.pace().check(DEVICE, "turn_margin_ms")?;
        for (name, value) in [("answer_timeout_ms", self.answer_timeout_ms), ("first_arrival_timeout_ms", self.first_arrival_timeout_ms)] {
            if value == 0 {
                return bad(name, "0", "it must be at least 1");
            }
        }
        if self.list.file_name().is_none() {
            return bad("list", &self.list.display().to_string(), "it must be the path of VAST's external.txt");
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
