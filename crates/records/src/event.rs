//! A line of the event journal, with typed data.
//!
//! ```text
//! {"id": 7, "time": "...", "kind": "run.held", "run": "P-1", "well": null, "data": {"by": "fault", "code": "camera_lost", ...}}
//!      │                       └──────────────── EventData::RunHeld(RunHeld { .. }) ────────────────┘
//!      └ Event { id, body: EventBody { time, run, well, data: EventData } }
//! ```
//! A line with an unknown kind, or with data of another form, is read as [`EventData::Other`]. It is stored and served unchanged, and does
//! not change the state.

use crate::{Fault, Handoff, Interrupted, LiveEstimate, Mode, Phase, RunOutcome, SaidBy, WellCounts, WellNote, WellStatus, WellTimes};
use carved_core::profile::Detection;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

/// An event before it is written. It has no id yet.
#[derive(Debug, Clone, PartialEq)]
pub struct EventBody {
    /// Time of the event, not of the write to disk. RFC 3339, UTC.
    pub time: String,
    /// The run of the event. `None` if it belongs to no run.
    pub run: Option<String>,
    /// The well of the event, `A01` to `AF48`. `None` if it belongs to no well.
    pub well: Option<String>,
    /// What happened.
    pub data: EventData,
}

/// A written event. Ids increase by one, also across restarts.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Its number in the journal, from 1.
    pub id: u64,
    /// What happened.
    pub body: EventBody,
}

/// An event as a line of the journal.
#[derive(Serialize, Deserialize)]
struct Line {
    id: u64,
    /// RFC 3339, UTC.
    time: String,
    /// One of the kinds in `docs/files.md`.
    kind: String,
    run: Option<String>,
    well: Option<String>,
    /// Its data. `docs/files.md` describes them for each kind.
    data: Value,
}

impl Serialize for Event {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let EventBody { time, run, well, data } = self.body.clone();
        Line { id: self.id, time, kind: data.kind().to_owned(), run, well, data: data.to_json() }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Event {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Line { id, time, kind, run, well, data } = Line::deserialize(deserializer)?;
        Ok(Self { id, body: EventBody { time, run, well, data: EventData::of(&kind, data) } })
    }
}

/// Reads one variant: without data, or with data of a type.
macro_rules! read {
    ($variant:ident, $data:ident) => {
        Some(EventData::$variant)
    };
    ($variant:ident, $data:ident, $payload:ty) => {
        read_data::<$payload>(&$data).map(EventData::$variant)
    };
}

/// Early journals have `null` instead of an empty object.
fn read_data<T: DeserializeOwned>(data: &Value) -> Option<T> {
    let whole = T::deserialize(data).ok();
    whole.or_else(|| if data.is_null() { T::deserialize(Value::Object(serde_json::Map::new())).ok() } else { None })
}

/// The data of one variant as JSON.
macro_rules! json_of {
    ($event:expr, $variant:ident) => {
        Value::Null
    };
    ($event:expr, $variant:ident, $payload:ty) => {
        if let EventData::$variant(data) = $event { serde_json::to_value(data).unwrap_or_default() } else { Value::Null }
    };
}

