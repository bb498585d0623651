//! The loader's word on specimens: one is in the capillary, or has been taken out.

use super::super::state::Trigger;
use super::super::{Phase, Refusal, State, kind};
use super::Running;
use serde_json::{Value, json};

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
            return if self.occupant.as_ref() == Some(&well) { Ok(()) } else { Err(Refusal::UnexpectedWell { run, well }) };
        }
        // A loader that exchanges specimens in one go says only what it has brought: the former is out.
        self.promise(kind::WELL_LOADED, Some(&well), json!({ "in_place_of": self.occupant }))?;
        // From the loader's word on, not from when the worker takes it up: an abort may come before.
        self.occupant = Some(well.clone());
        if let Some(active) = &mut self.active {
            active.waiting_for = None;
        }
        // Not over a hold's word to the one who waits: that specimen stays where it is and is asked for again.
        let held = status.state != State::Suspended;
        if !held {
            self.gate.say_loaded(&well);
        }
        if held {
            self.publish(|_| ());
        } else {
            self.go(Trigger::Loaded);
        }
        Ok(())
    }

    /// The specimen has been taken out: after its well is done, before a run goes on, or after its run.
    pub(super) fn unloaded(&mut self, run: String, well: String) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let newest = status.run.as_ref().map(|r| r.id.clone());
        if newest.as_ref() != Some(&run) {
            return Err(Refusal::UnknownRun { id: run, newest });
        }
        // Said again, or said of a specimen that another has taken the place of.
        if self.occupant.as_ref() != Some(&well) {
            return Ok(());
        }
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        if works && status.specimen.as_ref().is_some_and(|s| s.well == well && s.phase != Phase::Eject) {
            return Err(Refusal::UnexpectedWell { run, well });
        }
        // One that was pruned is not to come back.
        let told_in = Some(run.as_str()).filter(|run| self.store.run_folder(run).is_dir());
        self.promise_of(told_in, kind::WELL_UNLOADED, Some(&well), Value::Null)?;
        self.occupant = None;
        let waited = self.active.as_mut().is_some_and(|a| {
            a.eject_first.take_if(|x| *x == well);
            a.take_out.take_if(|x| *x == well).is_some()
        });
        let at_rest = self.active.is_none();
        let change = |s: &mut super::Status| drop(s.specimen.take_if(|_| at_rest));
        if waited && status.state == State::Suspended {
            self.go_with(Trigger::Loaded, change);
            self.proceed();
        } else {
            self.publish(change);
        }
        Ok(())
    }
}
