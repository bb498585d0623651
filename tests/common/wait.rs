//! Waiting for a condition, with a deadline.

use std::time::{Duration, Instant};

/// Longer than anything here takes, even on a loaded machine: what never comes true is a failure, and nothing is timed by it.
pub const PATIENCE: Duration = Duration::from_secs(240);

/// Returns once `holds`, and how long that took.
pub fn until(what: &str, mut holds: impl FnMut() -> bool) -> Duration {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < PATIENCE, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
    began.elapsed()
}
