//! The numbers of a measurement, by the name of their estimator.

use crate::inside::Eyes;
use crate::measure::{Estimators, Measurement};

/// Name of the paper's estimator: volume of the voxels, area of their faired surface.
pub const VOXEL: &str = "voxel";
/// Name of the field's estimator: volume and area of the surface where the outlines put it.
pub const FIELD: &str = "field";

/// Name of the estimator by support functions of the slices.
pub const SUPPORT: &str = "support";

/// Name of the estimator of the eyes.
pub const EYES: &str = "eyes";

/// The numbers of the eyes, where both were found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EyeNumbers {
    /// Mean volume of both.
    pub volume_um3: f64,
    /// Distance between their centres.
    pub distance_um: f64,
}

impl EyeNumbers {
    /// `None` unless both eyes were found.
    pub fn of(eyes: &Eyes) -> Option<Self> {
        Some(Self { volume_um3: eyes.mean_volume_um3?, distance_um: eyes.distance_um? })
    }
}

/// Volume and area by one estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Name of the estimator.
    pub estimator: &'static str,
    /// Volume.
    pub volume_um3: f64,
    /// Area.
    pub area_um2: f64,
}

/// The numbers of every estimator, the paper's first.
pub fn estimates(measurement: &Measurement) -> Vec<Estimate> {
    // Each estimator is named, so that a further one does not compile before it is added here: references of one must never be
    // compared with the numbers of another. `volume_um3` and `area_um2` are those of one of these.
    let Measurement { estimators: Estimators { voxel, support }, field_volume_um3, field_area_um2, .. } = measurement;
    let of = |estimator, volume_um3: &f64, area_um2: &f64| Estimate { estimator, volume_um3: *volume_um3, area_um2: *area_um2 };
    let mut all = vec![of(VOXEL, &voxel.volume_um3, &voxel.area_um2), of(FIELD, field_volume_um3, field_area_um2)];
    all.extend(support.as_ref().map(|s| of(SUPPORT, &s.volume_um3, &s.area_um2)));
    all
}
