//! The session: one driver owns all change, everyone else reads snapshots.
//!
//! ```text
//! http, cli ── Command ──> mailbox ──> driver ──> rig worker, science, store
//!     ^                                  │
//!     └──────── Status, events, Live <───┘
//! ```

mod concentration;
mod driver;
mod eta;
mod event;
mod fault;
mod gate;
mod halt;
mod handle;
mod heart;
mod live;
pub mod numbers;
mod offer;
mod placing;
mod plan;
mod plate;
pub mod plate_map;
mod preflight;
mod reference;
mod search;
mod sentence;
mod state;
mod status;
mod worker;

pub use concentration::ConcentrationUnit;
pub use driver::{Driver, DriverError};
pub use heart::Heart;
pub use worker::{Instrument, WellTimes};

pub use event::{Event, kind};
pub use fault::table::{ALL as FAULT_CODES, FaultCode};
pub use gate::GateStatus;
pub use halt::Halt;
pub use handle::{Accepted, Command, EventLog, Live, Missed, Publisher, Refusal, SessionHandle, Shown, Towards, channel};
pub use offer::MethodOffer;
pub use plan::{Control, FieldError, PlannedWell, RunPlan, SpecimenKind, is_plain_name, is_well};
pub use plate::{Handoff, HandoffEnd, HandoffIntent, HandoffNeeds};
pub use preflight::Check;
pub use reference::{PlaceStatus, ReferenceStatus};
pub use status::{
    CalibrationStatus, CameraStatus, Eta, Fault, HardwareStatus, Hold, Mode, Pending, Phase, Plate, RotationStatus, RunOutcome, RunStatus,
    SchedulerAction, SpecimenOutcome, SpecimenStatus, State, Status, TranslationStatus, VolumeSoFar, WellCounts, WellStatus,
};
