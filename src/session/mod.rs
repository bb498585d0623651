//! The session: one driver changes state, all others read snapshots.
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
mod instrument;
pub mod live;
pub mod numbers;
mod offer;
mod placing;
mod preflight;
pub mod replays;
mod search;
mod sentence;
mod slow_disk;
pub mod standard;
mod state;
mod tally;
mod worker;

pub use driver::{Departure, Driver, DriverError};
pub use halt::Halt;
pub use handle::{
    Accepted, Command, EventLog, Live, Missed, Publisher, QueueChange, QueueRefusal, Refusal, Said, SessionHandle, Shown, Towards, channel,
};
pub use heartbeat::Heartbeat;
pub use instrument::Instrument;
pub use slow_disk::SlowDisk;
pub use tally::Tally;

use crate::api::{
    CameraStatus, Check, HardwareStatus, Hold, OutputStatus, Pending, Plate, RotationStatus, RunStatus, SpecimenStatus, State, Status,
    TranslationStatus,
};