/// Defines the enum, the names of its kinds and both conversions from one list.
macro_rules! events {
    ($($(#[$doc:meta])* $name:ident: $variant:ident $(($payload:ty))? = $word:literal;)*) => {
        /// The kind of an event, with its data. `docs/files.md` describes them.
        #[derive(Debug, Clone, PartialEq)]
        pub enum EventData {
            $($(#[$doc])* $variant $(($payload))?,)*
            /// An unknown kind, or data of another form.
            Other {
                /// Its kind.
                kind: String,
                /// Its data, unchanged.
                data: Value,
            },
        }

        /// Names of the kinds.
        pub mod kind {
            $($(#[$doc])* pub const $name: &str = $word;)*
            /// All names.
            pub const ALL: &[&str] = &[$($name),*];
        }

        impl EventData {
            /// The name of the kind.
            pub fn kind(&self) -> &str {
                match self {
                    $(Self::$variant { .. } => $word,)*
                    Self::Other { kind, .. } => kind,
                }
            }

            /// Reads the data of a kind from a line of the journal.
            pub fn of(kind: &str, data: Value) -> Self {
                let known = match kind {
                    $($word => read!($variant, data $(, $payload)?),)*
                    _ => None,
                };
                known.unwrap_or_else(|| Self::Other { kind: kind.to_owned(), data })
            }

            /// The data for a line of the journal.
            pub fn to_json(&self) -> Value {
                match self {
                    $(Self::$variant { .. } => json_of!(self, $variant $(, $payload)?),)*
                    Self::Other { data, .. } => data.clone(),
                }
            }
        }
    };
}

events! {
    /// The daemon started.
    DAEMON_STARTED: DaemonStarted(DaemonStarted) = "daemon.started";
    /// The daemon was asked to end while a run was open.
    DAEMON_STOPPING: DaemonStopping(DaemonStopping) = "daemon.stopping";
    /// The daemon ended normally.
    DAEMON_STOPPED: DaemonStopped = "daemon.stopped";
    /// A run was accepted.
    RUN_ACCEPTED: RunAccepted(RunAccepted) = "run.accepted";
    /// The instrument is ready, and the wells follow. Also written each time the run continues.
    RUN_STARTED: RunStarted = "run.started";
    /// An operator asked to hold the run.
    RUN_HOLD_REQUESTED: RunHoldRequested(Asked) = "run.hold_requested";
    /// A stop of the run was requested.
    RUN_STOP_REQUESTED: RunStopRequested(Asked) = "run.stop_requested";
    /// An abort of the run was requested.
    RUN_ABORT_REQUESTED: RunAbortRequested(Asked) = "run.abort_requested";
    /// The run is held.
    RUN_HELD: RunHeld(RunHeld) = "run.held";
    /// A held run continues.
    RUN_RESUMED: RunResumed(RunResumed) = "run.resumed";
    /// A start of the daemon found the run open.
    RUN_INTERRUPTED: RunInterrupted(RunInterrupted) = "run.interrupted";
    /// The run ended.
    RUN_ENDED: RunEnded(RunEnded) = "run.ended";
    /// A start of the daemon could not read a run's `run.json`.
    RUN_UNREADABLE: RunUnreadable(RunUnreadable) = "run.unreadable";
    /// The loader is asked for the specimen of a well.
    WELL_AWAITED: WellAwaited = "well.awaited";
    /// The loader reports that the specimen of a well is in the capillary.
    WELL_LOADED: WellLoaded(WellLoaded) = "well.loaded";
    /// The loader reports that the specimen of a well was taken out.
    WELL_UNLOADED: WellUnloaded = "well.unloaded";
    /// Somebody took the specimen of a well out while the driven sampler was at work. `well.unloaded` follows when no work is in progress.
    WELL_TAKEN_OUT: WellTakenOut = "well.taken_out";
    /// A person takes a well out of a held run.
    WELL_SKIPPED: WellSkipped(SaidBy) = "well.skipped";
    /// A person has a well of a held run measured again.
    WELL_REDO_REQUESTED: WellRedoRequested(SaidBy) = "well.redo_requested";
    /// A person's remark on a well.
    WELL_NOTED: WellNoted(WellNote) = "well.noted";
    /// A specimen entered a phase.
    SPECIMEN_PHASE: SpecimenPhase(PhaseEntered) = "specimen.phase";
    /// What the detection frame shows. No data if the frame cannot be judged.
    SPECIMEN_DETECTED: SpecimenDetected(Option<Detection>) = "specimen.detected";
    /// An attempt at a specimen failed, and another follows.
    SPECIMEN_TRIED_AGAIN: SpecimenTriedAgain(AttemptFailed) = "specimen.tried_again";
    /// The sampler's sensor shows a specimen that no run asked for, or that it is gone.
    SPECIMEN_UNASKED: SpecimenUnasked(SensorReading) = "specimen.unasked";
    /// A specimen was interrupted before its end.
    SPECIMEN_INTERRUPTED: SpecimenInterrupted(SpecimenInterrupted) = "specimen.interrupted";
    /// An attempt to compute the numbers of a specimen from its stored frames begins.
    SPECIMEN_RECOVERING: SpecimenRecovering(RecoveryBegun) = "specimen.recovering";
    /// This attempt has ended. `specimen.done` follows.
    SPECIMEN_RECOVERED: SpecimenRecovered = "specimen.recovered";
    /// All files of a well are on disk.
    SPECIMEN_DONE: SpecimenDone(Box<SpecimenDone>) = "specimen.done";
    /// A view was taken.
    VIEW_TAKEN: ViewTaken(ViewTaken) = "view.taken";
    /// A fault was raised.
    FAULT_RAISED: FaultRaised(Fault) = "fault.raised";
    /// A fault was acknowledged.
    FAULT_ACKNOWLEDGED: FaultAcknowledged(FaultAcknowledged) = "fault.acknowledged";
    /// The causes of faults are over.
    FAULT_CLEARED: FaultsCleared(FaultsCleared) = "fault.cleared";
    /// The disk accepts writes again.
    STORE_REGAINED: StoreRegained = "store.regained";
    /// A start of the daemon renumbered events whose ids did not increase.
    JOURNAL_REPAIRED: JournalRepaired(JournalRepaired) = "journal.repaired";
    /// The loader announced a plate.
    PLATE_ANNOUNCED: PlateAnnounced(Handoff) = "plate.announced";
    /// The plate is in the instrument.
    PLATE_LOADED: PlateLoaded(PlateNamed) = "plate.loaded";
    /// The plate was taken away.
    PLATE_UNLOADED: PlateUnloaded(PlateNamed) = "plate.unloaded";
    /// The handover of a plate was cancelled.
    PLATE_HANDOFF_ABORTED: PlateHandoffAborted(PlateNamed) = "plate.handoff_aborted";
}

impl EventData {
    /// Whether a start of the daemon needs the event, however old it is.
    pub fn is_lasting(&self) -> bool {
        matches!(
            self,
            Self::FaultRaised(_)
                | Self::FaultAcknowledged(_)
                | Self::FaultsCleared(_)
                | Self::PlateAnnounced(_)
                | Self::PlateLoaded(_)
                | Self::PlateUnloaded(_)
                | Self::PlateHandoffAborted(_)
                | Self::RunAccepted(_)
                | Self::SpecimenUnasked(_)
        )
    }
}

/// Data of `daemon.started`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DaemonStarted {
    /// Version of the program.
    pub version: String,
    /// Mode of the daemon.
    pub mode: Mode,
}

/// Data of `daemon.stopping`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct DaemonStopping {
    /// Whether the run ends with the daemon. If the daemon is killed before, the next start ends the run. Not written where it is false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub ends_run: bool,
}

/// Data of `run.accepted`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct RunAccepted {
    /// Barcode of its plate.
    pub plate_barcode: String,
    /// Name of its method.
    pub method: String,
    /// The well of an earlier run whose specimen is still in the capillary.
    pub left_in_capillary: Option<String>,
    /// Which start of the computer this was, by the kernel. `None` where it says nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kernel_boot_id: Option<String>,
}

/// The cause of a hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeldBy {
    /// A fault.
    Fault,
    /// An operator. The instrument is between two specimens.
    Operator,
}

/// Data of `run.held`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunHeld {
    /// The cause of the hold.
    pub by: HeldBy,
    /// Code of the fault, or `operator`. Journals before 0.1.0 lack it.
    pub code: Option<String>,
    /// The cause as text.
    pub cause: Option<String>,
}

/// Data of a person's request to a run.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Asked {
    /// Name of the person. `None` where the client gave none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Where the request came from, in words: the address of the client, and the holder of the lease that it showed. `None` in older journals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}

/// Who continues a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResumedBy {
    /// The instrument. The cause of the hold is over.
    Instrument,
    /// An operator.
    Operator,
}

