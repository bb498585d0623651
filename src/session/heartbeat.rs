//! The driver's heartbeat, for the watchdog.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Interval of the heartbeat, if the driver is not busy.
pub const INTERVAL: Duration = Duration::from_secs(1);
/// Age of the heartbeat from which the driver counts as hanging. It is longer than any sync to a slow disk.
const SILENCE: Duration = Duration::from_secs(5);

/// The time of the newest heartbeat. The driver sets it, and the watchdog reads it.
#[derive(Clone)]
pub struct Heartbeat(Arc<Mutex<Instant>>);

impl Default for Heartbeat {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(Instant::now())))
    }
}

impl Heartbeat {
    /// Sets the heartbeat to now.
    pub fn beat(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Whether the newest heartbeat is recent.
    pub fn is_alive(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).elapsed() < SILENCE
    }
}
