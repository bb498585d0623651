//! The closed sets of words that records, events and the status share.

use crate::WellStatus;
use serde::{Deserialize, Serialize};

/// Phase within one specimen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    Load,
    Detect,
    Position,
    Revolve,
    Reconstruct,
    Measure,
    Eject,
    Wash,
}

impl Phase {
    /// The word for it in files and events.
    pub fn name(self) -> &'static str {
        match self {
            Self::Load => "load",
            Self::Detect => "detect",
            Self::Position => "position",
            Self::Revolve => "revolve",
            Self::Reconstruct => "reconstruct",
            Self::Measure => "measure",
            Self::Eject => "eject",
            Self::Wash => "wash",
        }
    }
}

/// How a run ended. `null` until it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunOutcome {
    Succeeded,
    Partial,
    Failed,
    Aborted,
    Interrupted,
}

impl RunOutcome {
    /// An empty or skipped well is honest work; a failed one makes the run partial, or failed where none succeeded.
    pub fn of_wells(wells: &[WellStatus]) -> Self {
        let failed = wells.iter().any(|w| w.outcome != Some(SpecimenOutcome::Succeeded) && w.outcome != Some(SpecimenOutcome::Skipped));
        let succeeded = wells.iter().any(|w| w.outcome == Some(SpecimenOutcome::Succeeded));
        match (failed, succeeded) {
            (false, _) => Self::Succeeded,
            (true, true) => Self::Partial,
            (true, false) => Self::Failed,
        }
    }

    /// Of a run that was stopped before all its wells: what has a number stands.
    pub fn of_stopped(wells: &[WellStatus]) -> Self {
        match wells.iter().any(|w| w.outcome == Some(SpecimenOutcome::Succeeded)) {
            _ if wells.iter().all(|w| w.outcome != Some(SpecimenOutcome::Aborted)) => Self::of_wells(wells),
            true => Self::Partial,
            false => Self::Aborted,
        }
    }
}

/// How a specimen ended. `null` until it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpecimenOutcome {
    Succeeded,
    Failed,
    Aborted,
    Interrupted,
    Skipped,
}

/// What the scheduler does about a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SchedulerAction {
    Retry,
    SkipWell,
    RejectPlate,
    AbortPlate,
    PauseInstrument,
    EscalateOperator,
}

/// Whether numbers come from an instrument, from the emulated rig or from imported pictures, of whose origin carved knows
/// nothing; stamped into every output. A daemon's is one of the first two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    Hardware,
    Simulated,
    Imported,
}
