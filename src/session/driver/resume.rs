//! When a held run continues, and the cause of the hold.

use super::super::Hold;
use super::run::{Request, RunInProgress};
use crate::api::NextCommand;
use carved_records::{Fault, FaultCode, FaultEnd, OpenFaults, Resume, RunState, RunUnderFault, fault_table};
use std::time::Duration;

/// Maximum number of automatic continuations without a finished well, except for a hold by the camera (`Policy::held_pause`). After them the run
/// waits for a person, because the cause comes back.
const RESUMED_BY_ITSELF: u32 = 3;

/// Whether the method lets the run continue by itself once the cause of the hold is over, and no fault waits for an operator.
pub(super) fn is_automatic(run: &RunInProgress, state: Option<&RunState>) -> bool {
    let policy = &run.record().method.policy;
    let allows = |state: &RunState| {
        let continued = state.resumed_by_itself();
        let is_held_by_camera = state.held_by().and_then(|cause| fault_table::of(&cause.code)).is_some_and(FaultCode::is_tried_again);
        let may = if is_held_by_camera { policy.held_pause(continued).is_some() } else { continued < RESUMED_BY_ITSELF };
        may && !state.waits_for_operator()
    };
    state.is_none_or(allows) && policy.resume == Resume::Automatic
}

/// Pause after which a run that is held now tries again by itself. `None` where it does not.
pub(super) fn pause(run: &RunInProgress, state: &RunState, faults: &OpenFaults) -> Option<Duration> {
    let is_tried = faults.open().iter().any(Fault::is_tried_again) && goes_on_by_itself(run, Some(state), faults);
    run.record().method.policy.held_pause(state.resumed_by_itself()).filter(|_| is_tried)
}

/// Whether a held run continues without a person: every cause of the hold ends by itself, and the method allows it.
pub(super) fn goes_on_by_itself(run: &RunInProgress, state: Option<&RunState>, faults: &OpenFaults) -> bool {
    let is_held_by_something = run.may_go_on() || faults.open().iter().any(Fault::is_in_the_way);
    let by_operator = state.is_some_and(RunState::is_held_by_operator);
    is_held_by_something
        && !by_operator
        && is_automatic(run, state)
        && faults.open().iter().all(|f| f.ends_by_itself() || f.is_tried_again())
}

/// What the current run does about an open fault. It follows the same rule as the continuation.
pub(super) fn under_fault(run: Option<&RunInProgress>, state: Option<&RunState>, faults: &OpenFaults) -> RunUnderFault {
    match run {
        Some(run) if is_ending(run) => RunUnderFault::None,
        Some(run) if goes_on_by_itself(run, state, faults) => RunUnderFault::GoesOnByItself,
        Some(_) => RunUnderFault::Waits,
        None => RunUnderFault::None,
    }
}

fn is_ending(run: &RunInProgress) -> bool {
    matches!(run.request(), Request::Stop | Request::Abort | Request::ShutDown)
}

