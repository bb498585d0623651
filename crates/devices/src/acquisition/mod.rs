//! One revolution of the capillary, view by view.
//!
//! ```text
//! RevolutionPlan ──► revolve ──────────────────────────────► sink (a bounded channel to the science)
//!  integer steps     move ─► settle ─► trigger ─► frame ──┬──► LedgerEntry + RawFrame
//!                     ▲                                   │
//!                     └───────── next stop ◄──────────────┘   the axis turns on while the frame is looked at
//! ```
//! The plan is immutable and pure; the [`Ledger`] says where every view was really taken. The science receives the
//! achieved angle, never the planned one. Everything here blocks and knows no async runtime.

mod grab;
mod ledger;
mod light;
mod plan;
mod worker;

pub use grab::{grab, grab_second};
pub use ledger::{Ledger, LedgerEntry, LedgerError, SecondEntry};
pub use light::Light;
pub use plan::{PlanError, RevolutionPlan, Stop, ViewOrder};
pub use worker::{AcquisitionError, AcquisitionSettings, Next, SinkClosed, retake, revolve};
