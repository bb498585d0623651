//! Faults, handovers, checks and methods.

use carved_records as records;
use carved_records::{Category, HandoffIntent, SchedulerAction, ViewOrder};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Fault {
    /// Its number; numbers rise and last across restarts.
    pub seq: u64,
    pub code: String,
    pub category: String,
    pub message: String,
    pub recoverable: bool,
    pub scheduler_action: SchedulerAction,
    /// Whether a person has to do something: about the fault itself, or because the run that it holds waits.
    pub operator_required: bool,
    /// Whether it ends with its cause. Others end with their acknowledgement.
    #[serde(default)]
    pub ends_by_itself: bool,
    /// What its code means, in plain words; `message` has what was found this time.
    #[serde(default)]
    pub meaning: String,
    /// What the operator does about it, in plain words, and whether the run then continues by itself.
    #[serde(default)]
    pub what_to_do: String,
    /// RFC 3339, UTC.
    pub since: String,
}

impl Fault {
    /// A fault as it is for the run under way.
    pub fn of(fault: &records::Fault, run: records::RunUnderFault) -> Self {
        let (operator_required, what_to_do, ends_by_itself) = (fault.needs_a_person(run), fault.advice(run), fault.ends_by_itself());
        let records::Fault { seq, code, category, message, recoverable, scheduler_action, meaning, since, .. } = fault.clone();
        Self { seq, code, category, message, recoverable, scheduler_action, operator_required, ends_by_itself, meaning, what_to_do, since }
    }
}

impl Fault {
    /// What is wrong, for people: what the code means, or what was found where an early journal did not keep the meaning.
    pub fn plainly(&self) -> &str {
        if self.meaning.is_empty() { &self.message } else { &self.meaning }
    }
}

/// One code with what is always true of it.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct FaultCode {
    /// Stable word to branch on.
    pub code: &'static str,
    pub category: Category,
    /// What the scheduler does, unless the fault itself says otherwise.
    pub scheduler_action: SchedulerAction,
    /// Whether a person has to do something before the instrument is fit again.
    pub operator_required: bool,
    /// Whether the daemon goes on without being started again.
    pub recoverable: bool,
    pub meaning: &'static str,
    /// For the operator, in plain words. A fault in the status has what is so for its run.
    pub what_to_do: String,
}

impl From<records::FaultCode> for FaultCode {
    fn from(from: records::FaultCode) -> Self {
        let what_to_do = from.what_to_do();
        let records::FaultCode { code, category, scheduler_action, operator_required, recoverable, meaning, remedy: _ } = from;
        Self { code, category, scheduler_action, operator_required, recoverable, meaning, what_to_do }
    }
}

/// What the announced handover waits for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct HandoffNeeds {
    pub intent: HandoffIntent,
    pub barcode: String,
    /// What has to happen first, in words; `null`: the plate may be moved now.
    pub needs: Option<String>,
}

/// One precondition of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Check {
    /// Stable word to branch on.
    pub code: String,
    pub passed: bool,
    /// Whether a run would be refused or fail; else its numbers are flagged or lack something.
    pub blocks: bool,
    /// What was found, with its numbers.
    pub detail: String,
    /// What to do about it; `null` where it has passed.
    pub what_to_do: Option<String>,
}

/// A method of this instrument; `run.json` records it whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MethodOffer {
    pub name: String,
    /// What the lab calls this state of it; `null` where the configuration does not say.
    pub version: Option<String>,
    /// ASD: axial views in one revolution.
    pub asd: u32,
    /// `sequential`, `coarse_to_fine` or `sweep`.
    #[schema(value_type = String)]
    pub order: ViewOrder,
    /// Share of the views that may miss a voxel that still counts.
    pub epsilon: f64,
    /// SD: edge of a voxel, um.
    pub voxel_um: f64,
}
