//! Where the axis is and how far the capillary turned, from the profiles of one turn.
//!
//! ```text
//!  Columns per view ── closed form ── uy, gamma ── least squares ── uy, gamma, alpha, rho, dy_i, covariance
//!                                                     │    ▲
//!                             a slice's tangents ─────┘    └── views that do not belong, a specimen that moved
//! ```
//! Unknown per slice is its shape, as a support function: it is eliminated, so that no model of the specimen is needed. What
//! silhouettes do not tell is not asked: `f`, `kx`, `ky` and `ux` are the rig's.

mod closed_form;
pub mod cma;
mod coherence;
mod free;
mod gate;
mod hull_slices;
mod least_squares;
mod lie;
pub mod mark;
mod objective;
mod psi;
pub mod rig;
mod screen;
mod search;
pub mod simplex;
mod slices;
mod support;
mod tangents;
mod turn;

pub use closed_form::{AxisError, axis};
pub use coherence::{coherence, seen_again};
pub use free::{Ask, Free, Parameter, Refusal};
pub use gate::{Gate, Verdict, gate};
pub use least_squares::{GivenView, PASSES_MOST, Priors, Solution, SolveError, solve};
pub use lie::{Lie, LieSd, lie};
pub use objective::{Objective, Optimised, Optimiser, Vrv, optimise};
pub use psi::Psi;
pub use screen::{Bad, Moved, ViewOff};
pub use search::{Found, Reach, Stop};
pub use slices::{Fit, HARMONICS_MOST, Sight, Slice, directions, fit, harmonics, widest_gap};
pub use support::{Support, area_loss};
pub use tangents::{Pose, Side, Tangent, TurnView};
pub use turn::{Calibration, CalibrationError, PsiSd, VIEWS_LEAST, ViewState, calibrate};
