//! Volume and area from the slices' support functions: profiles' edges in, no voxels.
//!
//! ```text
//!  column of the image ── tangents of all views ── Fourier fit of h(theta) ─┐
//!                                                 smoothed along x ─────────┴─ Sections ── volume = Int A dx
//!                                                                                      └── area   = Int Int (h + h'') sqrt(1 + h_x^2)
//! ```
//! A slice is taken as convex. What is measured is the ideal visual hull, with each slice filled to its convex outline. Where
//! views show a slice as two, `gap_share` says so, and the voxels are trusted instead.

mod cap;
mod corners;
mod estimate;
mod integrals;
mod noise;
mod sections;
mod sensitivity;
mod smoothing;

pub use estimate::SupportEstimate;
pub use sections::{Sections, SectionsError};
pub(crate) use sensitivity::given_sd;
pub use sensitivity::{SensitivityError, calibration_sd};
