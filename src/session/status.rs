//! What the instrument says of itself: one snapshot, published whole, never patched by a reader.
//!
//! Four things are kept apart: the `state` of the instrument, the `phase` of a specimen, the `outcome` of what has ended,
//! and the `faults`. Clocks (`server_time`, `uptime_s`, the calibration's `age_s`) are filled in when a snapshot is read and do not
//! change its revision; `eta_s` is told anew with each well that is done.

use carved_core::units::Steps;
use carved_devices::Position;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// State of the instrument, in PackML's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum State {
    Stopped,
    Idle,
    Starting,
    Execute,
    Holding,
    Held,
    Unholding,
    Suspending,
    Suspended,
    Unsuspending,
    Completing,
    Complete,
    Stopping,
    Aborting,
    Aborted,
    Clearing,
    Resetting,
}

/// Phase within one specimen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SpecimenOutcome {
    Succeeded,
    Failed,
    Aborted,
    Interrupted,
    Skipped,
}

/// What the scheduler does about a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    Hardware,
    Simulated,
    Imported,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Fault {
    pub seq: u64,
    pub code: String,
    pub category: String,
    pub message: String,
    pub recoverable: bool,
    pub scheduler_action: SchedulerAction,
    pub operator_required: bool,
    /// What its code means, in plain words; `message` has what was found this time.
    #[serde(default)]
    pub meaning: String,
    /// What the operator does about it, in plain words.
    #[serde(default)]
    pub what_to_do: String,
    /// RFC 3339, UTC.
    pub since: String,
}

/// Commands that were accepted and are still under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
pub struct Pending {
    pub hold: bool,
    pub stop: bool,
    pub abort: bool,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct Plate {
    pub barcode: Option<String>,
    pub present: bool,
    /// No specimen in the capillary and everything of this plate on disk.
    pub removable: bool,
    /// What the instrument waits for from the loader, in words, if anything.
    pub needs: Option<String>,
    /// The well whose specimen is to be taken out of the capillary.
    #[serde(default)]
    pub take_out: Option<String>,
    /// The well whose specimen is to be brought, after what is to be taken out.
    #[serde(default)]
    pub bring: Option<String>,
}

/// Disjoint counts of a run's wells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
pub struct WellCounts {
    pub succeeded: u32,
    pub flagged: u32,
    pub failed: u32,
    pub skipped: u32,
    pub interrupted: u32,
    pub pending: u32,
    pub total: u32,
}

/// Seconds until the run is done.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Eta {
    pub p50: f64,
    pub p90: f64,
}

/// One well of the run, as far as it has come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WellStatus {
    pub well: String,
    /// What the plate map says is in it.
    pub specimen: super::SpecimenKind,
    pub dpf: Option<f64>,
    pub outcome: Option<SpecimenOutcome>,
    /// Why a skipped or failed well has no number.
    pub reason: Option<String>,
    pub flags: Vec<String>,
    /// What made the numbers to trust: `support` (slices of the outlines) or `voxel` (the paper's).
    #[serde(default)]
    pub estimator: Option<String>,
    pub volume_um3: Option<f64>,
    /// Standard deviation.
    #[serde(default)]
    pub volume_sd_um3: Option<f64>,
    pub area_um2: Option<f64>,
    #[serde(default)]
    pub area_sd_um2: Option<f64>,
    /// Of the surface where the outlines put it, which is the one that is shown.
    pub field_volume_um3: Option<f64>,
    pub field_area_um2: Option<f64>,
    /// Of the fitted sphere, for beads.
    pub diameter_um: Option<f64>,
    /// Views that count; fewer than planned where some did not belong, or the method ended the turn early.
    #[serde(default)]
    pub views: Option<u32>,
    /// By the method: `views` of so many.
    #[serde(default)]
    pub views_planned: Option<u32>,
    /// Fluorescence in the second camera per volume: grey levels times px per nl.
    #[serde(default)]
    pub signal_per_nl: Option<f64>,
    /// Where a larva of known age stands among reference larvae.
    #[serde(default)]
    pub reference: Option<Box<super::ReferenceStatus>>,
}

impl WellStatus {
    /// A well that is still to come.
    pub fn pending(planned: &super::PlannedWell) -> Self {
        Self {
            well: planned.well.clone(),
            specimen: planned.specimen,
            dpf: planned.dpf,
            outcome: None,
            reason: None,
            flags: Vec::new(),
            estimator: None,
            volume_um3: None,
            volume_sd_um3: None,
            area_um2: None,
            area_sd_um2: None,
            field_volume_um3: None,
            field_area_um2: None,
            diameter_um: None,
            views: None,
            views_planned: None,
            signal_per_nl: None,
            reference: None,
        }
    }

    pub fn end(&mut self, outcome: SpecimenOutcome, reason: Option<&str>) {
        self.outcome = Some(outcome);
        self.reason = reason.map(str::to_owned);
    }
}

