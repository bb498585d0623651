//! The instrument's state machine: pure, one table.
//!
//! ```text
//! Idle ─start─> Starting ─ready─> Execute ─wells done─> Completing ─recorded─> Complete
//!                  ^                │  ^                                          │
//!                  │     wait for   v  │ loaded                                   │
//!                  │      loader  Suspended                                       │
//!                  ├──── Resetting <─start────────────────────────────────────────┘
//!                  └──── Clearing, Resetting <─start─ Aborted <─motors stopped─ Aborting <─abort─ any state of a run
//!     any ─shut down─> Stopping ─everything joined─> Stopped
//! ```
//! A reset for a new run goes on to Starting without PackML's instant of Idle: whoever polls in that instant would read a
//! run that has been accepted as one that is over.

use super::State;

/// What moves the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trigger {
    Start,
    Ready,
    WaitForLoader,
    Loaded,
    WellsDone,
    Recorded,
    Abort,
    MotorsStopped,
    ShutDown,
    Joined,
}

/// States in which a new run is taken.
pub const STARTABLE: [State; 3] = [State::Idle, State::Complete, State::Aborted];

/// Whether a run is under way in this state.
pub fn runs(state: State) -> bool {
    use State::{Completing, Execute, Starting, Suspended};
    matches!(state, Starting | Execute | Suspended | Completing)
}

/// The states that a trigger leads through, in order, each to be published; nothing where the trigger does not apply.
pub fn next(state: State, trigger: Trigger) -> Option<&'static [State]> {
    use State::{Aborted, Aborting, Clearing, Complete, Completing, Execute, Idle, Resetting, Starting, Stopped, Stopping, Suspended};
    Some(match (state, trigger) {
        (Idle, Trigger::Start) => &[Starting],
        (Complete, Trigger::Start) => &[Resetting, Starting],
        (Aborted, Trigger::Start) => &[Clearing, Resetting, Starting],
        (Starting, Trigger::Ready) | (Suspended, Trigger::Loaded) => &[Execute],
        (Execute, Trigger::WaitForLoader) => &[Suspended],
        (Execute, Trigger::WellsDone) => &[Completing],
        (Completing, Trigger::Recorded) => &[Complete],
        (state, Trigger::Abort) if runs(state) => &[Aborting],
        (Aborting, Trigger::MotorsStopped) => &[Aborted],
        (Stopping | Stopped, Trigger::ShutDown) => return None,
        (_, Trigger::ShutDown) => &[Stopping],
        (Stopping, Trigger::Joined) => &[Stopped],
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TRIGGERS: [Trigger; 10] = [
        Trigger::Start,
        Trigger::Ready,
        Trigger::WaitForLoader,
        Trigger::Loaded,
        Trigger::WellsDone,
        Trigger::Recorded,
        Trigger::Abort,
        Trigger::MotorsStopped,
        Trigger::ShutDown,
        Trigger::Joined,
    ];

    proptest! {
        /// Whatever happens in whatever order: an aborted run is never shown as complete, a run's end is reached only
        /// through its closing state, and nothing but the end follows a shut-down.
        #[test]
        fn no_sequence_reads_as_something_it_is_not(sequence in prop::collection::vec(0usize..TRIGGERS.len(), 1..200)) {
            let mut state = State::Idle;
            let (mut aborted, mut shut_down) = (false, false);
            for t in sequence.into_iter().map(|i| TRIGGERS[i]) {
                let Some(path) = next(state, t) else { continue };
                for &to in path {
                    prop_assert!(!shut_down || to == State::Stopped, "after a shut-down came {to:?}");
                    match to {
                        State::Starting => aborted = false,
                        State::Aborting => { prop_assert!(runs(state)); aborted = true; }
                        State::Aborted => prop_assert_eq!(state, State::Aborting),
                        State::Complete => { prop_assert_eq!(state, State::Completing); prop_assert!(!aborted); }
                        State::Stopping => shut_down = true,
                        State::Stopped => prop_assert_eq!(state, State::Stopping),
                        _ => {}
                    }
                    state = to;
                }
            }
        }
    }

    #[test]
    fn a_run_is_taken_in_exactly_the_startable_states() {
        let all = [
            State::Stopped,
            State::Idle,
            State::Starting,
            State::Execute,
            State::Suspended,
            State::Completing,
            State::Complete,
            State::Stopping,
            State::Aborting,
            State::Aborted,
            State::Clearing,
            State::Resetting,
        ];
        for state in all {
            assert_eq!(next(state, Trigger::Start).is_some(), STARTABLE.contains(&state), "{state:?}");
        }
    }
}