/// Data of `run.resumed`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunResumed {
    /// Who continues the run.
    pub by: ResumedBy,
    /// Name of the operator. `None` where the client gave none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Where the request came from, as in [`Asked`]. `None` where the instrument continues by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}

/// Who fills the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LoadedBy {
    /// A loader or a person outside of the instrument, who reports what is inside.
    Loader,
    /// A sampler that the daemon drives.
    Sampler,
}

/// Data of `run.interrupted`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunInterrupted {
    /// When it was found: `at start`.
    pub found: String,
    /// Who fills the capillary, if the run is taken up. It decides what is assumed to be in the capillary.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loaded_by: Option<LoadedBy>,
    /// Which start of the computer this was, by the kernel. Another one than before means that the computer was restarted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kernel_boot_id: Option<String>,
}

/// Data of `run.ended`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunEnded {
    /// How it ended.
    pub outcome: Option<RunOutcome>,
    /// Its wells by their outcome.
    pub wells: WellCounts,
    /// Who filled the capillary. `None` in earlier journals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loaded_by: Option<LoadedBy>,
}

/// Data of `run.unreadable`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunUnreadable {
    /// Name of its folder.
    pub run: String,
    /// Why it cannot be read.
    pub why: String,
}

/// Data of `well.loaded`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct WellLoaded {
    /// The well whose specimen was replaced by this one.
    pub in_place_of: Option<String>,
}

