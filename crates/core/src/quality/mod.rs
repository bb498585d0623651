//! Whether a number may be trusted. Every limit has a name and a unit in the method; a number beyond its limit raises a flag.
//!
//! ```text
//!  a turn's views, closure, calibration ── Quality::of ── checks: found, limit, unit ── over: its flag
//!                     place among references ──┘
//!  the checks, and facts of views, hull and calibration ── flags ── what an operator must know
//!  residual strip ── spoiled ── views to be taken again
//!  outlines and pixels of the views, compared ── Turning ── why this is not one specimen that turns
//!  outlines of two wells in stripes ── CoarseOutline ── are they one picture, stored in two formats
//!  corrected estimates so far ── has_converged ── should_stop ── enough views
//!  a larva's opacity, those of the rig's newest larvae ── UsualOpacity ── does it look dead
//!  a few beads, this instrument's earlier gates ── BeadGate::of ── verdict and words
//! ```
//! Functions of values only. `docs/quality.md` explains each number and what an operator does about it.

mod checks;
mod coarse_outline;
mod early_stop;
mod estimate;
mod flags;
pub mod gate;
mod limits;
mod opaque;
mod strip;
mod turn;
mod turning;

pub use checks::{Check, Quality};
pub use coarse_outline::CoarseOutline;
pub use early_stop::{EarlyStopSettings, has_converged, should_stop};
pub use estimate::Estimate;
pub(crate) use flags::{FlagFacts, add_raised, flags, views_needed};
pub use limits::QualitySettings;
pub use opaque::{RecentOpacities, UsualOpacity};
pub use strip::Spoiled;
pub(crate) use strip::{ViewStrip, spoiled};
pub use turn::tell_little;
pub(crate) use turn::{CalibrationOff, ClosureOff, ClosureSd, TurnFacts};
pub(crate) use turning::{OFF_BORE_PX, Places, of_calibration};
pub use turning::{TurnFinding, Turning};
