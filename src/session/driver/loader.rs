//! The loader's word on specimens: one is in the capillary, or has been taken out.
//!
//! ```text
//! asked for A02 ──► {A02, loaded} ──┬─ the run waits ──────────────► it goes on with A02
//!     │ (outlasts a hold, a fault,  ├─ held, or about to go on ────► brought: it stays, and is used when the run goes on
//!     │  a crash and the run's end) └─ the run is over by then ────► inside until {A02, not loaded}: nothing runs, nothing is removable
//!     └─ A01 is inside still: exchanged in one go, A01 is out
//! ```
//! A word is taken once it is journalled, whatever became of the run since it was asked for: the larva is where the loader says.

use super::super::state::Trigger;
use super::super::{Refusal, State};
use super::Running;
use carved_records::{EventData, Phase, WellLoaded};

impl Running {
    pub(super) fn loaded(&mut self, run: &str, well: &str) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let newest = status.run.as_ref();
        let Some(told) = newest.filter(|newest| newest.id == run) else {
            return Err(Refusal::UnknownRun { id: run.to_owned(), newest: newest.map(|r| r.id.clone()) });
        };
        // Said again: nothing has been done with it since.
        if self.capillary().brought() == Some(well) {
            return Ok(());
        }
        let asked_for = self.capillary().asked_for() == Some(well);
        let over = !self.is(run);
        let waits_for_another = self.active.as_ref().is_some_and(|a| a.waiting_for.is_some());
        if let Some(inside) = self.to_be_taken_out()
            // Exchanged in one go while the run is there, and after its end with a word on each.
            && (inside == well || if over { asked_for } else { !asked_for && !waits_for_another })
        {
            return Err(self.capillary_full(inside.to_owned()));
        }
        if self.capillary().inside() == Some(well) {
            return Ok(());
        }
        if !asked_for {
            let ended = Refusal::RunEnded { id: run.to_owned(), outcome: told.outcome };
            return Err(if over { ended } else { self.unexpected(run, well) });
        }
        // A loader that exchanges specimens in one go says only what it has brought: the former is out.
        let in_place_of = self.capillary().inside().map(str::to_owned);
        self.promise_of(self.told_in(run).as_deref(), Some(well), EventData::WellLoaded(WellLoaded { in_place_of }))?;
        let (mut waits, mut waited_for_the_former) = (false, false);
        if let Some(active) = &mut self.active {
            waits = active.waiting_for.take().is_some();
            waited_for_the_former = active.take_out.take().is_some();
        }
        let suspended = status.state == State::Suspended;
        if suspended && waits {
            self.gate.say_loaded(well);
            self.go(Trigger::Loaded);
        } else if suspended && waited_for_the_former {
            self.go(Trigger::Loaded);
            self.proceed();
        } else if over {
            let views_planned = self.store.run(run).ok().flatten().map_or(0, |record| record.method.asd);
            let left = self.left_specimen(views_planned);
            self.publish(|s| s.specimen = left);
        } else {
            // Held it waits for the run to go on, in which it is not brought again; in a run that is ending it is left inside.
            self.publish(|_| ());
        }
        Ok(())
    }

    /// The specimen has been taken out: after its well is done, before a run goes on, or after its run.
    pub(super) fn unloaded(&mut self, run: &str, well: &str) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let newest = status.run.as_ref().map(|r| r.id.clone());
        if newest.as_deref() != Some(run) {
            return Err(Refusal::UnknownRun { id: run.to_owned(), newest });
        }
        if self.capillary().inside() != Some(well) {
            // Said again, or said of a specimen that another has taken the place of; of one that never was inside it is a mistake.
            return if self.capillary().has_held(well) { Ok(()) } else { Err(self.unexpected(run, well)) };
        }
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        if works && status.specimen.as_ref().is_some_and(|s| s.well == well && s.phase != Phase::Eject) {
            return Err(self.unexpected(run, well));
        }
        let was_kept = self.capillary().brought() == Some(well);
        self.promise_of(self.told_in(run).as_deref(), Some(well), EventData::WellUnloaded)?;
        if was_kept && !self.brings_again {
            self.give_up(well, "somebody took its specimen out, and the sampler brings none twice");
        }
        let waited = self.active.as_mut().is_some_and(|a| {
            a.eject_first.take_if(|x| x == well);
            a.take_out.take_if(|x| x == well).is_some()
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

    /// The well whose specimen somebody is asked to take out now.
    fn to_be_taken_out(&self) -> Option<&str> {
        let inside = self.capillary().inside();
        match &self.active {
            Some(active) => active.take_out.as_deref().or_else(|| inside.filter(|_| active.waiting_for.is_some())),
            None => inside,
        }
    }

    /// The run that an event is told in; one that was pruned is not to come back.
    fn told_in(&self, run: &str) -> Option<String> {
        self.store.run_folder(run).is_dir().then(|| run.to_owned())
    }

    /// Refuses a specimen while another is inside, and says whose word is missing.
    pub(super) fn capillary_full(&self, well: String) -> Refusal {
        let run = self.publisher.status().run.as_ref().map_or_else(|| "RUN".to_owned(), |newest| newest.id.clone());
        Refusal::CapillaryFull { run, well }
    }

    /// Refuses a word on a well that nobody asked about, with the word that is waited for.
    fn unexpected(&self, run: &str, well: &str) -> Refusal {
        let say = |well: &str, loaded: bool| format!("PUT /v1/runs/{run}/wells/{well} {{\"loaded\": {loaded}}}");
        let waiting_for = self.active.as_ref().and_then(|a| a.waiting_for.as_deref());
        let instead = match (waiting_for, self.to_be_taken_out(), self.capillary().inside()) {
            (Some(next), ..) => format!("that of well {next} is waited for; once it is in the capillary, say {}", say(next, true)),
            (None, Some(inside), _) => format!("that of well {inside} is to be taken out; once it is, say {}", say(inside, false)),
            (None, None, Some(inside)) => format!("that of well {inside} is in the capillary; wait until plate.needs asks for one"),
            (None, None, None) => "none is in the capillary, as far as is known; wait until plate.needs asks for one".to_owned(),
        };
        Refusal::UnexpectedWell { run: run.to_owned(), well: well.to_owned(), instead }
    }
}
