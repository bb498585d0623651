//! The session: one driver owns all change, everyone else reads snapshots.
//!
//! ```text
//! http, cli ── Command ──> mailbox ──> driver ──> rig worker, science, store
//!     ^                                  │
//!     └──────── Status, events, Live <───┘
//! ```

mod driver;
mod fault;
mod gate;
mod halt;
mod handle;
mod heartbeat;
mod live;
pub mod numbers;
mod offer;
mod placing;
mod preflight;
mod search;
mod sentence;
mod state;
mod status;
mod worker;

pub use driver::{Driver, DriverError};
pub use halt::Halt;
pub use handle::{Accepted, Command, EventLog, Live, Missed, Publisher, Refusal, SessionHandle, Shown, Towards, channel};
pub use heartbeat::Heartbeat;
pub use offer::MethodOffer;
pub use preflight::Check;
pub use status::{
    CameraStatus, HardwareStatus, Hold, Pending, Plate, RotationStatus, RunStatus, SpecimenStatus, State, Status, TranslationStatus,
};
pub use worker::Instrument;
