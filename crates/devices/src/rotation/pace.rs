//! Time limits for a turn on an axis that reports only the end of the turn.
//!
//! ```text
//! 0 ──── shortest = 0.5 deg / speed ──── deg / speed ──── longest = 1.5 deg / speed + margin
//!   an end does not count  │                an end counts                 │ the turn has failed
//! ```

use std::time::Duration;

/// The configured speed, which somebody has measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pace {
    pub speed_deg_per_s: f64,
    pub margin: Duration,
}

/// A step of 0.72 deg takes 12 minutes at the slowest speed, and 70 us at the fastest.
pub(super) const SLOWEST_DEG_PER_S: f64 = 0.001;
/// The fastest speed.
pub(super) const FASTEST_DEG_PER_S: f64 = 10_000.0;

impl Pace {
    /// No turn ends sooner: half its time at the configured speed.
    pub fn shortest(&self, deg: f64) -> Duration {
        Duration::from_secs_f64(0.5 * deg.abs() / self.speed_deg_per_s)
    }

    /// A turn that has not ended by then has failed.
    pub fn longest(&self, deg: f64) -> Duration {
        Duration::from_secs_f64(1.5 * deg.abs() / self.speed_deg_per_s) + self.margin
    }
}