/// Data of `specimen.phase`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PhaseEntered {
    /// The phase.
    pub phase: Phase,
    /// Whether the specimen is in the capillary.
    #[serde(default)]
    pub in_capillary: bool,
}

/// Data of `specimen.unasked`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SensorReading {
    /// Whether the specimen is there.
    pub there: bool,
}

/// Data of `specimen.tried_again`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AttemptFailed {
    /// The attempt that failed, from 1.
    pub attempt: u32,
    /// Why it failed.
    pub why: String,
}

/// Data of `specimen.interrupted`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SpecimenInterrupted {
    /// What interrupted it.
    #[serde(default)]
    pub reason: String,
    /// The method's policy for interrupted specimens.
    #[serde(default)]
    pub policy: Interrupted,
    /// Whether it stays in the capillary and the run continues with it.
    #[serde(default)]
    pub kept: bool,
}

/// Data of `specimen.recovering`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct RecoveryBegun {
    /// The attempt, from 1.
    pub attempt: u32,
}

/// Data of `specimen.done`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpecimenDone {
    /// Its outcome and numbers.
    #[serde(flatten)]
    pub result: WellStatus,
    /// Times of the well.
    pub times: Option<WellTimes>,
    /// How long it used the instrument, s. `None` if its numbers were computed from stored frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

/// Data of `view.taken`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewTaken {
    /// Place of the view in the plan of the revolution, from 0.
    pub index: u32,
    /// Whether it is the closure view.
    pub closure: bool,
    /// Angle in motor steps from the reference.
    pub achieved_steps: i64,
    /// Volume of the hull of all views so far. `None` for the closure view and for a retake.
    pub hull_volume_um3: Option<f64>,
    /// The estimate from all views so far.
    #[serde(flatten)]
    pub estimate: LiveEstimate,
}

/// Data of `fault.acknowledged`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultAcknowledged {
    /// Number of the fault.
    pub seq: u64,
    /// Its code.
    #[serde(default)]
    pub code: String,
    /// Name of the person. `None` where the client gave none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Where the request came from, as in [`Asked`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}

/// Data of `fault.cleared`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultsCleared {
    /// Numbers of the faults. Early journals have one number instead of a list.
    #[serde(deserialize_with = "one_or_more")]
    pub seq: Vec<u64>,
    /// Why they are over.
    #[serde(default)]
    pub why: String,
}

