//! The loader's word on specimens: one is in the capillary, or has been taken out.

use super::super::state::Trigger;
use super::super::{Phase, Refusal, State, kind};
use super::Running;
use serde_json::Value;

impl Running {
    pub(super) fn loaded(&mut self, run: String, well: String) -> Result<(), Refusal> {
        let status = self.publisher.status();
        if !self.is(&run) {
            return Err(match &status.run {
                Some(ended) if ended.id == run => Refusal::RunEnded { id: run, outcome: ended.outcome },
                newest => Refusal::UnknownRun { id: run, newest: newest.as_ref().map(|r| r.id.clone()) },
            });
        }
        let awaited = self.active.as_ref().is_some_and(|a| a.waiting_for.as_deref() == Some(well.as_str()));
        if !awaited {
            // Said again after it was taken there is nothing more to do; said before it was asked for it would be lost.
            let current = status.specimen.as_ref().is_some_and(|s| s.well == well && s.in_capillary);
            return if current { Ok(()) } else { Err(Refusal::UnexpectedWell { run, well }) };
        }
        self.promise(kind::WELL_LOADED, Some(&well), Value::Null)?;
        if let Some(active) = &mut self.active {
            active.waiting_for = None;
        }
        // Not over a hold's word to the one who waits: that specimen stays where it is and is asked for again.
        let held = status.state != State::Suspended;
        if !held {
            self.gate.say_loaded(&well);
        }
        let change = |s: &mut super::Status| {
            if let Some(specimen) = s.specimen.as_mut().filter(|x| x.well == well) {
                specimen.in_capillary = true;
            }
        };
        // From the loader's word on, not from when the worker takes it up: an abort may come before.
        if held {
            self.publish(change);
        } else {
            self.go_with(Trigger::Loaded, change);
        }
        Ok(())
    }

    /// The specimen has been taken out: after its well is done, before a run goes on, or after a run that was cut short.
    pub(super) fn unloaded(&mut self, run: String, well: String) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let newest = status.run.as_ref().map(|r| r.id.clone());
        if newest.as_ref() != Some(&run) {
            return Err(Refusal::UnknownRun { id: run, newest });
        }
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        match &status.specimen {
            // Said again, or said of a specimen that another has taken the place of.
            None => return Ok(()),
            Some(s) if s.well != well => return Ok(()),
            Some(_) if works && !self.shows_phase(Phase::Eject) => return Err(Refusal::UnexpectedWell { run, well }),
            Some(_) => {}
        }
        self.promise(kind::WELL_UNLOADED, Some(&well), Value::Null)?;
        let waited = self.active.as_mut().is_some_and(|a| {
            a.eject_first.take_if(|x| *x == well);
            a.take_out.take_if(|x| *x == well).is_some()
        });
        let at_rest = self.active.is_none();
        let change = |s: &mut super::Status| match &mut s.specimen {
            Some(specimen) if !at_rest => specimen.in_capillary = false,
            specimen => *specimen = None,
        };
        if waited && status.state == State::Suspended {
            self.go_with(Trigger::Loaded, change);
            self.proceed();
        } else {
            self.publish(change);
        }
        Ok(())
    }
}
