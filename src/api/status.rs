//! What the instrument says of itself: one snapshot, published whole, never patched by a reader.
//!
//! Four things are kept apart: the `state` of the instrument, the `phase` of a specimen, the `outcome` of what has ended,
//! and the `faults`. Clocks (`server_time`, `uptime_s`, the calibration's `age_s`) are filled in when a snapshot is read and do not
//! change its revision; `eta_s` is told anew with each well that is done.

use super::{CalibrationStatus, Eta, Fault, InstrumentIdentity, Light, Mode, Phase, RunOutcome, WellCounts, WellStatus};
use carved_core::units::Steps;
use carved_devices::{Position, outputs};
use carved_records::LiveEstimate;
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

impl Status {
    /// `not_ready_reason` of a status that does not yet show what the previous process left.
    pub const STARTING: &str = "starting";
    /// `not_ready_reason` while the daemon ends.
    pub const ENDING: &str = "shutting down";

    /// Whether the daemon has not restored the state of the previous process yet: `state`, `run`, `plate` and `specimen` are empty.
    pub fn is_starting(&self) -> bool {
        self.not_ready_reason.as_deref() == Some(Self::STARTING)
    }

    /// Whether the daemon ends: the motors stand, and what it does with its run is in the journal.
    pub fn is_ending(&self) -> bool {
        self.not_ready_reason.as_deref() == Some(Self::ENDING)
    }
}

impl State {
    /// Every state.
    pub const ALL: [Self; 17] = [
        Self::Stopped,
        Self::Idle,
        Self::Starting,
        Self::Execute,
        Self::Holding,
        Self::Held,
        Self::Unholding,
        Self::Suspending,
        Self::Suspended,
        Self::Unsuspending,
        Self::Completing,
        Self::Complete,
        Self::Stopping,
        Self::Aborting,
        Self::Aborted,
        Self::Clearing,
        Self::Resetting,
    ];

    /// Whether a run is on its way to its end.
    pub fn is_ending(self) -> bool {
        matches!(self, Self::Stopping | Self::Aborting | Self::Completing)
    }
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
    /// The plate that was handed over, or else that of the newest run: the instrument does not see plates. `null` once it was taken away.
    pub barcode: Option<String>,
    /// Whether a loader has handed this plate over. `false` for the plate of a run without a handover, which a person puts in and takes away.
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

/// Why a run is held, and what lets it go on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Hold {
    /// A fault's code, `operator`, `restart` of the daemon, or `fault` where an early journal does not say which.
    pub code: String,
    /// The same in plain words; it may be over by now.
    pub cause: String,
    /// How often it has held the run since a well was finished, this time included.
    pub times: u32,
    /// The one thing to do next; `null` where the run continues without it.
    pub next_action: Option<String>,
    /// The command that carries it out or confirms it. `null` while a cause stands that no command ends: `unhold` would be refused.
    #[serde(default)]
    pub next_command: Option<NextCommand>,
    /// The fault that `next_action` is about, and that `acknowledge` is for; `null` where none is open.
    #[serde(default)]
    pub fault_seq: Option<u64>,
    /// When the run tries again by itself, RFC 3339, UTC: a camera that sent no whole frame is tried again after a pause, which grows. `null`
    /// where it does not, or continues as soon as the cause is over.
    #[serde(default)]
    pub next_try: Option<String>,
}

/// The command that comes next for a held run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum NextCommand {
    /// `POST /v1/faults/{seq}/acknowledge`.
    Acknowledge,
    /// `POST /v1/runs/{id}/unhold`.
    Unhold,
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
    /// A held run continues without a request: at once, after a start of the daemon, or when a lost device is back.
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
    /// Current estimate of the volume, by support functions of the slices: corrected for the small number of views. Updated about twelve
    /// times a turn, when no view waits. `null` until 7 views have no gap over 150 deg (210 deg of a turn in sequence), and where the slices
    /// do not determine it. After the measurement, its volume.
    pub volume_um3: Option<f64>,
    /// Standard deviation of `volume_um3`: `null` where that is.
    pub volume_sd_um3: Option<f64>,
    /// The views that `volume_um3` is of.
    #[serde(default)]
    pub volume_views: Option<u32>,
    /// Whether `volume_um3` has settled and is known as well as the method's `early_stop` promises (its defaults where the method has
    /// none), whether or not a turn may end by that; `null` where `volume_um3` is. Never `true` before `min_views` (28) views.
    pub converged: Option<bool>,
    /// Why `volume_um3` is `null`; `null` where it is not.
    #[serde(default)]
    pub volume_wait: Option<VolumeWait>,
    /// Every `volume_um3` of this turn, oldest first.
    #[serde(default)]
    pub estimates: Vec<VolumeEstimate>,
    /// Volume of the live hull after each view, oldest first: of few views too large, and no estimate.
    pub hull_volumes_um3: Vec<f64>,
}

/// Why the volume of a specimen is not known yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum VolumeWait {
    /// Too few views, or none from one side.
    Views,
    /// The views are enough. The computer is busy with them.
    Computing,
    /// The slices of this specimen do not determine it. The measurement will.
    Slices,
}

