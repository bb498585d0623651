//! The comparison of a larva with reference larvae in short form, as the status and the page show it.

use carved_core::measure::references::{Answer, Place, Quantity, Standing, VOXEL};
use serde::{Deserialize, Serialize};

/// The comparison of `volume_um3`, `area_um2` and the eyes. `measurement.json` has the full form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct ReferenceStatus {
    pub volume: PlaceStatus,
    pub area: PlaceStatus,
    /// Of the mean volume of both eyes. `null` unless both were found.
    #[serde(default)]
    pub eye_volume: Option<PlaceStatus>,
    /// Of the distance between the eyes. `null` unless both were found.
    #[serde(default)]
    pub eye_distance: Option<PlaceStatus>,
}

/// The comparison of one number with the reference larvae of its age. The fields are `null` if there are none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct PlaceStatus {
    /// `area 0.8 SD below the mean of 24 larvae of 4 dpf`, or why there is no comparison.
    pub words: String,
    /// Name of the group of reference larvae.
    pub group: Option<String>,
    /// Number of larvae in the group.
    pub n: Option<u32>,
    /// Standard deviations above the group's mean.
    pub z: Option<f64>,
    /// Share of the group's larvae that are smaller, %.
    pub percentile: Option<f64>,
    /// Differences and unknown conditions between the measurement and the group, as text.
    pub mismatches: Vec<String>,
}

impl ReferenceStatus {
    /// `None` if there is no voxel estimate. The reference larvae were measured with this estimator. Of a larva that is compared with none, volume
    /// and area say why.
    pub fn of(standing: &Standing) -> Option<Self> {
        if let Some(why) = standing.not_compared {
            let none = |quantity| PlaceStatus::none(format!("{quantity}: not compared, because {why}"));
            return Some(Self { volume: none(Quantity::Volume), area: none(Quantity::Area), eye_volume: None, eye_distance: None });
        }
        let papers = standing.by(VOXEL)?;
        let place = |answer, quantity| PlaceStatus::of(answer, quantity, standing.dpf);
        let eyes = standing.eyes.as_ref();
        Some(Self {
            volume: place(&papers.volume, Quantity::Volume),
            area: place(&papers.area, Quantity::Area),
            eye_volume: eyes.map(|eyes| place(&eyes.volume, Quantity::EyeVolume)),
            eye_distance: eyes.map(|eyes| place(&eyes.distance, Quantity::EyeDistance)),
        })
    }
}

impl PlaceStatus {
    fn of(answer: &Answer<Place>, quantity: Quantity, dpf: f64) -> Self {
        let words = answer.words(quantity, dpf);
        let Some(place) = answer.known() else { return Self::none(words) };
        Self {
            words,
            group: Some(place.group.clone()),
            n: Some(place.n),
            z: Some(place.z),
            percentile: Some(place.percentile),
            mismatches: place.mismatches.iter().map(ToString::to_string).collect(),
        }
    }

    fn none(words: String) -> Self {
        Self { words, group: None, n: None, z: None, percentile: None, mismatches: Vec::new() }
    }
}
