//! The place of one larva by every estimator.

use super::estimate::{EYES, Estimate, VOXEL};
use super::group::{Group, Moments, Quantity, References};
use super::joint::{JointPlace, JointPredictive};
use super::matching::{Missing, Specimen, asd_is_matched};
use super::predictive::{Place, Predictive};
use super::stage::Stage;
use serde::{Deserialize, Serialize};

/// A result, or the reason why there is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(rename = "{T}Answer"))]
#[serde(rename_all = "snake_case")]
pub enum Answer<T> {
    /// The result.
    Known(T),
    /// Why there is none.
    Missing(Missing),
}

/// The place of a larva among reference larvae of its age, by every estimator that has references.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Standing {
    /// Age at which it was compared, days post fertilisation: that of the plate map.
    pub dpf: f64,
    /// Why nothing was compared. `None` where it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_compared: Option<NotCompared>,
    /// One entry per estimator. The paper's is first, with or without references. Empty where nothing was compared.
    pub estimates: Vec<EstimateStanding>,
    /// The place of the eyes. `None` unless both were found, and in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eyes: Option<EyesStanding>,
}

/// Why a larva is compared with no references.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum NotCompared {
    /// Its numbers are lower bounds.
    #[error("part of the larva was not measured")]
    PartUnseen,
}

/// The place of the numbers of the eyes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EyesStanding {
    /// Place of the mean volume of both eyes.
    pub volume: Answer<Place>,
    /// Place of the distance between their centres.
    pub distance: Answer<Place>,
}

/// The place of one estimator's numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EstimateStanding {
    /// Name of the estimator.
    pub estimator: String,
    /// Place of the volume.
    pub volume: Answer<Place>,
    /// Place of the area.
    pub area: Answer<Place>,
    /// Place of both together.
    pub joint: Answer<JointPlace>,
    /// Probability of each age.
    pub stage: Answer<Stage>,
}

impl<T> From<Result<T, Missing>> for Answer<T> {
    fn from(found: Result<T, Missing>) -> Self {
        found.map_or_else(Self::Missing, Self::Known)
    }
}

impl<T> Answer<T> {
    /// The result, if there is one.
    pub fn known(&self) -> Option<&T> {
        match self {
            Self::Known(found) => Some(found),
            Self::Missing(_) => None,
        }
    }
}

impl Standing {
    /// Compares a specimen with all references.
    pub fn of(specimen: &Specimen, references: &[References]) -> Self {
        if specimen.is_bound {
            return Self { dpf: specimen.dpf, not_compared: Some(NotCompared::PartUnseen), estimates: Vec::new(), eyes: None };
        }
        let has = |name: &str| name == VOXEL || references.iter().flat_map(|r| &r.groups).any(|g| g.estimator == name);
        let asked = specimen.estimates.iter().filter(|e| has(e.estimator));
        let place = |estimator: &str, quantity, value: f64, moments: fn(&Group) -> Option<Moments>| -> Answer<Place> {
            let found = specimen.find(references, estimator, quantity, |g| Predictive::new(moments(g)?, g.n));
            found.map(|(fit, predictive)| predictive.place(value, &fit.group.name, fit.mismatches)).into()
        };
        let eyes = specimen.eyes.map(|eyes| EyesStanding {
            volume: place(EYES, Quantity::EyeVolume, eyes.volume_um3, |g| g.eye_volume_um3),
            distance: place(EYES, Quantity::EyeDistance, eyes.distance_um, |g| g.eye_distance_um),
        });
        let of_one = |e: &Estimate| {
            let single = |quantity, value: f64, moments| place(e.estimator, quantity, value, moments);
            let joint = specimen.find(references, e.estimator, Quantity::Joint, JointPredictive::of);
            EstimateStanding {
                estimator: e.estimator.to_owned(),
                volume: single(Quantity::Volume, e.volume_um3, |g| g.volume_um3),
                area: single(Quantity::Area, e.area_um2, |g| g.area_um2),
                joint: joint.map(|(fit, numbers)| numbers.place(e.volume_um3, e.area_um2, &fit.group.name, fit.mismatches)).into(),
                stage: specimen.stage(references, e).into(),
            }
        };
        Self { dpf: specimen.dpf, not_compared: None, estimates: asked.map(of_one).collect(), eyes }
    }

    /// Volume and area in standard deviations from the mean of larvae of the same age and ASD, by this estimator; by the
    /// paper's where only that one has references. `None` without a reference.
    pub fn z(&self, estimator: &str) -> [Option<f64>; 2] {
        let of = |quantity: fn(&EstimateStanding) -> &Answer<Place>| {
            let place = |name| quantity(self.by(name)?).known().filter(|p| asd_is_matched(&p.mismatches));
            place(estimator).or_else(|| place(VOXEL)).map(|p| p.z)
        };
        [of(|e| &e.volume), of(|e| &e.area)]
    }

    /// The place of this estimator's numbers. `None` where it was not compared.
    pub fn by(&self, estimator: &str) -> Option<&EstimateStanding> {
        self.estimates.iter().find(|e| e.estimator == estimator)
    }
}
