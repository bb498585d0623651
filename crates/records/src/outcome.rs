//! Enums that records, events and the status share.

use crate::WellStatus;
use serde::{Deserialize, Serialize};

/// Phase within one specimen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
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
    /// The name in files and events.
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

/// How a run ended. `null` while it is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum RunOutcome {
    Succeeded,
    Partial,
    Failed,
    Aborted,
    Interrupted,
}

impl RunOutcome {
    /// Empty and skipped wells count as success. A failed well makes the run partial, or failed if no well succeeded.
    pub fn of_wells(wells: &[WellStatus]) -> Self {
        let failed = wells.iter().any(|w| w.outcome != Some(SpecimenOutcome::Succeeded) && w.outcome != Some(SpecimenOutcome::Skipped));
        let succeeded = wells.iter().any(|w| w.outcome == Some(SpecimenOutcome::Succeeded));
        match (failed, succeeded) {
            (false, _) => Self::Succeeded,
            (true, true) => Self::Partial,
            (true, false) => Self::Failed,
        }
    }

    /// The outcome of a run that was stopped before its last well. Wells with numbers make it partial.
    pub fn of_stopped(wells: &[WellStatus]) -> Self {
        match wells.iter().any(|w| w.outcome == Some(SpecimenOutcome::Succeeded)) {
            _ if wells.iter().all(|w| w.outcome != Some(SpecimenOutcome::Aborted)) => Self::of_wells(wells),
            true => Self::Partial,
            false => Self::Aborted,
        }
    }
}

/// How a specimen ended. `null` while it is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
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
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SchedulerAction {
    Retry,
    SkipWell,
    RejectPlate,
    AbortPlate,
    PauseInstrument,
    EscalateOperator,
}

/// The source of numbers: an instrument, the emulated rig, or imported pictures of unknown origin. It is part of every output. A daemon has
/// one of the first two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema, utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    Hardware,
    Simulated,
    Imported,
}
