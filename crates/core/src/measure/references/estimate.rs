//! The numbers of a measurement by the name of what made them.

use crate::measure::{Estimators, Measurement};

/// Volume of the voxels and area of their faired surface: the paper's numbers.
pub const VOXEL: &str = "voxel";
/// Volume and area of the surface where the outlines put it.
pub const FIELD: &str = "field";

/// By support functions of the slices.
pub const SUPPORT: &str = "support";

/// Volume and area that one estimator gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    pub estimator: &'static str,
    pub volume_um3: f64,
    pub area_um2: f64,
}

/// Every estimator's numbers, the paper's first. A further estimator is a further line here.
pub fn estimates(measurement: &Measurement) -> Vec<Estimate> {
    // Each estimator is named, so that a further one does not compile before it has been thought of here: references of one must
    // never be compared with the numbers of another. Those on top are one of these.
    let Measurement { estimators: Estimators { voxel, support }, field_volume_um3, field_area_um2, .. } = measurement;
    let of = |estimator, volume_um3: &f64, area_um2: &f64| Estimate { estimator, volume_um3: *volume_um3, area_um2: *area_um2 };
    let mut all = vec![of(VOXEL, &voxel.volume_um3, &voxel.area_um2), of(FIELD, field_volume_um3, field_area_um2)];
    all.extend(support.as_ref().map(|s| of(SUPPORT, &s.volume_um3, &s.area_um2)));
    all
}
