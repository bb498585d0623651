//! One revolution of the capillary, view by view.
//!
//! ```text
//! RevolutionPlan ──► revolve ──────────────────────────────► sink (a bounded channel to the science)
//!  integer steps     move ─► settle ─► trigger ─► frame ──┬──► LedgerEntry + RawFrame
//!                     ▲                                   │
//!                     └───────── next stop ◄──────────────┘   the axis turns while the frame is evaluated
//! ```
//! The plan is immutable. The [`Ledger`](carved_records::Ledger) has the achieved position of every view. The science receives the achieved angle, never the
//! planned one. All functions here block, without an async runtime.

mod grab;
mod plan;
mod sweep;
mod worker;

pub use grab::{grab, grab_second};
pub use plan::{PlanError, RevolutionPlan, Stop};
pub use sweep::{SweepError, SweepPlan, sweep};
pub use worker::{AcquisitionError, AcquisitionSettings, Next, SinkClosed, retake, revolve};
