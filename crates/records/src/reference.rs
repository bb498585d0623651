//! The short form of a larva's place among reference larvae, as the status and the page show it.

use carved_core::measure::references::{Answer, Place, Quantity, Standing, VOXEL};
use serde::{Deserialize, Serialize};

/// The place of `volume_um3` and `area_um2`; `measurement.json` has the whole of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceStatus {
    pub volume: PlaceStatus,
    pub area: PlaceStatus,
}

/// One number among the reference larvae of its age; `null` throughout where there are none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaceStatus {
    /// `area 0.8 SD below the mean of 24 larvae of 4 dpf`, or why there is no such place.
    pub words: String,
    /// Name of the group of reference larvae.
    pub group: Option<String>,
    /// Larvae in it.
    pub n: Option<u32>,
    /// Standard deviations above the group's mean.
    pub z: Option<f64>,
    /// Share of the group's larvae that are smaller, %.
    pub percentile: Option<f64>,
    /// What of the measurement and the group does not match, or is not known, in words.
    pub mismatches: Vec<String>,
}

impl ReferenceStatus {
    /// `None` where the standing has no voxel estimate, which is the one that the reference larvae were measured by.
    pub fn of(standing: &Standing) -> Option<Self> {
        let papers = standing.by(VOXEL)?;
        let place = |answer, quantity| PlaceStatus::of(answer, quantity, standing.dpf);
        Some(Self { volume: place(&papers.volume, Quantity::Volume), area: place(&papers.area, Quantity::Area) })
    }
}

impl PlaceStatus {
    fn of(answer: &Answer<Place>, quantity: Quantity, dpf: f64) -> Self {
        let place = answer.known();
        Self {
            words: answer.words(quantity, dpf),
            group: place.map(|p| p.group.clone()),
            n: place.map(|p| p.n),
            z: place.map(|p| p.z),
            percentile: place.map(|p| p.percentile),
            mismatches: place.map_or_else(Vec::new, |p| p.mismatches.iter().map(ToString::to_string).collect()),
        }
    }
}
