//! The emergency stop's own way to the motors: from whichever thread asks, past the mailbox and the driver.

use crate::cancel::CancelToken;
use crate::device::StopHandle;
use std::sync::{Arc, Mutex, PoisonError};

/// Clones share one instrument and the run under way on it.
#[derive(Clone, Default)]
pub struct Halt(Arc<Mutex<(Option<StopHandle>, CancelToken)>>);

impl Halt {
    /// The instrument's motors, and what cancels the work that is about to move them.
    pub fn aim(&self, motors: StopHandle, work: CancelToken) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = (Some(motors), work);
    }

    /// Cancels first, so that no move follows the stop, and puts the stop on the wire before it returns.
    pub fn stop(&self) {
        let (motors, work) = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        work.cancel();
        if let Some(motors) = motors {
            motors.stop();
        }
    }
}
