//! The state machine of the instrument: one table of pure transitions, with the state names of PackML.
//!
//! ```text
//! Idle ─start─> Starting ─ready─> Execute ─wells done─> Completing ─recorded─> Complete ─┐
//!                  ^              │  ^  ^ │                                              │ start: Resetting,
//!                  │  Suspending  │  │  │ └ Holding ─specimen done─> Held                │ after Aborted first
//!                  │  Suspended <─┘  │  └── Unholding <──unhold───────┘                  │ Clearing
//!                  │  Unsuspending ──┘                                                   │
//!                  └─────────────────────────────────────────────────────────────────────┤
//!     any state of a run ─stop──> Stopping ─record closed──> Stopped ────────────────────┤
//!     any state          ─abort─> Aborting ─motors stopped─> Aborted ────────────────────┘
//!     any state of a run ─shut down─> Stopping ─everything joined─> Stopped, or Aborted after an emergency stop
//! ```
//! Held is caused by the operator or by a fault, Suspended by waiting for the loader. A reset for a new run skips PackML's short Idle: a
//! client that polls at this moment would take the accepted run for one that has ended.

use super::State;

/// Causes of transitions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trigger {
    Start,
    /// A run is taken up that was open when the daemon restarted.
    TakeUp,
    /// The worker has the instrument, and the camera is armed.
    Ready,
    WaitForLoader,
    Loaded,
    /// Requested by an operator, or caused by a fault.
    Hold,
    /// The worker has returned the instrument.
    Rested,
    Unhold,
    WellsDone,
    Recorded,
    Stop,
    Abort,
    MotorsStopped,
    ShutDown,
    Joined,
}

/// States in which a new run is accepted.
pub const STARTABLE: [State; 4] = [State::Idle, State::Complete, State::Stopped, State::Aborted];

/// States in which a run can be held.
pub const HOLDABLE: [State; 6] =
    [State::Starting, State::Execute, State::Suspending, State::Suspended, State::Unsuspending, State::Unholding];

/// States in which a run can be stopped.
pub const STOPPABLE: [State; 8] = [
    State::Starting,
    State::Execute,
    State::Suspending,
    State::Suspended,
    State::Unsuspending,
    State::Unholding,
    State::Holding,
    State::Held,
];

/// The state of the instrument. Transitions of the table change it, and a start restores it.
#[derive(Debug)]
pub struct Machine(State);

impl Default for Machine {
    fn default() -> Self {
        Self(State::Idle)
    }
}

impl Machine {
    /// The state now.
    pub fn state(&self) -> State {
        self.0
    }

    /// Enters a state on the way of a transition, or the one in which the newest run has ended before a restart.
    pub fn enter(&mut self, state: State) {
        self.0 = state;
    }
}

/// Whether a run is in progress or held in this state.
#[cfg(test)]
fn runs(state: State) -> bool {
    STOPPABLE.contains(&state) || state == State::Completing
}

/// The states that a trigger leads through, in order. Each is published. `None` if the trigger does not apply.
pub fn next(state: State, trigger: Trigger) -> Option<&'static [State]> {
    use State::{
        Aborted, Aborting, Clearing, Complete, Completing, Execute, Held, Holding, Idle, Resetting, Starting, Stopped, Stopping, Suspended,
        Suspending, Unholding, Unsuspending,
    };
    Some(match (state, trigger) {
        (Idle, Trigger::Start) => &[Starting],
        (Complete | Stopped, Trigger::Start) => &[Resetting, Starting],
        (Aborted, Trigger::Start) => &[Clearing, Resetting, Starting],
        (Idle, Trigger::TakeUp) | (Holding, Trigger::Rested) => &[Held],
        (Starting | Unholding, Trigger::Ready) => &[Execute],
        (Execute | Unholding, Trigger::WaitForLoader) => &[Suspending, Suspended],
        (Suspended, Trigger::Loaded) => &[Unsuspending, Execute],
        (state, Trigger::Hold) if HOLDABLE.contains(&state) || state == Completing => &[Holding],
        (Held, Trigger::Unhold) => &[Unholding],
        (Starting | Execute | Unholding | Holding, Trigger::WellsDone) => &[Completing],
        (Completing, Trigger::Recorded) => &[Complete],
        (state, Trigger::Stop) if STOPPABLE.contains(&state) => &[Stopping],
        (Aborting | Aborted | Clearing | Resetting, Trigger::Abort) => return None,
        (_, Trigger::Abort) => &[Aborting],
        (Aborting, Trigger::MotorsStopped) => &[Aborted],
        (Stopping | Aborting, Trigger::ShutDown) => &[],
        // Without a run there is nothing to stop.
        (state, Trigger::ShutDown | Trigger::Joined) if STARTABLE.contains(&state) => &[],
        (_, Trigger::ShutDown) => &[Stopping],
        (Stopping, Trigger::Joined) => &[Stopped],
        _ => return None,
    })
}

#[cfg(test)]
pub(super) mod tests;