impl WellCounts {
    /// Counts each well once: a measured one with flags is `flagged`, not `succeeded`.
    pub fn of(wells: &[WellStatus]) -> Self {
        let mut counts = Self { total: wells.len() as u32, ..Self::default() };
        for well in wells {
            *match well.outcome {
                None => &mut counts.pending,
                Some(SpecimenOutcome::Succeeded) if well.flags.is_empty() => &mut counts.succeeded,
                Some(SpecimenOutcome::Succeeded) => &mut counts.flagged,
                Some(SpecimenOutcome::Failed) => &mut counts.failed,
                Some(SpecimenOutcome::Skipped) => &mut counts.skipped,
                Some(SpecimenOutcome::Aborted | SpecimenOutcome::Interrupted) => &mut counts.interrupted,
            } += 1;
        }
        counts
    }
}

/// Why a run is held, and what lets it go on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Hold {
    /// A fault's code, `operator`, or `restart` of the daemon.
    pub code: String,
    /// The same in plain words; it may be over by now.
    pub cause: String,
    /// How often it has held the run since a well was finished, this time included.
    pub times: u32,
    /// The one thing to do next; `null` where the run goes on without it.
    pub next_action: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunStatus {
    pub id: String,
    pub external_id: Option<String>,
    pub method: String,
    pub operator: String,
    pub wells: WellCounts,
    pub results: Vec<WellStatus>,
    /// RFC 3339, UTC.
    pub started: String,
    pub ended: Option<String>,
    pub eta_s: Option<Eta>,
    pub outcome: Option<RunOutcome>,
    /// An operator has held it: it does not go on by itself, whatever else held it.
    #[serde(default)]
    pub held_by_operator: bool,
    /// Held, it goes on without anybody's word: at once, after a start of the daemon, or once what is lost is back.
    #[serde(default)]
    pub goes_on_by_itself: bool,
    /// `null` where the run is not held.
    #[serde(default)]
    pub hold: Option<Hold>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpecimenStatus {
    pub well: String,
    pub in_capillary: bool,
    pub phase: Phase,
    /// Views taken so far.
    pub view: u32,
    pub views_planned: u32,
    /// The best estimate so far: by support functions of the slices, what few views make of a hull taken off. Told some twelve times a turn,
    /// where no view waits; `null` until seven views look from all around (no gap wider than 150 deg, so 210 deg of a turn in sequence),
    /// and where slices do not tell it. Once the specimen is measured, the measurement's.
    pub volume_um3: Option<f64>,
    /// Standard deviation of `volume_um3`: `null` where that is.
    pub volume_sd_um3: Option<f64>,
    /// The views that `volume_um3` is of.
    #[serde(default)]
    pub volume_views: Option<u32>,
    /// Whether `volume_um3` has settled and is known as well as the method's `early_stop` promises (its defaults where the method has
    /// none), whether or not a turn may end by that; `null` where `volume_um3` is. Never `true` before `min_views` (28) views.
    pub converged: Option<bool>,
    /// Volume of the live hull after each view, oldest first: of few views too large, and no estimate.
    pub hull_volumes_um3: Vec<f64>,
}

/// The volume of a specimen as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct VolumeSoFar {
    pub volume_um3: Option<f64>,
    pub volume_sd_um3: Option<f64>,
    pub volume_views: Option<u32>,
    pub converged: Option<bool>,
}

impl SpecimenStatus {
    /// A specimen of which nothing is known yet; the driver knows what is in the capillary.
    pub fn new(well: &str, phase: Phase, views_planned: u32) -> Self {
        Self {
            well: well.to_owned(),
            in_capillary: false,
            phase,
            view: 0,
            views_planned,
            volume_um3: None,
            volume_sd_um3: None,
            volume_views: None,
            converged: None,
            hull_volumes_um3: Vec::new(),
        }
    }

