//! Area coherence: the mean overlap of a profile with the hull that is projected back.
//!
//! ```text
//!   overlap of a view = sum over slices of the hull's width / sum of the profile's        coherence = mean over views
//! ```
//! With no miss allowed the projected hull lies within every profile, so this is the intersection over the union.

use super::hull_slices::HullSlices;
use super::psi::Psi;
use crate::profile::Columns;

/// Mean over the views of the share of the profile that the hull fills when it is projected back, 0 to 1. It is 1 where every
/// edge of every profile touches the hull, and 0 where nothing is left. `columns` has one profile per view of `psi`.
pub fn coherence(columns: &[&Columns], psi: &Psi) -> f64 {
    HullSlices::new(columns.to_vec(), &psi.camera).coherence(psi)
}

/// For each view the area of the hull (no miss allowed) projected back, and the area of its own profile, um^2 at the axis.
pub(crate) fn reprojected_areas(columns: &[&Columns], psi: &Psi) -> Vec<[f64; 2]> {
    HullSlices::new(columns.to_vec(), &psi.camera).reprojected_areas(psi)
}
