//! Time limits for a turn on an axis that reports only the end of the turn.
//!
//! ```text
//! 0 ──── shortest = 0.5 deg / speed ──── deg / speed ──── longest = 1.5 deg / speed + margin
//!   an end does not count  │                an end counts                 │ the turn has failed
//! ```

use crate::DeviceError;
use std::time::Duration;

/// The configured speed, which somebody has measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pace {
    pub speed_deg_per_s: f64,
    pub margin: Duration,
}

impl Pace {
    pub fn check(&self, device: &'static str, margin_name: &'static str) -> Result<(), DeviceError> {
        let bad = |name, found, rule: &str| Err(DeviceError::Setting { device, name, found, rule: rule.into() });
        // A step of 0.72 deg at the slowest takes 12 minutes, one at the fastest 70 us.
        if !(0.001..=10_000.0).contains(&self.speed_deg_per_s) {
            return bad("speed_deg_per_s", self.speed_deg_per_s.to_string(), "it must be from 0.001 to 10000");
        }
        if self.margin.is_zero() {
            return bad(margin_name, "0".into(), "it must be at least 1");
        }
        Ok(())
    }

    /// No turn ends sooner: half its time at the configured speed.
    pub fn shortest(&self, deg: f64) -> Duration {
        Duration::from_secs_f64(0.5 * deg.abs() / self.speed_deg_per_s)
    }

    /// A turn that has not ended by then has failed.
    pub fn longest(&self, deg: f64) -> Duration {
        Duration::from_secs_f64(1.5 * deg.abs() / self.speed_deg_per_s) + self.margin
    }
}
