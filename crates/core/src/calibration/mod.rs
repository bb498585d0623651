//! Position of the axis and true angles of the capillary, from the profiles of one turn.
//!
//! ```text
//!  Columns per view ── closed form ── uy, gamma ── least squares ── uy, gamma, alpha, rho, dy_i, covariance
//!                                                     │    ▲
//!                             a slice's tangents ─────┘    └── views that do not belong, a specimen that moved
//! ```
//! The shape of each slice is unknown. It is a support function that is eliminated, so no model of the specimen is needed.
//! Parameters that silhouettes do not determine are not estimated: `f`, `kx`, `ky` and `ux` are the rig's.

mod closed_form;
mod coherence;
mod free;
mod hull_slices;
mod least_squares;
pub mod mark;
mod objective;
mod placed;
mod pose_offset;
mod psi;
pub mod rig;
mod screen;
mod search;
mod simplex;
mod slices;
mod support;
mod tangents;
mod turn;
mod vrv_check;

pub use closed_form::{AxisError, axis};
pub use coherence::coherence;
pub(crate) use coherence::reprojected_areas;
pub use free::{Ask, Free, Parameter, Refusal};
pub use least_squares::{GivenView, GlassFound, PASSES_MOST, Priors, SolveError};
pub use objective::{Objective, Optimised, Vrv, optimise};
pub(crate) use placed::{Exchanged, Placed, exchanged, placed, placed_by_halves};
pub(crate) use pose_offset::pose_offset;
pub use pose_offset::{PoseOffset, PoseOffsetSd};
pub use psi::Psi;
pub use screen::{Bad, Moved};
pub use search::Stop;
pub(crate) use slices::{Fit, Sight, Slice, SliceError, fit, harmonics};
pub use slices::{HARMONICS_MOST, SlicesLost, directions, widest_gap};
#[cfg(test)]
pub(crate) use support::series_of;
pub(crate) use support::{Support, area_loss, basis};
pub(crate) use tangents::Side;
pub use tangents::{Pose, TurnView};
pub use turn::{Calibration, CalibrationError, PsiSd, VIEWS_LEAST, ViewState, calibrate};
pub(crate) use vrv_check::hull_sd_share;
pub use vrv_check::{VrvCheck, VrvVerdict, check_vrv};
