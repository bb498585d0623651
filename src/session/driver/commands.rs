//! Commands: who may ask for what in which state. What was done by a repeat answers as the first did.

use super::super::handle::{Accepted, Command, Refusal, Towards};
use super::super::plan::is_plain_name;
use super::super::state::{HOLDABLE, STARTABLE, STOPPABLE};
use super::super::{FieldError, RunOutcome, RunPlan, State, gate, preflight};
use super::Running;
use crate::store::Budget;
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
            Command::Loaded { run, well, loaded: true, answer } => reply(answer, self.loaded(run, well)),
            Command::Loaded { run, well, loaded: false, answer } => reply(answer, self.unloaded(run, well)),
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
        if let Some(left) = status.specimen.as_ref().filter(|s| s.in_capillary) {
            return Err(Refusal::CapillaryFull { well: left.well.clone() });
        }
        if let Some(inside) = self.plate_inside.as_ref().filter(|inside| **inside != plan.plate_barcode) {
            return Err(Refusal::OtherBarcode { expected: inside.clone(), found: plan.plate_barcode });
        }
        // `check` has looked it up; a plan that names no method never comes here.
        let method = self.config.methods.get(&plan.method).cloned();
        let method =
            method.ok_or_else(|| Refusal::InvalidPlan(vec![FieldError { pointer: "/method".into(), detail: plan.method.clone() }]))?;
        let needed_bytes = preflight::needed_bytes(&self.config, &method, plan.plate_map.len());
        if let Some(free_bytes) = self.store.free_bytes().filter(|free| *free < needed_bytes) {
            return Err(Refusal::WillNotFit { needed_bytes, free_bytes });
        }
        if let Some(why) = self.disk_budget().and_then(|budget| budget.refuses(needed_bytes)) {
            return Err(Refusal::OverBudget { why });
        }
        if self.instrument.is_none() {
            return Err(Refusal::Busy);
        }
        self.start(id, plan, method)?;
        Ok(Accepted::Created)
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
            | (Towards::Hold, State::Holding | State::Held)
            | (Towards::Unhold, State::Unholding | State::Execute | State::Suspending | State::Suspended | State::Unsuspending) => Ok(()),
            (Towards::Abort, _) => {
                self.abort();
                self.on_disk()
            }
            (Towards::Stop, state) if STOPPABLE.contains(&state) => self.stop(),
            (Towards::Stop, _) => wrong(&STOPPABLE),
            (Towards::Hold, state) if HOLDABLE.contains(&state) => self.hold(),
            (Towards::Hold, _) => wrong(&HOLDABLE),
            (Towards::Unhold, State::Held) => self.unhold("operator"),
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
