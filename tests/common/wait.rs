//! Waiting for a condition, with a deadline.

use std::time::{Duration, Instant};

/// Longer than anything takes here, even on a loaded machine. A condition that is not met by then is a failure; no test measures time with
/// it.
pub const PATIENCE: Duration = Duration::from_secs(240);

/// Waits until `holds` is true. Returns how long this took.
pub fn until(what: &str, mut holds: impl FnMut() -> bool) -> Duration {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < PATIENCE, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
    began.elapsed()
}
