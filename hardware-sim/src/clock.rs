//! The rig's time: the monotonic clock, run faster by the time scale.

use std::time::{Duration, Instant};

/// A clock of rig time, in seconds. Motors and exposures use it. Protocol timeouts (heartbeat, boot) use real time.
#[derive(Debug, Clone, Copy)]
pub struct RigClock {
    start: Instant,
    scale: f64,
}

impl RigClock {
    /// A clock that starts now. `scale` is rig seconds per real second: 10 makes all motion ten times as fast.
    pub fn new(scale: f64) -> Self {
        Self { start: Instant::now(), scale }
    }

    /// Rig seconds since the rig was started.
    pub fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64() * self.scale
    }

    /// The real instant of an instant of rig time.
    pub fn instant(&self, rig_s: f64) -> Instant {
        self.start + self.real(rig_s)
    }

    /// The real time that a span of rig time takes.
    pub fn real(&self, rig_s: f64) -> Duration {
        Duration::try_from_secs_f64((rig_s / self.scale).max(0.0)).unwrap_or(Duration::MAX)
    }
}
