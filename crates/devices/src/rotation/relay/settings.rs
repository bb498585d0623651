//! The `[rotation]` table of a VAST behind a relay.

use super::DEVICE;
use crate::rotation::driver::Driver;
use crate::rotation::pace::{FASTEST_DEG_PER_S, Pace, SLOWEST_DEG_PER_S};
use crate::rotation::{Port, TranslationSettings};
use crate::setting::{ANSWER_MOST_MS, HOMING_MOST_MS, in_range};
use crate::{DeviceError, RotationAxis};
use carved_core::range::{OutOfRange, Range, Ranged};
use carved_core::ranges;
use carved_core::units::StepsPerRevolution;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// The address of the relay, and the speed of its VAST.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct RelaySettings {
    /// `host:port` of the program on VAST's computer.
    pub address: String,
    /// Whether to send `boot` if VAST is not started. It starts VAST's own library and may move everything. False if a person starts
    /// VAST at its computer.
    #[serde(default)]
    pub boot: bool,
    /// Longest wait after `boot` until VAST has started, ms.
    #[serde(default = "default_boot_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub boot_timeout_ms: u32,
    /// Speed of the rotation, deg/s; measure it. The end of a turn does not count before half its time at this speed.
    pub speed_deg_per_s: f64,
    /// A turn has failed this long after one and a half times its time, ms.
    #[serde(default = "default_turn_margin_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub turn_margin_ms: u32,
    /// Longest wait for any other answer, ms.
    #[serde(default = "default_answer_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub answer_timeout_ms: u32,
}

fn default_boot_timeout_ms() -> u32 {
    60_000
}

fn default_turn_margin_ms() -> u32 {
    2000
}

fn default_answer_timeout_ms() -> u32 {
    1000
}

impl Ranged for RelaySettings {
    const RANGES: &'static [Range<Self>] = ranges![
        boot_timeout_ms: 1.0, HOMING_MOST_MS, "ms";
        speed_deg_per_s: SLOWEST_DEG_PER_S, FASTEST_DEG_PER_S, "deg/s";
        turn_margin_ms: 1.0, ANSWER_MOST_MS, "ms";
        answer_timeout_ms: 1.0, ANSWER_MOST_MS, "ms";
    ];
}

impl RelaySettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        in_range(DEVICE, self)?;
        let port = self.address.rsplit_once(':').filter(|(host, _)| !host.is_empty()).and_then(|(_, port)| port.parse::<u16>().ok());
        if port.is_none_or(|port| port == 0) {
            let (name, found) = ("address".into(), format!("{:?}", self.address));
            let rule = "it must be host:port, such as \"192.168.10.3:5000\"".into();
            return Err(DeviceError::Setting { device: DEVICE, name, found, rule });
        }
        Ok(())
    }

    pub(super) fn pace(&self) -> Pace {
        Pace { speed_deg_per_s: self.speed_deg_per_s, margin: Duration::from_millis(self.turn_margin_ms.into()) }
    }

    pub(super) fn answer_timeout(&self) -> Duration {
        Duration::from_millis(self.answer_timeout_ms.into())
    }

    pub(super) fn boot_timeout(&self) -> Duration {
        Duration::from_millis(self.boot_timeout_ms.into())
    }
}

impl Driver for RelaySettings {
    fn out_of_range(&self) -> Vec<OutOfRange> {
        self.outside()
    }

    fn check_on(&self, _: StepsPerRevolution) -> Result<(), DeviceError> {
        self.check()
    }

    fn open(&self, per_revolution: StepsPerRevolution, _: Option<TranslationSettings>) -> Result<Box<dyn RotationAxis>, DeviceError> {
        Ok(Box::new(super::Relay::open(self.clone(), per_revolution)?))
    }

    fn serial(&self) -> Option<(&Port, u32)> {
        None
    }

    fn connect_to(&mut self, address: String) {
        self.address = address;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_no_relay_can_have_are_named_with_their_value() {
        let said = |change: fn(&mut RelaySettings)| {
            let mut settings = RelaySettings {
                address: "vast:5000".into(),
                boot: false,
                boot_timeout_ms: 1,
                speed_deg_per_s: 90.0,
                turn_margin_ms: 1,
                answer_timeout_ms: 1,
            };
            settings.check().unwrap();
            change(&mut settings);
            settings.check().unwrap_err().to_string()
        };
        for (said, word) in [
            (said(|s| s.address = "vast".into()), "\"vast\""),
            (said(|s| s.address = "vast:0".into()), "\"vast:0\""),
            (said(|s| s.address = ":5000".into()), "\":5000\""),
            (said(|s| s.address = "vast:70000".into()), "70000"),
            (said(|s| s.speed_deg_per_s = 0.0), "speed_deg_per_s = 0"),
            (said(|s| s.turn_margin_ms = 0), "turn_margin_ms = 0"),
            (said(|s| s.answer_timeout_ms = 0), "answer_timeout_ms = 0"),
            (said(|s| s.boot_timeout_ms = 0), "boot_timeout_ms = 0"),
        ] {
            assert!(said.contains(word), "{word} is not in: {said}");
        }
    }
}
