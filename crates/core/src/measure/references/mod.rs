//! The place of one larva among reference larvae of its age.
//!
//! ```text
//!  References (checked groups: age, ASD, SD, epsilon, estimator; n, mean, SD, covariance)
//!        │
//!  Specimen ── matching ── which group may be asked, and what does not match ──┐
//!                                                                              ▼
//!              predictive ── z, t_{n-1}, p, percentile, 95 % interval ────► Standing ── words
//!              joint ─────── Mahalanobis, Hotelling's T^2, F_{2,n-2} ────────► │
//!              stage ─────── probability of each age, equal priors ──────────► │
//!  bead ─── the paper's t score of a set of beads, and its power
//!  summary ─ groups of a lab's own controls
//! ```
//! Age, estimator and ASD decide whether a number is compared at all: the paper's own means move by several standard
//! deviations with the ASD. What else does not match, or is not known, is said beside each number; what has no reference is
//! said to have none. `docs/references.md` has the formulas.

pub mod bead;
mod estimate;
mod group;
mod joint;
mod matching;
mod predictive;
mod stage;
mod standing;
mod summary;
mod words;

pub use estimate::{Estimate, FIELD, SUPPORT, VOXEL, estimates};
pub use group::{Breach, Gap, Group, Moments, Quantity, References, SCHEMA};
pub use joint::JointPlace;
pub use matching::{Known, Mismatch, Missing, MissingReason, Specimen};
pub use predictive::{Place, Predictive};
pub use stage::{Stage, StageShare};
pub use standing::{Answer, EstimateStanding, Standing};
pub use summary::{Control, FEWEST, Summaries, Unfit, summarise};

#[cfg(test)]
mod tests;
