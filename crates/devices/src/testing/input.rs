//! A fake specimen input with a script.

use crate::cancel::CancelToken;
use crate::{DeviceError, SpecimenInput};
use std::collections::VecDeque;

/// A specimen input that has one level of its script after the other, one per reading. It keeps the last level.
#[derive(Debug, Default)]
pub struct FakeInput {
    /// The levels of the next readings.
    pub levels: VecDeque<bool>,
    /// The level of the last reading, and of all readings after the script.
    pub last: bool,
    /// Each level that the output "done" was switched to.
    pub done: Vec<bool>,
    /// The controller is stopped until it is prepared for the next specimen.
    pub is_stopped: bool,
    /// The level of the input after the output "done" was switched on. `None` leaves the script as it is.
    pub after_done: Option<bool>,
    /// Its controller does not answer any more after the script.
    pub is_lost: bool,
    /// Cancelled at the first reading after the script.
    pub cancels: Option<CancelToken>,
}

impl FakeInput {
    /// An input with these levels.
    pub fn new(levels: &[bool]) -> Self {
        Self { levels: levels.iter().copied().collect(), ..Self::default() }
    }

    fn next_level(&mut self) -> bool {
        self.last = self.levels.pop_front().unwrap_or(self.last);
        self.last
    }
}

impl SpecimenInput for FakeInput {
    fn begin(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        if cancel.is_cancelled() {
            return Err(DeviceError::Stopped);
        }
        self.is_stopped = false;
        Ok(())
    }

    fn is_active(&mut self) -> Result<bool, DeviceError> {
        if self.is_stopped {
            return Err(DeviceError::Stopped);
        }
        if self.is_lost && self.levels.is_empty() {
            return Err(DeviceError::Gone { device: "input", why: "the cable".into() });
        }
        if let (true, Some(cancel)) = (self.levels.is_empty(), &self.cancels) {
            cancel.cancel();
        }
        Ok(self.next_level())
    }

    fn is_active_at_rest(&mut self) -> Result<Option<bool>, DeviceError> {
        Ok(Some(self.next_level()))
    }

    fn say_done(&mut self, done: bool) -> Result<(), DeviceError> {
        self.done.push(done);
        if let (true, Some(level)) = (done, self.after_done) {
            self.last = level;
            self.levels.clear();
        }
        Ok(())
    }
}
