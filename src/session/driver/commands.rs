//! Commands: who may ask for what in which state. What was done by a repeat answers as the first did.

use super::super::handle::{Accepted, Command, Refusal, Towards};
use super::super::state::{HOLDABLE, STARTABLE, STOPPABLE};
use super::super::{State, gate, preflight};
use super::Running;
use carved_records::{FieldError, ResumedBy, RunOutcome, RunPlan, is_plain_name};
use carved_store::Budget;
use tokio::sync::oneshot;

/// A client that hung up before its answer is no reason to stop: what was decided stands.
fn reply<T>(answer: oneshot::Sender<Result<T, Refusal>>, result: Result<T, Refusal>) {
    let _hung_up = answer.send(result);
}

impl Running {
    pub(super) fn command(&mut self, command: Command) {
        match command {
            Command::PutRun { id, plan, answer } => reply(answer, self.put_run(&id, plan)),
            Command::Steer { id, towards, answer } => reply(answer, self.steer(&id, towards)),
            Command::EmergencyStop { answer } => reply(answer, self.emergency_stopped()),
            Command::Acknowledge { seq, answer } => reply(answer, self.acknowledge(seq)),
            Command::Loaded { run, well, loaded: true, answer } => reply(answer, self.loaded(&run, &well)),
            Command::Loaded { run, well, loaded: false, answer } => reply(answer, self.unloaded(&run, &well)),
            Command::Handoff { plate, answer } => reply(answer, self.handoff(plate)),
            Command::EndHandoff { end, answer } => reply(answer, self.end_handoff(end)),
            Command::Preflight { plan, answer } => self.preflight(plan, answer),
        }
    }

    fn put_run(&mut self, id: &str, plan: RunPlan) -> Result<Accepted, Refusal> {
        if !is_plain_name(id) {
            let detail = format!("{id:?} is not a run's name: use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'");
            return Err(Refusal::InvalidPlan(vec![FieldError { pointer: "/run_id".into(), detail }]));
        }
        if let Some(known) = self.store.run(id).map_err(Refusal::from)? {
            return if known.plan == plan { Ok(Accepted::Same) } else { Err(Refusal::OtherPlan { id: id.to_owned() }) };
        }
        if self.store.reader().was_accepted(id).unwrap_or(false) {
            return Err(Refusal::Pruned { id: id.to_owned() });
        }
        plan.check(&self.config.methods).map_err(Refusal::InvalidPlan)?;
        gate::refuses(&self.config, self.mode, &plan).map_or(Ok(()), |mistake| Err(Refusal::InvalidPlan(vec![mistake])))?;
        let status = self.publisher.status();
        if self.active.is_some() || !STARTABLE.contains(&status.state) {
            return Err(Refusal::WrongState { state: status.state, accepted_in: STARTABLE.to_vec() });
        }
        self.nothing_stands_in_the_way()?;
        if let Some(left) = self.left_for_the_loader() {
            return Err(self.capillary_full(left.to_owned()));
        }
        if let Some(open) = self.state().plate.open() {
            return Err(Refusal::HandoffOpen { barcode: open.barcode.clone() });
        }
        if let Some(inside) = self.state().plate.inside().filter(|inside| *inside != plan.plate_barcode) {
            return Err(Refusal::OtherBarcode { expected: inside.to_owned(), found: plan.plate_barcode });
        }
        // `check` has looked it up; a plan that names no method never comes here.
        let method = self.config.methods.get(&plan.method).cloned();
        let method =
            method.ok_or_else(|| Refusal::InvalidPlan(vec![FieldError { pointer: "/method".into(), detail: plan.method.clone() }]))?;
        if self.instrument.is_none() {
            return Err(Refusal::Busy);
        }
        self.has_room_for(preflight::needed_bytes(&self.config, &method, plan.plate_map.len()))?;
        self.start(id, plan, method)?;
        Ok(Accepted::Created)
    }

    /// Refuses what would not fit on the disk, or into its budget.
    fn has_room_for(&self, needed_bytes: u64) -> Result<(), Refusal> {
        if let Some(free_bytes) = self.store.free_bytes().filter(|free| *free < needed_bytes) {
            return Err(Refusal::WillNotFit { needed_bytes, free_bytes });
        }
        self.disk_budget().and_then(|budget| budget.refuses(needed_bytes)).map_or(Ok(()), |why| Err(Refusal::OverBudget { why }))
    }

    /// Why not even the smallest run would be taken: one well of the method that takes least.
    pub(super) fn lacks_room(&self) -> Option<String> {
        let least_bytes = self.config.methods.values().map(|method| preflight::needed_bytes(&self.config, method, 1)).min();
        self.has_room_for(least_bytes?).err().map(|refusal| format!("one well: {refusal}"))
    }

    /// At rest others may fill the disk, or make room on it.
    pub(super) fn look_for_room(&mut self) {
        let no_room = if self.active.is_none() { self.lacks_room() } else { None };
        // Its numbers change all the time; whether there is room does not.
        if no_room.is_some() != self.no_room.is_some() {
            self.no_room = no_room;
            self.publish(|_| ());
        }
    }

    /// What runs have taken and may take; a budget that cannot be counted refuses nothing.
    pub(super) fn disk_budget(&self) -> Option<Budget> {
        let budget_gb = self.config.store.budget_gb?;
        let counted = self.store.budget(Some(budget_gb));
        counted.inspect_err(|error| tracing::warn!(%error, "the disk's budget is not counted")).ok()
    }

    fn steer(&mut self, id: &str, towards: Towards) -> Result<(), Refusal> {
        if !self.is(id) {
            return self.steer_ended(id, towards);
        }
        let now = self.publisher.status().state;
        let wrong = |accepted_in: &[State]| Err(Refusal::WrongState { state: now, accepted_in: accepted_in.to_vec() });
        match (towards, now) {
            (Towards::Abort, State::Aborting)
            | (Towards::Stop, State::Stopping)
            | (Towards::Unhold, State::Unholding | State::Execute | State::Suspending | State::Suspended | State::Unsuspending) => Ok(()),
            (Towards::Abort, _) => {
                self.abort();
                self.on_disk()
            }
            (Towards::Stop, state) if STOPPABLE.contains(&state) => self.stop(),
            (Towards::Stop, _) => wrong(&STOPPABLE),
            // What a fault holds an operator may hold as well: it then does not go on by itself.
            (Towards::Hold, state) if HOLDABLE.contains(&state) || matches!(state, State::Holding | State::Held) => self.hold(state),
            (Towards::Hold, _) => wrong(&HOLDABLE),
            (Towards::Unhold, State::Held) => self.unhold(ResumedBy::Operator),
            (Towards::Unhold, _) => wrong(&[State::Held]),
        }
    }

    /// A repeat after the end moves towards a state that is reached already.
    fn steer_ended(&self, id: &str, towards: Towards) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let stopped = || status.state == State::Stopped && status.run.as_ref().is_some_and(|r| r.id == id);
        match self.store.run(id) {
            Ok(Some(run)) if towards == Towards::Abort && run.outcome == Some(RunOutcome::Aborted) => Ok(()),
            Ok(Some(_)) if towards == Towards::Stop && stopped() => Ok(()),
            Ok(Some(run)) => Err(Refusal::RunEnded { id: run.id, outcome: run.outcome }),
            Ok(None) => Err(Refusal::UnknownRun { id: id.to_owned(), newest: status.run.as_ref().map(|r| r.id.clone()) }),
            Err(e) => Err(e.into()),
        }
    }
}
