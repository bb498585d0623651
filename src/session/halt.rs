//! The direct path of the emergency stop to the motors. It works from any thread, past the mailbox and the driver.
//!
//! ```text
//! stop ──► cancel the work ──► send the stop to the motors ──► pressed ──► the driver takes it: fault, abort
//!                                                                │
//! aim at new work ────────── cancelled at once, while ───────────┘
//! ```

use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Notify;

/// The emergency stop. Clones share one instrument and its current work.
#[derive(Clone, Default)]
pub struct Halt(Arc<(Mutex<Aim>, Notify)>);

#[derive(Default)]
struct Aim {
    motors: Option<StopHandle>,
    work: CancelToken,
    /// The stop was pressed, and the driver has not taken it yet.
    pressed: bool,
}

impl Halt {
    fn with<T>(&self, work: impl FnOnce(&mut Aim) -> T) -> T {
        work(&mut self.0.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Sets the motors to stop, and the cancel token of the work that is about to move them. The token is cancelled at once if the stop was
    /// pressed while the work was prepared.
    pub fn aim(&self, motors: StopHandle, work: CancelToken) {
        self.with(|aim| {
            if aim.pressed {
                work.cancel();
            }
            (aim.motors, aim.work) = (Some(motors), work);
        });
    }

    /// Cancels the work first, so that no move follows the stop. Sends the stop to the motors before it returns.
    pub fn stop(&self) {
        self.halt(true);
        self.0.1.notify_one();
    }

    /// Stops the motors before the process ends at once. It is no emergency stop.
    pub fn stop_motors(&self) {
        self.halt(false);
    }

    fn halt(&self, pressed: bool) {
        let motors = self.with(|aim| {
            aim.pressed |= pressed;
            aim.work.cancel();
            aim.motors.clone()
        });
        if let Some(motors) = motors {
            motors.stop();
        }
    }

    /// Resolves while the stop is pressed and not taken. The client that pressed it may have disconnected.
    pub async fn pressed(&self) {
        while !self.with(|aim| aim.pressed) {
            self.0.1.notified().await;
        }
    }

    /// Whether the stop was pressed since the last call. Clears it: new work is not cancelled any more.
    pub fn take(&self) -> bool {
        self.with(|aim| std::mem::take(&mut aim.pressed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_was_made_ready_while_the_stop_was_pressed_is_cancelled() {
        let halt = Halt::default();
        let (before, during, after) = (CancelToken::new(), CancelToken::new(), CancelToken::new());
        halt.aim(StopHandle::new(|| ()), before.clone());
        halt.stop();
        halt.aim(StopHandle::new(|| ()), during.clone());
        assert!(before.is_cancelled() && during.is_cancelled());
        assert!(halt.take() && !halt.take());
        halt.aim(StopHandle::new(|| ()), after.clone());
        assert!(!after.is_cancelled());
        halt.stop_motors();
        assert!(after.is_cancelled() && !halt.take(), "no emergency stop is left for the driver");
    }
}
