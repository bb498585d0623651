//! Whether a number may be trusted: every limit has a name and a unit in the method, and what is over one is a flag.
//!
//! ```text
//!  a turn's views, closure, calibration ── Quality::of ── checks: found, limit, unit ── over: a flag by name
//!                     place among references ──┘
//!  residual strip ── spoiled ── views to be taken again
//!  corrected estimates so far ── has_converged ── should_stop ── enough views
//!  a few beads, this instrument's earlier gates ── BeadGate::of ── verdict and words
//! ```
//! Values in, values out. `docs/quality.md` says what each number is and what an operator does about it.

mod checks;
mod early_stop;
mod estimate;
pub mod gate;
mod limits;
mod strip;
mod turn;

pub use checks::{Check, OFF_REFERENCES, Quality};
pub use early_stop::{EarlyStopSettings, has_converged, should_stop};
pub use estimate::Estimate;
pub use limits::QualitySettings;
pub use strip::{Spoiled, ViewStrip, spoiled};
pub use turn::{CalibrationOff, ClosureOff, ClosureSd, TurnFacts, tell_little};
