//! Which commands a state accepts. A repeated command gets the same answer as the first one.

use super::super::State;
use super::super::handle::{Refusal, Towards};
use super::super::state::{HOLDABLE, STARTABLE, STOPPABLE};
use carved_records::{FieldError, PlateHandover, RunOutcome, RunPlan, is_plain_name};
use carved_store::RunRecord;
use tokio::sync::oneshot;

/// A client may disconnect before its answer. The decision still stands.
pub(super) fn reply<T>(answer: oneshot::Sender<Result<T, Refusal>>, result: Result<T, Refusal>) {
    let _hung_up = answer.send(result);
}

/// Whether a command to the current run changes its state. `false` if the run is in that state, or on its way to it.
///
/// # Errors
/// The state does not accept the command.
pub(super) fn steer(towards: Towards, now: State) -> Result<bool, Refusal> {
    let accepted = |accepted: bool, accepted_in: &[State]| {
        if accepted { Ok(true) } else { Err(Refusal::WrongState { state: now, accepted_in: accepted_in.to_vec() }) }
    };
    match (towards, now) {
        (Towards::Abort, State::Aborting)
        | (Towards::Stop, State::Stopping)
        | (Towards::Unhold, State::Unholding | State::Execute | State::Suspending | State::Suspended | State::Unsuspending) => Ok(false),
        (Towards::Abort, _) => Ok(true),
        (Towards::Stop, state) => accepted(STOPPABLE.contains(&state), &STOPPABLE),
        // An operator may also hold a run that a fault holds. It then does not continue by itself.
        (Towards::Hold, state) => accepted(HOLDABLE.contains(&state) || matches!(state, State::Holding | State::Held), &HOLDABLE),
        (Towards::Unhold, state) => accepted(state == State::Held, &[State::Held]),
    }
}

/// Answers a command to a run that has ended. `Ok` if the run has reached the requested state: then the command is a repeat. `stored`: the
/// run of this name. `newest` and `now`: the run and the state that the status shows.
///
/// # Errors
/// The run has ended in another way, or there is no such run.
pub(super) fn steer_ended(id: &str, towards: Towards, stored: Option<RunRecord>, newest: Option<&str>, now: State) -> Result<(), Refusal> {
    let Some(run) = stored else {
        return Err(Refusal::UnknownRun { id: id.to_owned(), newest: newest.map(str::to_owned) });
    };
    let repeated = match towards {
        Towards::Abort => run.outcome == Some(RunOutcome::Aborted),
        Towards::Stop => now == State::Stopped && newest == Some(id),
        Towards::Hold | Towards::Unhold => false,
    };
    if repeated { Ok(()) } else { Err(Refusal::RunEnded { id: run.id, outcome: run.outcome }) }
}

/// Refuses an invalid name of a run.
///
/// # Errors
/// States the rule for names.
pub(super) fn check_run_name(id: &str) -> Result<(), Refusal> {
    if is_plain_name(id) {
        return Ok(());
    }
    let detail = format!("{id:?} is not a run's name: use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'");
    Err(Refusal::InvalidPlan(vec![FieldError { pointer: "/run_id".into(), detail }]))
}

/// The refusal of a plan whose method is not configured.
pub(super) fn unknown_method(plan: &RunPlan) -> Refusal {
    Refusal::InvalidPlan(vec![FieldError { pointer: "/method".into(), detail: plan.method.clone() }])
}

/// Refuses a new run while another one is in progress.
///
/// # Errors
/// Names the states that accept a run.
pub(super) fn check_startable(has_run: bool, state: State) -> Result<(), Refusal> {
    if !has_run && STARTABLE.contains(&state) { Ok(()) } else { Err(Refusal::WrongState { state, accepted_in: STARTABLE.to_vec() }) }
}

/// Refuses a plan during a plate handover, and a plan for another plate than the one that was handed over.
///
/// # Errors
/// Names the plate that is expected.
pub(super) fn check_plate(plan: &RunPlan, plate: &PlateHandover) -> Result<(), Refusal> {
    if let Some(open) = plate.open() {
        return Err(Refusal::HandoffOpen { barcode: open.barcode.clone() });
    }
    match plate.handed_over().filter(|inside| *inside != plan.plate_barcode) {
        Some(inside) => Err(Refusal::OtherBarcode { expected: inside.to_owned(), found: plan.plate_barcode.clone() }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::*;
    use crate::session::state::tests::ALL;

    #[test]
    fn a_run_is_moved_from_the_states_that_the_machine_has_a_way_from() {
        for state in ALL {
            let hold = HOLDABLE.contains(&state) || matches!(state, State::Holding | State::Held);
            assert_eq!(steer(Towards::Hold, state).is_ok(), hold, "{state:?}");
            let stop = STOPPABLE.contains(&state) || state == State::Stopping;
            assert_eq!(steer(Towards::Stop, state).is_ok(), stop, "{state:?}");
            assert!(steer(Towards::Abort, state).is_ok(), "{state:?}");
            assert_eq!(steer(Towards::Unhold, state) == Ok(true), state == State::Held, "{state:?}");
        }
        for (towards, state) in [(Towards::Abort, State::Aborting), (Towards::Stop, State::Stopping), (Towards::Unhold, State::Execute)] {
            assert_eq!(steer(towards, state), Ok(false), "a repeat");
        }
        let Err(Refusal::WrongState { accepted_in, .. }) = steer(Towards::Hold, State::Completing) else { panic!("it is held") };
        assert_eq!(accepted_in, HOLDABLE);
    }

    #[test]
    fn a_repeat_after_the_end_is_answered_as_the_first_one_was() {
        let mut record = run(&["A01"]).record().clone();
        record.outcome = Some(RunOutcome::Aborted);
        let aborted = |towards, newest, now| steer_ended("r1", towards, Some(record.clone()), newest, now);
        assert_eq!(aborted(Towards::Abort, Some("r2"), State::Complete), Ok(()));
        assert_eq!(aborted(Towards::Stop, Some("r1"), State::Stopped), Ok(()), "stopped before its first number");
        assert!(matches!(aborted(Towards::Stop, Some("r2"), State::Stopped), Err(Refusal::RunEnded { .. })));
        assert!(matches!(aborted(Towards::Unhold, Some("r1"), State::Aborted), Err(Refusal::RunEnded { .. })));
        let unknown = steer_ended("r1", Towards::Abort, None, Some("r2"), State::Idle);
        assert_eq!(unknown, Err(Refusal::UnknownRun { id: "r1".into(), newest: Some("r2".into()) }));
    }
}
