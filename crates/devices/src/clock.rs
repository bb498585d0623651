//! The clock of a device that waits. Tests replace it by one that only they move.

use std::time::{Duration, Instant};

/// How to read the time, and how to wait.
#[derive(Clone, Copy)]
pub(crate) struct Clock {
    pub now: fn() -> Instant,
    /// Blocks the thread for this time.
    pub pause: fn(Duration),
}

impl Clock {
    pub const REAL: Self = Self { now: Instant::now, pause: std::thread::sleep };

    /// Time that has passed since `earlier`.
    pub fn since(self, earlier: Instant) -> Duration {
        (self.now)().duration_since(earlier)
    }
}
