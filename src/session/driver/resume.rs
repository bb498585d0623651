//! When a held run goes on, and what holds it.

use super::super::Hold;
use super::run::{Request, RunInProgress};
use carved_records::{Fault, OpenFaults, Resume, RunState};

/// A run that has gone on this often without finishing a well waits for a person: the cause comes back.
const RESUMED_BY_ITSELF: u32 = 3;

/// Whether the method of the run lets it go on by itself once what holds it is over.
pub(super) fn is_automatic(run: &RunInProgress, state: Option<&RunState>) -> bool {
    state.map_or(0, RunState::resumed_by_itself) < RESUMED_BY_ITSELF && run.record().method.policy.resume == Resume::Automatic
}

/// Whether a held run goes on without a person: everything that holds it ends by itself, and its method lets it.
pub(super) fn goes_on_by_itself(run: &RunInProgress, state: Option<&RunState>, faults: &OpenFaults) -> bool {
    let is_held_by_something = run.may_go_on() || !faults.open().is_empty();
    let by_operator = state.is_some_and(RunState::is_held_by_operator);
    is_held_by_something && !by_operator && is_automatic(run, state) && faults.open().iter().all(Fault::ends_by_itself)
}

/// Why the run is held, and what to do next, by the same rule by which it goes on.
pub(super) fn hold(run: &RunInProgress, state: Option<&RunState>, faults: &OpenFaults) -> Option<Hold> {
    let known = state?;
    let cause = known.held_by()?;
    let comes_back = known.resumed_by_itself() > 0 && !is_automatic(run, state);
    let ends = matches!(run.request(), Request::Stop | Request::Abort | Request::ShutDown);
    let next_action = match faults.open().last() {
        Some(fault) => Some(fault.what_to_do.clone()),
        None if ends || goes_on_by_itself(run, state, faults) => None,
        None if comes_back => Some("Find out why it comes back. Then let the run go on.".to_owned()),
        None => Some("Let the run go on when you are ready.".to_owned()),
    };
    let times = known.times_held_by(&cause.code).max(1);
    Some(Hold { code: cause.code.clone(), cause: cause.words.clone(), times, next_action })
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::*;
    use carved_records::{EventBody, EventData, HeldBy, InstrumentState, ResumedBy, RunHeld, RunResumed, fault_table};

    /// What events of the run `r1` leave.
    fn after(events: &[EventData]) -> InstrumentState {
        let mut state = InstrumentState { run: Some(RunState::new("r1")), ..InstrumentState::default() };
        for data in events {
            state.apply(&EventBody { time: String::new(), run: Some("r1".into()), well: None, data: data.clone() });
        }
        state
    }

    fn raised(code: &carved_records::FaultCode) -> EventData {
        EventData::FaultRaised(Fault::new(1, code, "found".into(), String::new()))
    }

    fn held() -> EventData {
        EventData::RunHeld(RunHeld { by: HeldBy::Fault, code: Some("rotation_lost".into()), cause: Some("it is away".into()) })
    }

    fn resumed() -> EventData {
        EventData::RunResumed(RunResumed { by: ResumedBy::Instrument })
    }

    #[test]
    fn a_run_goes_on_by_itself_where_no_person_and_no_lasting_fault_holds_it() {
        let r = run(&["A01"]);
        let goes_on = |events: &[EventData], r: &RunInProgress| {
            let state = after(events);
            goes_on_by_itself(r, state.run.as_ref(), &state.faults)
        };
        assert!(goes_on(&[raised(&fault_table::ROTATION_LOST)], &r));
        assert!(!goes_on(&[raised(&fault_table::EMERGENCY_STOP)], &r));
        assert!(!goes_on(&[raised(&fault_table::ROTATION_LOST), EventData::RunHoldRequested], &r));
        assert!(!goes_on(&[], &r), "nothing has ended yet");
        let mut may = run(&["A01"]);
        may.set_may_go_on(true);
        assert!(goes_on(&[], &may));
        let three = [held(), resumed(), held(), resumed(), held(), resumed()];
        assert!(!goes_on(&three, &may), "it comes back each time");
    }

    #[test]
    fn the_next_action_is_the_fault_then_what_the_run_waits_for() {
        let mut r = run(&["A01"]);
        let next = |events: &[EventData], r: &RunInProgress| {
            let state = after(events);
            hold(r, state.run.as_ref(), &state.faults).map(|hold| hold.next_action)
        };
        assert_eq!(next(&[], &r), None, "nothing holds it");
        let by_fault = [held(), raised(&fault_table::ROTATION_LOST)];
        assert_eq!(next(&by_fault, &r), Some(Some(fault_table::ROTATION_LOST.what_to_do.to_owned())));
        assert!(next(&[held()], &r).flatten().unwrap().starts_with("Let the run go on"));
        let three = [held(), resumed(), held(), resumed(), held(), resumed(), held()];
        assert!(next(&three, &r).flatten().unwrap().starts_with("Find out why"));
        r.set_may_go_on(true);
        assert_eq!(next(&[held()], &r), Some(None), "it goes on by itself");
        r.set_may_go_on(false);
        r.ask(Request::Stop);
        assert_eq!(next(&[held()], &r), Some(None), "it ends");
    }
}
