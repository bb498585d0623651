//! The rig's time: the monotonic clock, run faster by the time scale.

use std::time::{Duration, Instant};

/// Seconds of rig time. Motors and exposures run in it; protocol timeouts (heartbeat, boot) keep to real time.
#[derive(Debug, Clone, Copy)]
pub struct RigClock {
    start: Instant,
    scale: f64,
}

impl RigClock {
    /// `scale` 10 makes everything mechanical ten times as fast.
    pub fn new(scale: f64) -> Self {
        Self { start: Instant::now(), scale }
    }

    /// Rig seconds since the rig was started.
    pub fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64() * self.scale
    }

    /// How long a span of rig time lasts for the person who waits for it.
    pub fn real(&self, rig_s: f64) -> Duration {
        Duration::try_from_secs_f64((rig_s / self.scale).max(0.0)).unwrap_or(Duration::MAX)
    }
}
