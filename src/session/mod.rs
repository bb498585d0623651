//! The session: one driver owns all change, everyone else reads snapshots.
//!
//! ```text
//! http, cli ── Command ──> mailbox ──> driver ──> rig worker, science, store
//!     ^                                  │
//!     └──────── Status, events, Live <───┘
//! ```

mod event;
mod handle;
mod plan;
mod status;

pub use event::Event;
pub use handle::{Accepted, Command, EventLog, Live, Missed, Publisher, Refusal, SessionHandle, channel};
pub use plan::{FieldError, PlannedWell, RunPlan, SpecimenKind, is_plain_name};
pub use status::{
    CameraStatus, Eta, Fault, HardwareStatus, Mode, Pending, Phase, Plate, RotationStatus, RunOutcome, RunStatus, SchedulerAction,
    SpecimenOutcome, SpecimenStatus, State, Status, WellCounts, WellStatus,
};
