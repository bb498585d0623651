//! Faults, calibration, handovers and what else concerns the instrument.

use super::words::{Category, HandoffIntent, SchedulerAction};
use carved_records as records;
use carved_records::ViewOrder;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Which instrument this is.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
pub struct InstrumentIdentity {
    /// By its configuration.
    pub name: String,
    /// By its configuration; `null` where it has none.
    pub serial: Option<String>,
    /// Where it stands, by its configuration; `null` where it does not say.
    pub location: Option<String>,
    /// Of its data folder. It stays the same when the name or the place changes.
    pub uuid: String,
}

impl From<records::InstrumentIdentity> for InstrumentIdentity {
    fn from(from: records::InstrumentIdentity) -> Self {
        let records::InstrumentIdentity { name, serial, location, uuid } = from;
        Self { name, serial, location, uuid }
    }
}

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
        Self {
            seq,
            code,
            category,
            message,
            recoverable,
            scheduler_action: scheduler_action.into(),
            operator_required,
            ends_by_itself,
            meaning,
            what_to_do,
            since,
        }
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
        Self {
            code,
            category: category.into(),
            scheduler_action: scheduler_action.into(),
            operator_required,
            recoverable,
            meaning,
            what_to_do,
        }
    }
}

/// The newest calibration of this rig, by beads or by scale; looked up when the daemon and when a run starts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationStatus {
    pub id: String,
    /// `beads` or `scale`; `gate` where neither is kept, and only daily beads are.
    pub kind: String,
    /// When its last recording was made, RFC 3339, UTC.
    pub measured: String,
    pub age_s: f64,
    /// From this age on it is not valid.
    pub max_age_s: f64,
    /// Of the beads' mean diameter against what it should be; `null` of a scale.
    pub bead_bias_percent: Option<f64>,
    pub valid: bool,
    /// The rig's newest daily beads; `null` where none were kept.
    #[serde(default)]
    pub gate: Option<GateStatus>,
}

impl From<records::CalibrationStatus> for CalibrationStatus {
    fn from(from: records::CalibrationStatus) -> Self {
        let records::CalibrationStatus { id, kind, measured, age_s, max_age_s, bead_bias_percent, valid, gate } = from;
        Self { id, kind, measured, age_s, max_age_s, bead_bias_percent, valid, gate: gate.map(Into::into) }
    }
}

impl CalibrationStatus {
    /// Sets its age at a moment.
    pub fn set_age(&mut self, now: jiff::Timestamp) {
        if let Ok(measured) = self.measured.parse() {
            self.age_s = now.duration_since(measured).as_secs_f64();
        }
    }
}

/// The newest gate of this rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct GateStatus {
    pub id: String,
    /// `passed`, `no_history` (passed, with too few earlier gates to tell a change), `failed` or `too_few_beads`.
    pub verdict: String,
    /// When its last bead was recorded, RFC 3339, UTC.
    pub measured: String,
    /// From this age on it does not stand.
    pub max_age_s: f64,
    /// It passed, and is not too old yet.
    pub stands: bool,
    /// What a technician does about it, in short; empty where an earlier build looked it up.
    #[serde(default)]
    pub summary: String,
    /// What was found, in every number, and what to do.
    pub words: Vec<String>,
}

impl From<records::GateStatus> for GateStatus {
    fn from(from: records::GateStatus) -> Self {
        let records::GateStatus { id, verdict, measured, max_age_s, stands, summary, words } = from;
        Self { id, verdict, measured, max_age_s, stands, summary, words }
    }
}

/// Body of `PUT /v1/plate/handoff`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Handoff {
    pub intent: HandoffIntent,
    pub barcode: String,
}

impl From<records::Handoff> for Handoff {
    fn from(from: records::Handoff) -> Self {
        let records::Handoff { intent, barcode } = from;
        Self { intent: intent.into(), barcode }
    }
}

impl From<Handoff> for records::Handoff {
    fn from(from: Handoff) -> Self {
        let Handoff { intent, barcode } = from;
        Self { intent: intent.into(), barcode }
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

/// Light level and focus of a frame, which depend on lamp, exposure and lens.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Median of the pixels, 0 to 255. It is the level of the background, because a specimen covers less than half of a frame.
    pub background: f64,
    /// Share of the pixels at 255.
    pub saturated: f64,
    /// Mean square of the difference between pixels two columns apart, divided by the square of the background. It increases with the
    /// sharpness. Only frames of the same rig and specimen can be compared.
    pub focus: f64,
}

impl From<carved_records::Light> for Light {
    fn from(from: carved_records::Light) -> Self {
        let carved_records::Light { background, saturated, focus } = from;
        Self { background, saturated, focus }
    }
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
    /// `sequential` or `coarse_to_fine`.
    #[schema(value_type = String)]
    pub order: ViewOrder,
    /// Share of the views that may miss a voxel that still counts.
    pub epsilon: f64,
    /// SD: edge of a voxel, um.
    pub voxel_um: f64,
}
