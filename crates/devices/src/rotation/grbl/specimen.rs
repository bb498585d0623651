//! The wires of who brings specimens: the probe input, which a status report tells, and the flood output, which is M8 and M9.
//!
//! ```text
//!   sampler ── "there" ──► probe input     <...|Pn:P|...>      its pull-up makes a pulled wire "not there"
//!           ◄── "done" ─── flood output    M8, M9              every reset switches it off
//! ```
//! Both are inert here: nothing probes, and nothing cools. While somebody else has the controller it is not reset, and no output
//! is switched: it would be carried out when the hold is over.

use super::Grbl;
use super::report::State;
use crate::cancel::CancelToken;
use crate::{DeviceError, SpecimenInput};

impl Grbl {
    /// Brings a controller that was reset, or waits for it in an alarm, to where it takes commands. Nothing moves, and the position is
    /// no better known than before.
    fn revive(&mut self, why: &DeviceError) -> Result<(), DeviceError> {
        self.doubt(why);
        self.wait_until_free()?;
        self.wake()?;
        // The stop and this wake each reset the controller: the greeting of one may come after the other is answered.
        let status = match self.status() {
            Err(DeviceError::Suspect { .. }) => self.status()?,
            answered => answered?,
        };
        if status.state == State::Alarm {
            self.command("$X", self.settings.answer_timeout(), |_| {})?;
        }
        Ok(())
    }

    /// Asks again where the first answer shows that the controller was reset or is in an alarm: the specimen is to be got out all the same.
    fn alive<T>(&mut self, ask: impl Fn(&mut Self) -> Result<T, DeviceError>) -> Result<T, DeviceError> {
        match ask(self) {
            Err(error @ (DeviceError::Gone { .. } | DeviceError::Stopped | DeviceError::Intervention { .. })) => {
                self.doubt(&error);
                Err(error)
            }
            Err(error) => {
                self.revive(&error)?;
                ask(self)
            }
            answered => answered,
        }
    }
}

impl SpecimenInput for Grbl {
    fn begin(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        let was_stopped = self.link.is_stopped();
        self.link.release(cancel)?;
        self.identify()?;
        self.wait_until_free()?;
        if was_stopped { self.revive(&DeviceError::Stopped) } else { Ok(()) }
    }

    fn is_active(&mut self) -> Result<bool, DeviceError> {
        self.alive(|grbl| Ok(grbl.status()?.probe()))
    }

    fn is_active_at_rest(&mut self) -> Result<Option<bool>, DeviceError> {
        Ok(self.report_at_rest()?.map(|status| status.probe()))
    }

    fn say_done(&mut self, done: bool) -> Result<(), DeviceError> {
        let line = if done { "M8" } else { "M9" };
        self.alive(|grbl| {
            grbl.is_free()?;
            grbl.code(line)
        })
    }
}