/// The volume as it was estimated after some views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct VolumeEstimate {
    /// The views that it is of.
    pub views: u32,
    pub volume_um3: f64,
    /// Standard deviation of `volume_um3`.
    pub volume_sd_um3: Option<f64>,
}

impl VolumeEstimate {
    /// Each estimate once: it stays the same until the next is made, and one of as many views replaces it.
    pub fn each(known: impl Iterator<Item = LiveEstimate>) -> Vec<Self> {
        let mut found = Vec::new();
        known.for_each(|estimate| Self::take(&mut found, estimate));
        found
    }

    pub fn take(known: &mut Vec<Self>, newest: LiveEstimate) {
        if let (Some(volume_um3), Some(views)) = (newest.volume_um3, newest.volume_views) {
            known.retain(|before| before.views < views);
            known.push(Self { views, volume_um3, volume_sd_um3: newest.volume_sd_um3 });
        }
    }
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
            volume_wait: Some(VolumeWait::Views),
            estimates: Vec::new(),
            hull_volumes_um3: Vec::new(),
        }
    }

    pub fn set_estimate(&mut self, known: LiveEstimate) {
        let LiveEstimate { volume_um3, volume_sd_um3, volume_views, converged } = known;
        (self.volume_um3, self.volume_sd_um3, self.volume_views, self.converged) = (volume_um3, volume_sd_um3, volume_views, converged);
        self.volume_wait = self.volume_wait.filter(|_| volume_um3.is_none());
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
    pub light: Option<Light>,
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
    /// Another program turns the capillary and takes the pictures: carved cannot stop it, take a view again or end a turn early.
    #[serde(default)]
    pub outside: bool,
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

/// What the controller has confirmed of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutputState {
    On,
    Off,
    /// It was not switched since the controller was started, reset or lost, or the last switching failed.
    Unknown,
}

/// An output of the controller that turns the capillary, such as that of the light.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct OutputStatus {
    /// Its name in the configuration.
    pub name: String,
    pub state: OutputState,
    /// Why the last switching failed; `null` where it did not.
    pub trouble: Option<String>,
}

impl From<outputs::OutputStatus> for OutputStatus {
    fn from(found: outputs::OutputStatus) -> Self {
        let outputs::OutputStatus { name, on: _, settle: _, state, trouble } = found;
        let state = match state {
            outputs::OutputState::On => OutputState::On,
            outputs::OutputState::Off => OutputState::Off,
            outputs::OutputState::Unknown => OutputState::Unknown,
        };
        Self { name, state, trouble }
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct HardwareStatus {
    pub rotation: RotationStatus,
    /// `null` on a rig without a linear axis.
    pub translation: Option<TranslationStatus>,
    /// Outputs that the configuration names, such as that of the light.
    #[serde(default)]
    pub outputs: Vec<OutputStatus>,
    pub camera: CameraStatus,
    /// `null` on a rig without a second camera.
    #[serde(default)]
    pub camera_second: Option<CameraStatus>,
    pub disk_free_bytes: Option<u64>,
    /// Why the index lacks what is newest on disk, so that lists of runs and old events are incomplete. Runs go on, and the index catches
    /// up by itself. `null` where it lacks nothing.
    #[serde(default)]
    pub index_trouble: Option<String>,
}

impl HardwareStatus {
    /// The axes' controller is away, and with it what was known of their places.
    pub fn lose_axes(&mut self) {
        let away =
            RotationStatus { connected: false, referenced: false, position_steps: None, position_deg: None, ..self.rotation.clone() };
        self.rotation = away;
        self.outputs.iter_mut().for_each(|output| output.state = OutputState::Unknown);
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

/// Notices by the table `[notify]` of the configuration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct NoticesStatus {
    /// Address of the receiver without its path.
    pub receiver: String,
    /// Why notices do not reach it, and what to do; `null` where nothing is known to be wrong. Runs go on.
    pub trouble: Option<String>,
}

/// A plate that waits for its turn.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct QueuedPlate {
    /// Name of the run that it will be. `GET /v1/queue/{run_id}` has its plan.
    pub run: String,
    pub plate_barcode: String,
    pub method: String,
    pub operator: String,
    /// Number of wells of its plan.
    pub wells: u32,
    /// Why it cannot begin as it is, for example because the configuration has no such method any more. `null` if nothing is known.
    pub trouble: Option<String>,
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
    #[serde(default)]
    pub instrument: InstrumentIdentity,
    pub mode: Mode,
    pub ready: bool,
    /// Why the instrument would not start a run now.
    pub not_ready_reason: Option<String>,
    pub state: State,
    /// What the instrument is doing, in one sentence.
    pub doing: String,
    pub pending: Pending,
    pub plate: Plate,
    /// The plates that wait for their turn, the next one first.
    #[serde(default)]
    pub queue: Vec<QueuedPlate>,
    /// The run under way, or the last one until the next starts.
    pub run: Option<RunStatus>,
    pub specimen: Option<SpecimenStatus>,
    pub hardware: HardwareStatus,
    /// Notices to people who are not here; `null` where the configuration names no receiver.
    #[serde(default)]
    pub notices: Option<NoticesStatus>,
    /// Of the rig itself, the newest that is kept; `null` where there is none.
    pub calibration: Option<CalibrationStatus>,
    pub faults: Vec<Fault>,
}
