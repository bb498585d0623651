//! Area coherence: the mean overlap of profile and re-projected hull.
//!
//! ```text
//!   overlap of a view = sum over slices of the hull's width / sum of the profile's        coherence = mean over views
//! ```
//! With no miss allowed the hull seen again lies within every profile, so this is their intersection over their union.

use super::hull_slices::HullSlices;
use super::psi::Psi;
use crate::profile::Columns;

/// 1 where every edge of every profile touches the hull; 0 where nothing is left.
pub fn coherence(columns: &[&Columns], psi: &Psi) -> f64 {
    HullSlices::new(columns.to_vec(), &psi.camera).coherence(psi)
}

/// Each view's area of what no view misses, seen again, and of its own profile: um^2 at the axis.
pub(crate) fn reprojected_areas(columns: &[&Columns], psi: &Psi) -> Vec<[f64; 2]> {
    HullSlices::new(columns.to_vec(), &psi.camera).reprojected_areas(psi)
}
