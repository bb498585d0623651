//! The two wires to the sampler: the probe input, which is part of a status report, and the flood output, switched by M8 and M9.
//!
//! ```text
//!   sampler ── "there" ──► probe input     <...|Pn:P|...>      its pull-up makes a pulled wire "not there"
//!           ◄── "done" ─── flood output    M8, M9              every reset switches it off
//! ```
//! Neither has another use here: nothing probes, and nothing cools. While a person holds the controller it is not reset, and no
//! output is switched, because the command would be executed at the end of the hold.

use super::report::State;
use super::{Grbl, GrblPin};
use crate::cancel::CancelToken;
use crate::{DeviceError, SpecimenInput};

impl Grbl {
    /// Makes a controller accept commands again after a reset or an alarm. Nothing moves. The position becomes suspect.
    fn revive(&mut self, why: &DeviceError) -> Result<(), DeviceError> {
        self.doubt(why);
        let is_idle = self.wait_until_free()?;
        self.make_answers_void(is_idle)?;
        // The greeting of a stop, or of an earlier reset, may come after the answer.
        let status = match self.status() {
            Err(DeviceError::Suspect { .. }) => self.status()?,
            answered => answered?,
        };
        if status.state == State::Alarm {
            self.command("$X", self.settings.answer_timeout(), |_| {})?;
        }
        Ok(())
    }

    /// Asks again if the first answer shows a reset or an alarm, because the specimen must be taken out also then.
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
        self.release(cancel)?;
        if let Err(error) = self.check_no_reset().and_then(|()| self.identify()).and_then(|()| self.wait_until_free().map(drop)) {
            self.doubt(&error);
            return Err(error);
        }
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
            grbl.check_free()?;
            // M9 switches both coolant outputs off.
            let mist = grbl.outputs.is_on(GrblPin::MistCoolant);
            grbl.code(line)?;
            if mist && !done { grbl.code("M7") } else { Ok(()) }
        })
    }
}
