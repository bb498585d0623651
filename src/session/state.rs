//! The instrument's state machine: pure, one table, PackML's words.
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
//!     any state          ─shut down─> Stopping ─everything joined─> Stopped
//! ```
//! Held is by the operator or by a fault, Suspended by waiting for the loader. A reset for a new run goes on to Starting without
//! PackML's instant of Idle: whoever polls in that instant would read a run that has been accepted as one that is over.

use super::State;

/// What moves the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trigger {
    Start,
    /// A run that an earlier life of the daemon left open is there again.
    TakeUp,
    /// The worker has the instrument, and the camera is armed.
    Ready,
    WaitForLoader,
    Loaded,
    /// An operator's wish, or a fault.
    Hold,
    /// The worker has handed the instrument back.
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

/// States in which a new run is taken.
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

/// Whether a run goes on in this state, or could.
#[cfg(test)]
fn runs(state: State) -> bool {
    STOPPABLE.contains(&state) || state == State::Completing
}

/// The states that a trigger leads through, in order, each to be published; nothing where the trigger does not apply.
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
        (Stopping, Trigger::ShutDown) => &[],
        (_, Trigger::ShutDown) => &[Stopping],
        (Stopping, Trigger::Joined) => &[Stopped],
        _ => return None,
    })
}

#[cfg(test)]
pub(super) mod tests;
