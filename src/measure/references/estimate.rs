//! The numbers of a measurement by the name of what made them.

use crate::measure::Measurement;

/// Volume of the voxels and area of their faired surface: the paper's numbers.
pub const VOXEL: &str = "voxel";
/// Volume and area of the surface where the outlines put it.
pub const FIELD: &str = "field";

/// Volume and area that one estimator gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    pub estimator: &'static str,
    pub volume_um3: f64,
    pub area_um2: f64,
}

/// Every estimator's numbers, the paper's first. A further estimator is a further line here.
pub fn estimates(m: &Measurement) -> Vec<Estimate> {
    vec![
        Estimate { estimator: VOXEL, volume_um3: m.volume_um3, area_um2: m.area_um2 },
        Estimate { estimator: FIELD, volume_um3: m.field_volume_um3, area_um2: m.field_area_um2 },
    ]
}
