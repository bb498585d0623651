//! What can be made to go wrong between the host and the firmware.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Knobs that act on what the firmware sends.
#[derive(Debug, Default)]
pub struct SerialFaults {
    dropped_oks: AtomicU32,
    delay: Mutex<Duration>,
}

impl SerialFaults {
    /// The next `count` lines are carried out, but their `ok` is lost.
    pub fn drop_oks(&self, count: u32) {
        self.dropped_oks.store(count, Ordering::Relaxed);
    }

    /// Every answer from now on leaves this much later (real time).
    pub fn delay_answers(&self, by: Duration) {
        *self.delay.lock().unwrap_or_else(PoisonError::into_inner) = by;
    }

    pub(super) fn delay(&self) -> Duration {
        *self.delay.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn take_dropped_ok(&self) -> bool {
        take_one(&self.dropped_oks)
    }
}

/// Uses up one of a counted fault; false when none is left.
pub(crate) fn take_one(counter: &AtomicU32) -> bool {
    counter.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).is_ok()
}
