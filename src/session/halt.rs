//! The emergency stop's own way to the motors: from whichever thread asks, past the mailbox and the driver.
//!
//! ```text
//! stop ──► the work is cancelled ──► stop on the wire ──► pressed ──► the driver takes it: fault, abort
//!                                                           │
//! aim at new work ────────── cancelled at once, while ──────┘
//! ```

use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Notify;

/// Clones share one instrument and the run under way on it.
#[derive(Clone, Default)]
pub struct Halt(Arc<(Mutex<Aim>, Notify)>);

#[derive(Default)]
struct Aim {
    motors: Option<StopHandle>,
    work: CancelToken,
    /// It was pressed, and the driver does not know yet.
    pressed: bool,
}

impl Halt {
    fn with<T>(&self, work: impl FnOnce(&mut Aim) -> T) -> T {
        work(&mut self.0.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The instrument's motors, and what cancels the work that is about to move them: at once, where the stop was pressed while that
    /// work was made ready.
    pub fn aim(&self, motors: StopHandle, work: CancelToken) {
        self.with(|aim| {
            if aim.pressed {
                work.cancel();
            }
            (aim.motors, aim.work) = (Some(motors), work);
        });
    }

    /// Cancels first, so that no move follows the stop, and puts the stop on the wire before it returns.
    pub fn stop(&self) {
        let motors = self.with(|aim| {
            aim.pressed = true;
            aim.work.cancel();
            aim.motors.clone()
        });
        if let Some(motors) = motors {
            motors.stop();
        }
        self.0.1.notify_one();
    }

    /// Resolves once it was pressed and not taken; whoever asked may have gone away since.
    pub async fn pressed(&self) {
        while !self.with(|aim| aim.pressed) {
            self.0.1.notified().await;
        }
    }

    /// Whether it was pressed since the last time; from now on the driver answers for what it starts.
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
    }
}
