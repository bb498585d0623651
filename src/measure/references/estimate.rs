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
pub fn estimates(measurement: &Measurement) -> Vec<Estimate> {
    // Every field is named, so that a further estimator's do not compile before it has been thought of here: references of one
    // estimator must never be compared with the numbers of another.
    let &Measurement {
        volume_um3,
        area_um2,
        field_volume_um3,
        field_area_um2,
        voxels: _,
        voxel_size_um: _,
        views: _,
        planned_views: _,
        epsilon: _,
        mesh_volume_um3: _,
        fairing_volume_loss: _,
        unfaired_area_um2: _,
        area_method: _,
        centroid_um: _,
        extent_um: _,
        length_um: _,
        sphere: _,
    } = measurement;
    vec![
        Estimate { estimator: VOXEL, volume_um3, area_um2 },
        Estimate { estimator: FIELD, volume_um3: field_volume_um3, area_um2: field_area_um2 },
    ]
}
