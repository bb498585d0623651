//! The driver's heartbeat, for the watchdog.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often the driver sets it while it is free to.
pub const INTERVAL: Duration = Duration::from_secs(1);
/// Age from which on the driver counts as hanging: longer than any sync to a slow disk.
const SILENCE: Duration = Duration::from_secs(5);

/// The driver sets it, and the watchdog reads it.
#[derive(Clone)]
pub struct Heartbeat(Arc<Mutex<Instant>>);

impl Default for Heartbeat {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(Instant::now())))
    }
}

impl Heartbeat {
    /// The driver is alive now.
    pub fn beat(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Whether the newest heartbeat is recent.
    pub fn is_alive(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).elapsed() < SILENCE
    }
}