fn one_or_more<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u64>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Seq {
        One(u64),
        More(Vec<u64>),
    }
    Ok(match Seq::deserialize(deserializer)? {
        Seq::One(seq) => vec![seq],
        Seq::More(all) => all,
    })
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
fn is_zero(number: &usize) -> bool {
    *number == 0
}

/// Data of `journal.repaired`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JournalRepaired {
    /// Number of events with a new id.
    pub renumbered: usize,
    /// Number of lines that are no events and were left out.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub set_aside: usize,
    /// File name of the journal before the repair.
    pub kept: String,
}

/// Data of `plate.loaded`, `plate.unloaded` and `plate.handoff_aborted`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlateNamed {
    /// Barcode of the plate.
    pub barcode: String,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_documents_list_every_kind_of_event_and_no_other() {
        let documents = include_str!("../../../docs/files.md");
        let list = documents.split("* `events.jsonl`:").nth(1).expect("docs/files.md lists the events").split("\n* ").next().unwrap();
        let words = list.split('`').skip(1).step_by(2);
        let mut listed: Vec<&str> = words.filter(|w| w.contains('.') && !w.contains(".json")).collect();
        let mut known = kind::ALL.to_vec();
        listed.sort_unstable();
        known.sort_unstable();
        assert_eq!(listed, known);
    }

    fn reads(kind: &str, data: &Value) -> EventData {
        let line = json!({ "id": 3, "time": "2026-01-01T00:00:00Z", "kind": kind, "run": "r", "well": "A01", "data": data });
        let event: Event = serde_json::from_value(line.clone()).unwrap();
        assert_eq!(serde_json::to_value(&event).unwrap(), line, "it is written as it was read");
        event.body.data
    }

    #[test]
    fn a_line_keeps_its_form() {
        let held = json!({ "by": "fault", "code": "camera_lost", "cause": "gone" });
        assert!(matches!(reads("run.held", &held), EventData::RunHeld(RunHeld { by: HeldBy::Fault, .. })));
        assert_eq!(reads("run.started", &Value::Null), EventData::RunStarted);
        let view = json!({ "index": 3, "closure": false, "achieved_steps": 12, "hull_volume_um3": 0.1, "volume_um3": null,
            "volume_sd_um3": null, "volume_views": null, "converged": null });
        assert!(matches!(reads("view.taken", &view), EventData::ViewTaken(ViewTaken { index: 3, .. })));
    }

    #[test]
    fn what_is_not_known_is_kept_as_it_is() {
        for (kind, data) in [("moon.rises", json!({ "at": 7 })), ("run.held", json!("a word")), ("view.taken", json!({ "index": -1 }))] {
            assert_eq!(reads(kind, &data), EventData::Other { kind: kind.into(), data });
        }
    }

    /// Explanatory fields may be missing. The state still changes.
    #[test]
    fn a_field_that_decides_nothing_may_be_missing() {
        for kind in ["run.accepted", "specimen.recovering", "specimen.interrupted", "well.loaded"] {
            assert!(!matches!(EventData::of(kind, json!({})), EventData::Other { .. }), "{kind}");
        }
    }

    #[test]
    fn data_that_may_all_be_missing_may_be_null() {
        let loaded = EventData::of("well.loaded", Value::Null);
        assert_eq!(loaded, EventData::WellLoaded(WellLoaded { in_place_of: None }));
        assert_eq!(EventData::of("specimen.detected", Value::Null), EventData::SpecimenDetected(None));
        assert!(matches!(EventData::of("run.held", Value::Null), EventData::Other { .. }));
    }

    #[test]
    fn one_cleared_fault_or_a_list_of_them() {
        for (seq, expected) in [(json!(4), vec![4]), (json!([4, 5]), vec![4, 5])] {
            let data = EventData::of("fault.cleared", json!({ "seq": seq, "why": "over" }));
            assert_eq!(data, EventData::FaultsCleared(FaultsCleared { seq: expected, why: "over".into() }));
        }
    }
}
