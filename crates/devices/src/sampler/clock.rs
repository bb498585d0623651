//! The time that a sampler waits by. Tests put a clock in its place that moves only as they say.

use std::time::{Duration, Instant};

#[derive(Clone, Copy)]
pub(super) struct Clock {
    pub now: fn() -> Instant,
    /// Blocks for this long.
    pub pause: fn(Duration),
}

impl Clock {
    pub const REAL: Self = Self { now: Instant::now, pause: std::thread::sleep };

    pub fn since(self, earlier: Instant) -> Duration {
        (self.now)().duration_since(earlier)
    }
}
