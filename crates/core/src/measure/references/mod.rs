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
//!  limb ─── how much smaller than it is a bead looks
//!  summary ─ groups of a lab's own controls
//! ```
//! Age, estimator and ASD decide whether a number is compared at all: the paper's own means differ by several standard
//! deviations between ASDs. Other differences, and values that are not known, are stated beside each number. A number without a
//! reference is stated to have none. `docs/references.md` has the formulas.

pub mod bead;
mod estimate;
mod group;
mod joint;
pub mod limb;
mod matching;
mod predictive;
mod stage;
mod standing;
mod summary;
mod words;

pub use estimate::{EYES, Estimate, EyeNumbers, FIELD, SUPPORT, VOXEL, estimates};
pub use group::{Breach, Gap, Group, Moments, Quantity, References, SCHEMA};
pub use joint::JointPlace;
pub use matching::{Known, Mismatch, Missing, MissingReason, Specimen, is_untreated};
pub use predictive::{Place, Predictive};
pub use stage::{Stage, StageShare};
pub use standing::{Answer, EstimateStanding, EyesStanding, NotCompared, Standing};
pub use summary::{Control, FEWEST, Summaries, Unfit, summarise};

#[cfg(test)]
mod tests;
