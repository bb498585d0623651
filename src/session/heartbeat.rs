//! The driver's heartbeat, for the watchdog. It tells that the driver lives, not that the disk is fast: a driver that waits for the disk
//! lives, and another process would wait for the same disk.

use carved_store::DiskWatch;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Interval of the heartbeat, if the driver is not busy.
pub const INTERVAL: Duration = Duration::from_secs(1);
/// Age of the newest sign of life from which the driver counts as hanging, if it is not within an operation of the disk.
const SILENCE: Duration = Duration::from_secs(5);
/// Time of one operation from which the disk is slow. On an SSD a sync takes milliseconds, on a disk that spins tens of them.
pub const SLOW: Duration = Duration::from_secs(2);

/// The time of the newest heartbeat. The driver sets it, and the watchdog reads it.
#[derive(Clone)]
pub struct Heartbeat {
    newest: Arc<Mutex<Instant>>,
    disk: DiskWatch,
}

impl Default for Heartbeat {
    fn default() -> Self {
        Self { newest: Arc::new(Mutex::new(Instant::now())), disk: DiskWatch::default() }
    }
}

impl Heartbeat {
    /// Sets the heartbeat to now.
    pub fn beat(&self) {
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// What the driver does on the disk.
    pub fn disk(&self) -> &DiskWatch {
        &self.disk
    }

    /// Whether the newest heartbeat is recent, or the driver waits for the disk, or did so recently.
    pub fn is_alive(&self) -> bool {
        let age = self.newest.lock().unwrap_or_else(PoisonError::into_inner).elapsed();
        self.lives(age)
    }

    fn lives(&self, age: Duration) -> bool {
        age < SILENCE || self.disk.takes().is_some() || self.disk.idle().is_some_and(|idle| idle < SILENCE)
    }

    /// How long the driver has waited for one operation of the disk, if that is long.
    pub fn waits_for_disk(&self) -> Option<Duration> {
        self.disk.takes().filter(|takes| *takes >= SLOW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_driver_that_waits_for_the_disk_lives_and_one_that_hangs_does_not() {
        let heartbeat = Heartbeat::default();
        assert!(heartbeat.lives(Duration::ZERO) && !heartbeat.lives(SILENCE), "nothing but the heartbeat speaks for it");
        heartbeat.disk().begin();
        assert!(heartbeat.lives(Duration::from_secs(3600)), "within an operation, however long it takes");
        heartbeat.disk().end(Duration::from_secs(3600));
        assert!(heartbeat.lives(Duration::from_secs(3600)), "between two operations");
    }
}