/// Why the run is held, and the next action. It follows the same rule as the continuation.
pub(super) fn hold(run: &RunInProgress, state: Option<&RunState>, faults: &OpenFaults) -> Option<Hold> {
    let known = state?;
    let cause = known.held_by()?;
    let comes_back = known.resumed_by_itself() >= RESUMED_BY_ITSELF;
    let under = under_fault(Some(run), state, faults);
    // A fault that needs an operator comes first: the run cannot continue before it is acknowledged. Of these, one that a command ends.
    let stands = || faults.open().iter().filter(|f| f.operator_required);
    let newest = || faults.open().iter().rfind(|f| f.is_in_the_way());
    let fault = stands().find(|f| !f.ends_by_itself()).or_else(|| stands().next()).or_else(newest);
    let (next_action, next_command) = match (fault, under) {
        (Some(fault), _) => {
            let advice = fault.advice(under);
            match fault.end() {
                FaultEnd::Acknowledgement => (Some(advice), Some(NextCommand::Acknowledge)),
                // It is over after a start.
                FaultEnd::Restart => {
                    (Some(format!("{advice} If you end the run, acknowledge the fault too.")), Some(NextCommand::Acknowledge))
                }
                // Also before the pause is over.
                FaultEnd::Resumption if under != RunUnderFault::None => (Some(advice), Some(NextCommand::Unhold)),
                FaultEnd::Cause | FaultEnd::Resumption => (Some(advice), None),
            }
        }
        (None, RunUnderFault::None | RunUnderFault::GoesOnByItself) => (None, None),
        (None, RunUnderFault::Waits) if comes_back => {
            (Some("Find out why it comes back. Then let the run go on.".to_owned()), Some(NextCommand::Unhold))
        }
        (None, RunUnderFault::Waits) => (Some("Let the run go on when you are ready.".to_owned()), Some(NextCommand::Unhold)),
    };
    let times = known.times_held_by(&cause.code).max(1);
    let fault_seq = fault.map(|fault| fault.seq);
    let next_try = run.tries_again_at().filter(|_| under == RunUnderFault::GoesOnByItself).map(|at| at.to_string());
    Some(Hold { code: cause.code.clone(), cause: cause.words.clone(), times, next_action, next_command, fault_seq, next_try })
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::*;
    use carved_records::{Asked, EventBody, EventData, HeldBy, InstrumentState, ResumedBy, RunHeld, RunResumed, fault_table};

    /// The state after these events of the run `r1`.
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
        EventData::RunHeld(RunHeld { by: HeldBy::Fault, code: Some("camera_lost".into()), cause: Some("it is away".into()) })
    }

    fn resumed() -> EventData {
        EventData::RunResumed(RunResumed { by: ResumedBy::Instrument, name: None, from: None })
    }

    #[test]
    fn a_run_goes_on_by_itself_where_no_person_and_no_lasting_fault_holds_it() {
        let r = run(&["A01"]);
        let goes_on = |events: &[EventData], r: &RunInProgress| {
            let state = after(events);
            goes_on_by_itself(r, state.run.as_ref(), &state.faults)
        };
        assert!(goes_on(&[raised(&fault_table::CAMERA_LOST)], &r));
        assert!(goes_on(&[raised(&fault_table::CAMERA_NO_FRAME)], &r), "after a pause");
        assert!(!goes_on(&[raised(&fault_table::ROTATION_LOST)], &r), "the axis may have lost its power");
        assert!(!goes_on(&[raised(&fault_table::EMERGENCY_STOP)], &r));
        assert!(!goes_on(&[raised(&fault_table::CAMERA_LOST), EventData::RunHoldRequested(Asked::default())], &r));
        assert!(!goes_on(&[], &r), "nothing has ended yet");
        let mut may = run(&["A01"]);
        may.set_may_go_on(true);
        assert!(goes_on(&[], &may));
        let three = [held(), resumed(), held(), resumed(), held(), resumed()];
        assert!(!goes_on(&three, &may), "it comes back each time");
    }

    /// For every cause of a hold, the text, the person who must act and the command agree with whether the run continues by itself.
    #[test]
    fn the_next_action_agrees_with_the_hold() {
        let three = [held(), resumed(), held(), resumed(), held(), resumed(), held()];
        // A slow disk holds no run.
        for code in carved_records::FAULT_CODES.iter().filter(|code| code.code != fault_table::DISK_SLOW.code) {
            for (before, comes_back) in [(&three[..1], false), (&three[..], true)] {
                let events = [before, &[raised(code)]].concat();
                let (r, state) = (run(&["A01"]), after(&events));
                let goes_on = goes_on_by_itself(&r, state.run.as_ref(), &state.faults);
                let hold = hold(&r, state.run.as_ref(), &state.faults).unwrap();
                let fault = &state.faults.open()[0];
                let next = hold.next_action.unwrap();
                assert_eq!(goes_on, (fault.lets_run_go_on() || code.is_tried_again()) && !comes_back, "{}", code.code);
                assert_eq!(next.contains("continues by itself"), goes_on, "{}: {next}", code.code);
                let needs_a_person = fault.needs_a_person(under_fault(Some(&r), state.run.as_ref(), &state.faults));
                assert_eq!(needs_a_person, !(code.is_tried_again() && goes_on), "{}", code.code);
                let command = match fault.end() {
                    FaultEnd::Acknowledgement | FaultEnd::Restart => Some(NextCommand::Acknowledge),
                    FaultEnd::Resumption => Some(NextCommand::Unhold),
                    FaultEnd::Cause => None,
                };
                assert_eq!((hold.next_command, hold.fault_seq), (command, Some(1)), "{}: not while the cause stands", code.code);
            }
        }
        let (r, state) = (run(&["A01"]), after(&three));
        let over = hold(&r, state.run.as_ref(), &state.faults).unwrap();
        assert_eq!((over.next_command, over.fault_seq, over.times), (Some(NextCommand::Unhold), None, 4));
    }

    /// A frame that does not come while nobody is there: the pauses grow, and a person is asked for only after the last try.
    #[test]
    fn the_camera_is_tried_again_after_pauses_that_grow_until_a_person_is_asked_for() {
        let held_by_camera = EventData::RunHeld(RunHeld {
            by: HeldBy::Fault,
            code: Some(fault_table::CAMERA_NO_FRAME.code.into()),
            cause: Some("no frame came".into()),
        });
        let r = run(&["A01"]);
        let mut events = Vec::new();
        let mut pauses = Vec::new();
        loop {
            events.extend([raised(&fault_table::CAMERA_NO_FRAME), held_by_camera.clone()]);
            let state = after(&events);
            let known = state.run.as_ref();
            let under = under_fault(Some(&r), known, &state.faults);
            let Some(pause) = pause(&r, known.unwrap(), &state.faults) else {
                assert_eq!(under, RunUnderFault::Waits);
                assert!(state.faults.open()[0].needs_a_person(under));
                break;
            };
            assert_eq!(under, RunUnderFault::GoesOnByItself);
            assert!(!state.faults.open()[0].needs_a_person(under));
            pauses.push(pause.as_secs());
            events.push(resumed());
        }
        assert_eq!(pauses, [60, 120, 240, 480, 960]);
        let by_operator = after(&[raised(&fault_table::CAMERA_NO_FRAME), EventData::RunHoldRequested(Asked::default())]);
        assert_eq!(pause(&r, by_operator.run.as_ref().unwrap(), &by_operator.faults), None);
        let with_stop = after(&[raised(&fault_table::CAMERA_NO_FRAME), raised(&fault_table::EMERGENCY_STOP)]);
        assert_eq!(pause(&r, with_stop.run.as_ref().unwrap(), &with_stop.faults), None);
    }

    /// Of every two faults, held by an operator too, or by a cause that comes back.
    #[test]
    fn the_next_command_is_named_in_every_state_that_waits_for_one() {
        let three = [held(), resumed(), held(), resumed(), held(), resumed(), held()];
        let numbered = |seq, code| EventData::FaultRaised(Fault::new(seq, code, "found".into(), String::new()));
        let none: &[EventData] = &[];
        for before in [&three[..1], &three[..]] {
            for by_operator in [none, &[EventData::RunHoldRequested(Asked::default())]] {
                for first in carved_records::FAULT_CODES {
                    for second in carved_records::FAULT_CODES {
                        let events = [before, by_operator, &[numbered(1, first), numbered(2, second)]].concat();
                        let state = after(&events);
                        let hold = hold(&run(&["A01"]), state.run.as_ref(), &state.faults).unwrap();
                        let stands = state.faults.open().iter().find(|f| f.operator_required && !f.ends_by_itself());
                        let expected = match stands {
                            Some(fault) => (Some(NextCommand::Acknowledge), Some(fault.seq)),
                            None if state.faults.open().iter().any(|f| f.ends_by_itself() && f.is_in_the_way()) => (None, hold.fault_seq),
                            None => (Some(NextCommand::Unhold), hold.fault_seq),
                        };
                        assert_eq!((hold.next_command, hold.fault_seq), expected, "{}, {}", first.code, second.code);
                        let says = hold.next_action.unwrap();
                        assert!(expected.0 != Some(NextCommand::Acknowledge) || says.contains("cknowledge"), "{says}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_next_action_is_the_fault_then_what_the_run_waits_for() {
        let mut r = run(&["A01"]);
        let next = |events: &[EventData], r: &RunInProgress| {
            let state = after(events);
            hold(r, state.run.as_ref(), &state.faults).map(|hold| hold.next_action)
        };
        assert_eq!(next(&[], &r), None, "nothing holds it");
        let slow = raised(&fault_table::DISK_SLOW);
        assert_eq!(next(std::slice::from_ref(&slow), &r), None, "a slow disk holds it");
        assert!(next(&[held(), slow], &r).flatten().unwrap().starts_with("Let the run go on"), "a slow disk is not why it is held");
        let by_fault = [held(), raised(&fault_table::CAMERA_LOST)];
        assert_eq!(next(&by_fault, &r).flatten(), Some(fault_table::CAMERA_LOST.what_to_do()), "it goes on by itself");
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
