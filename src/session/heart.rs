//! The driver's sign of life, for the watchdog.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The driver beats this often while it is free to.
pub const BEAT: Duration = Duration::from_secs(1);
/// Silence after which the driver hangs: longer than any sync to a slow disk.
const SILENCE: Duration = Duration::from_secs(5);

/// Beaten by the driver itself, read by whoever speaks for it.
#[derive(Clone)]
pub struct Heart(Arc<Mutex<Instant>>);

impl Default for Heart {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(Instant::now())))
    }
}

impl Heart {
    pub fn beat(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    pub fn beats(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).elapsed() < SILENCE
    }
}
