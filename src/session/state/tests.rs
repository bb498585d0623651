//! Compares the table with an independent model of what a client may see of a run.

use super::*;
use proptest::prelude::*;

const TRIGGERS: [Trigger; 15] = [
    Trigger::Start,
    Trigger::TakeUp,
    Trigger::Ready,
    Trigger::WaitForLoader,
    Trigger::Loaded,
    Trigger::Hold,
    Trigger::Rested,
    Trigger::Unhold,
    Trigger::WellsDone,
    Trigger::Recorded,
    Trigger::Stop,
    Trigger::Abort,
    Trigger::MotorsStopped,
    Trigger::ShutDown,
    Trigger::Joined,
];

pub(in crate::session) const ALL: [State; 17] = State::ALL;

/// The client's view of a run, independent of the table: three facts and how they change.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
struct Run {
    /// Accepted and without an outcome.
    open: bool,
    /// The end was requested. The run cannot continue.
    ending: bool,
    ends: u32,
}

impl Run {
    /// A client sees this state next.
    fn sees(&mut self, to: State) {
        match to {
            State::Starting | State::Held if !self.open => *self = Self { open: true, ..*self },
            State::Stopping | State::Aborting => self.ending = true,
            State::Complete | State::Stopped | State::Aborted => {
                self.ends += u32::from(self.open);
                *self = Self { open: false, ending: false, ..*self };
            }
            _ => {}
        }
    }
}

proptest! {
    /// In any sequence: between acceptance and end a run is never shown as idle or finished, it ends once, a requested end is not revoked,
    /// and states follow each other only as allowed.
    #[test]
    fn no_sequence_reads_as_something_it_is_not(sequence in prop::collection::vec(0usize..TRIGGERS.len(), 1..200)) {
        let mut state = State::Idle;
        let mut run = Run::default();
        let mut accepted = 0;
        for t in sequence.into_iter().map(|i| TRIGGERS[i]) {
            let Some(path) = next(state, t) else { continue };
            accepted += u32::from(matches!(t, Trigger::Start | Trigger::TakeUp));
            for &to in path {
                let before = run;
                run.sees(to);
                let finished = matches!(to, State::Idle | State::Complete | State::Stopped | State::Aborted);
                prop_assert!(!(run.open && finished), "{state:?} -> {to:?} reads as over while {run:?}");
                let between = matches!(to, State::Stopping | State::Aborting | State::Clearing | State::Resetting);
                prop_assert!(run.open || finished || between, "{state:?} -> {to:?} reads as a run while {run:?}");
                prop_assert!(to != State::Idle, "nothing goes back to Idle: it would read as a run that never was");
                if before.open && before.ending {
                    prop_assert!(
                        matches!(to, State::Stopping | State::Stopped | State::Aborting | State::Aborted),
                        "an end that was asked for became {to:?}"
                    );
                }
                match to {
                    State::Complete => prop_assert_eq!(state, State::Completing),
                    State::Aborted => prop_assert_eq!(state, State::Aborting),
                    State::Stopped => prop_assert_eq!(state, State::Stopping),
                    State::Held => prop_assert!(matches!(state, State::Holding | State::Idle)),
                    State::Suspended => prop_assert_eq!(state, State::Suspending),
                    // From the states that lead to the wells.
                    State::Execute => prop_assert!(matches!(state, State::Starting | State::Unholding | State::Unsuspending)),
                    _ => {}
                }
                state = to;
            }
            prop_assert!(run.ends <= accepted, "{} ends of {accepted} runs", run.ends);
        }
    }
}

#[test]
fn a_run_is_taken_in_exactly_the_startable_states() {
    for state in ALL {
        assert_eq!(next(state, Trigger::Start).is_some(), STARTABLE.contains(&state), "{state:?}");
    }
}

#[test]
fn a_run_can_be_held_stopped_and_aborted_wherever_it_is() {
    for state in ALL.into_iter().filter(|s| runs(*s)) {
        assert_eq!(next(state, Trigger::Abort), Some(&[State::Aborting][..]), "{state:?}");
        let (holdable, stoppable) = (HOLDABLE.contains(&state), STOPPABLE.contains(&state));
        assert!(holdable || matches!(state, State::Holding | State::Held | State::Completing), "{state:?}");
        assert_eq!(next(state, Trigger::Stop).is_some(), stoppable, "{state:?}");
        // A fault also holds a run whose record is being closed.
        assert_eq!(next(state, Trigger::Hold).is_some(), holdable || state == State::Completing, "{state:?}");
    }
    for state in ALL {
        assert!(next(state, Trigger::ShutDown).is_some(), "{state:?}");
    }
}

/// Each acting state of PackML must be left by a trigger, or it would be a dead end.
#[test]
fn no_state_of_a_run_is_a_dead_end() {
    for state in ALL.into_iter().filter(|s| runs(*s)) {
        let ways = TRIGGERS.iter().filter(|t| !matches!(t, Trigger::Abort | Trigger::Stop | Trigger::ShutDown | Trigger::Hold));
        let transient = matches!(state, State::Suspending | State::Unsuspending);
        assert!(transient || ways.clone().any(|t| next(state, *t).is_some()), "{state:?}");
    }
}