    pub fn tell(&mut self, known: VolumeSoFar) {
        let VolumeSoFar { volume_um3, volume_sd_um3, volume_views, converged } = known;
        (self.volume_um3, self.volume_sd_um3, self.volume_views, self.converged) = (volume_um3, volume_sd_um3, volume_views, converged);
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct CameraStatus {
    pub identity: Option<String>,
    pub connected: bool,
    pub completed_frames: u64,
    pub failed_frames: u64,
    pub missing_packets: u64,
    pub resent_packets: u64,
    pub ignored_packets: u64,
    /// Light and focus of the newest view.
    #[serde(default)]
    pub light: Option<carved_devices::acquisition::Light>,
}

impl CameraStatus {
    pub fn count(&mut self, counters: &carved_devices::StreamCounters) {
        self.completed_frames = counters.completed;
        self.failed_frames = counters.failed;
        self.missing_packets = counters.missing_packets;
        self.resent_packets = counters.resent_packets;
        self.ignored_packets = counters.ignored_packets;
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct RotationStatus {
    pub identity: Option<String>,
    pub connected: bool,
    pub referenced: bool,
    /// Whether a stop ends a move under way; else it ends by itself and no other follows. `null` until the axis is known.
    pub can_stop: Option<bool>,
    pub position_steps: Option<i64>,
    pub position_deg: Option<f64>,
}

/// The axis along the capillary.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct TranslationStatus {
    /// Of its controller, which is the rotation's too.
    pub identity: Option<String>,
    pub connected: bool,
    pub referenced: bool,
    /// From the reference.
    pub position_steps: Option<i64>,
    pub position_um: Option<f64>,
}

impl TranslationStatus {
    /// No position where the controller is away.
    pub fn new(identity: &str, position: Option<Position>, um: impl Fn(Steps) -> f64) -> Self {
        let steps = match position {
            Some(Position::Referenced { steps, .. }) => Some(steps),
            _ => None,
        };
        Self {
            identity: Some(identity.to_owned()),
            connected: position.is_some(),
            referenced: steps.is_some(),
            position_steps: steps.map(|s| s.0),
            position_um: steps.map(um),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct HardwareStatus {
    pub rotation: RotationStatus,
    /// `null` on a rig without a linear axis.
    pub translation: Option<TranslationStatus>,
    pub camera: CameraStatus,
    /// `null` on a rig without a second camera.
    #[serde(default)]
    pub camera_second: Option<CameraStatus>,
    pub disk_free_bytes: Option<u64>,
}

impl HardwareStatus {
    /// The axes' controller is away, and with it what was known of their places.
    pub fn lose_axes(&mut self) {
        let away =
            RotationStatus { connected: false, referenced: false, position_steps: None, position_deg: None, ..self.rotation.clone() };
        self.rotation = away;
        self.translation = self.translation.take().map(|t| TranslationStatus { identity: t.identity, ..TranslationStatus::default() });
    }

    /// It is there, and its axes wait for their references.
    pub fn find_axes(&mut self, identity: &str) {
        self.rotation.connected = true;
        self.rotation.identity = Some(identity.to_owned());
        if let Some(translation) = &mut self.translation {
            translation.connected = true;
            translation.identity = Some(identity.to_owned());
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
    pub gate: Option<super::gate::GateStatus>,
}

impl CalibrationStatus {
    /// As it is at a moment.
    pub fn new(found: crate::store::calibrations::RigCalibration, max_age_days: f64, now: jiff::Timestamp) -> Self {
        let age_s = now.duration_since(found.measured).as_secs_f64();
        let max_age_s = max_age_days * 86400.0;
        Self {
            id: found.id,
            kind: found.kind.to_owned(),
            measured: found.measured.to_string(),
            age_s,
            max_age_s,
            bead_bias_percent: found.bead_bias_percent,
            valid: age_s < max_age_s,
            gate: None,
        }
    }

    /// Its age at a moment.
    pub fn age_s(&self, now: jiff::Timestamp) -> Option<f64> {
        age_s(&self.measured, now)
    }

    /// Notes what is too old from this moment on; whether anything is that was not before.
    pub fn grows_too_old(&mut self, now: jiff::Timestamp) -> bool {
        let passes = |good: &mut bool, measured: &str, max_age_s: f64| {
            *good && {
                *good = age_s(measured, now).is_some_and(|age_s| age_s < max_age_s);
                !*good
            }
        };
        let size = passes(&mut self.valid, &self.measured, self.max_age_s);
        let gate = self.gate.as_mut().is_some_and(|gate| passes(&mut gate.stands, &gate.measured, gate.max_age_s));
        size || gate
    }
}

/// Seconds from a moment as it is told to another.
fn age_s(measured: &str, now: jiff::Timestamp) -> Option<f64> {
    Some(now.duration_since(measured.parse().ok()?).as_secs_f64())
}

/// `GET /v1/status`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Status {
    pub schema: String,
    pub revision: u64,
    pub boot_id: String,
    pub server_time: String,
    pub uptime_s: f64,
    pub version: String,
    pub mode: Mode,
    pub ready: bool,
    /// Why the instrument would not start a run now.
    pub not_ready_reason: Option<String>,
    pub state: State,
    /// What the instrument is doing, in one sentence.
    pub doing: String,
    pub pending: Pending,
    pub plate: Plate,
    /// The run under way, or the last one until the next starts.
    pub run: Option<RunStatus>,
    pub specimen: Option<SpecimenStatus>,
    pub hardware: HardwareStatus,
    /// Of the rig itself, the newest that is kept; `null` where there is none.
    pub calibration: Option<CalibrationStatus>,
    pub faults: Vec<Fault>,
}
