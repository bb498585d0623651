//! Reference larvae as they are stored: groups of one age, treatment and way of measuring.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Value of `schema` in a file of references.
pub const SCHEMA: &str = "carved.references/1";

/// One file of references.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct References {
    /// [`SCHEMA`].
    pub schema: String,
    /// Name of the set.
    pub name: String,
    /// Numbers that a reader would expect here and that are missing.
    #[serde(default, rename = "missing", skip_serializing_if = "Vec::is_empty")]
    pub gaps: Vec<Gap>,
    /// The groups.
    #[serde(default, rename = "group")]
    pub groups: Vec<Group>,
}

/// A quantity that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Volume.
    Volume,
    /// Area.
    Area,
    /// Volume and area together.
    Joint,
    /// Mean volume of both eyes.
    EyeVolume,
    /// Distance between the centres of the eyes.
    EyeDistance,
}

/// A number that these references do not have, with the reason.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gap {
    /// The quantity.
    pub quantity: Quantity,
    /// Age of the larvae that it is missing for, days post fertilisation. `None` for every age.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dpf: Option<f64>,
    /// The reason.
    pub why: String,
}

/// Larvae of one age that were measured in one way. `None` means not known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Name of the group, unique within its file.
    pub name: String,
    /// Days post fertilisation.
    pub dpf: f64,
    /// `fixed`, `living`, or what was done to them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub treatment: Option<String>,
    /// Strain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strain: Option<String>,
    /// A further name that separates larvae: a batch, a clutch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cohort: Option<String>,
    /// Number of larvae.
    pub n: u32,
    /// ASD: views per revolution.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asd: Option<u32>,
    /// SD: edge of a voxel, um.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voxel_um: Option<f64>,
    /// Share of the views that may miss a voxel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epsilon: Option<f64>,
    /// Estimator of the numbers; the paper's is `voxel`.
    pub estimator: String,
    /// Whether they were measured on an emulated rig.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub simulated: bool,
    /// Mean and standard deviation of the volume, um^3.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_um3: Option<Moments>,
    /// Mean and standard deviation of the area, um^2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area_um2: Option<Moments>,
    /// Covariance of volume and area over the larvae, um^5 (um^3 times um^2), with the divisor n - 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance_um5: Option<f64>,
    /// Mean and standard deviation of the mean volume of both eyes, um^3. The estimator is `eyes`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eye_volume_um3: Option<Moments>,
    /// Mean and standard deviation of the distance between the centres of the eyes, um. The estimator is `eyes`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eye_distance_um: Option<Moments>,
    /// Where the numbers are from.
    pub source: String,
}

/// Mean and standard deviation (divisor n - 1) over the larvae, in the unit of the key.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Moments {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
}

/// One fault in references, with what is expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}{key} = {found}; expected {expected}")]
pub struct Breach {
    place: String,
    key: &'static str,
    found: String,
    expected: &'static str,
}

impl Quantity {
    /// The name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Volume => "volume",
            Self::Area => "area",
            Self::Joint => "volume and area together",
            Self::EyeVolume => "eye volume",
            Self::EyeDistance => "distance of the eyes",
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl References {
    /// Every fault, not only the first.
    pub fn check(&self) -> Vec<Breach> {
        let mut breaches = Vec::new();
        let mut wrong = |key, found: &dyn fmt::Debug, expected| {
            breaches.push(Breach { place: String::new(), key, found: format!("{found:?}"), expected });
        };
        if self.schema != SCHEMA {
            wrong("schema", &self.schema, "\"carved.references/1\"");
        }
        if self.groups.is_empty() {
            wrong("group", &"none", "at least one [[group]]");
        }
        let mut names: Vec<_> = self.groups.iter().map(|g| g.name.as_str()).collect();
        names.sort_unstable();
        for twice in names.windows(2).filter(|w| w[0] == w[1]) {
            wrong("group.name", &twice[0], "a name that no other group of the file has");
        }
        breaches.extend(self.groups.iter().flat_map(Group::check));
        breaches
    }
}

impl Group {
    /// Checks that the numbers can be used: a place among fewer than three larvae says nothing, and without spread nothing can
    /// be compared.
    fn check(&self) -> Vec<Breach> {
        let mut breaches = Vec::new();
        let mut wrong = |key, found: String, expected| {
            breaches.push(Breach { place: format!("group {:?}: ", self.name), key, found, expected });
        };
        if !(0.0..=30.0).contains(&self.dpf) {
            wrong("dpf", self.dpf.to_string(), "0 to 30 days post fertilisation");
        }
        if self.n < 3 {
            wrong("n", self.n.to_string(), "3 larvae or more");
        }
        if let Some(asd) = self.asd.filter(|asd| *asd < 3) {
            wrong("asd", asd.to_string(), "3 views per revolution or more, or no key where it is not known");
        }
        if let Some(size) = self.voxel_um.filter(|s| !positive(*s)) {
            wrong("voxel_um", size.to_string(), "an edge above 0 um, or no key where it is not known");
        }
        if let Some(epsilon) = self.epsilon.filter(|e| !(0.0..0.5).contains(e)) {
            wrong("epsilon", epsilon.to_string(), "0 up to, not including, 0.5, or no key where it is not known");
        }
        if self.estimator.is_empty() {
            wrong("estimator", "\"\"".into(), "what made the numbers, as \"voxel\"");
        }
        let all = [
            ("volume_um3", self.volume_um3),
            ("area_um2", self.area_um2),
            ("eye_volume_um3", self.eye_volume_um3),
            ("eye_distance_um", self.eye_distance_um),
        ];
        for (key, moments) in all {
            if let Some(m) = moments.filter(|m| !(positive(m.mean) && positive(m.sd))) {
                wrong(key, format!("{{ mean = {}, sd = {} }}", m.mean, m.sd), "mean and standard deviation above 0");
            }
        }
        match (self.volume_um3, self.area_um2, self.covariance_um5) {
            (None, None, _) if self.eye_volume_um3.is_none() && self.eye_distance_um.is_none() => {
                wrong("volume_um3", "nothing".into(), "volume_um3, area_um2 or both, or numbers of the eyes");
            }
            (Some(v), Some(a), Some(c)) if c.is_nan() || c.abs() >= v.sd * a.sd => {
                wrong("covariance_um5", c.to_string(), "less than the product of both standard deviations");
            }
            (None, _, Some(c)) | (_, None, Some(c)) => {
                wrong("covariance_um5", c.to_string(), "no covariance without both volume_um3 and area_um2");
            }
            _ => {}
        }
        breaches
    }
}

fn positive(x: f64) -> bool {
    x.is_finite() && x > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::references::tests;

    fn sound() -> References {
        let group = Group { n: 3, covariance_um5: Some(5e11), ..tests::group("a", 4.0) };
        References { schema: SCHEMA.into(), name: "test".into(), gaps: Vec::new(), groups: vec![group] }
    }

    #[test]
    fn every_breach_is_listed_with_its_group() {
        assert_eq!(sound().check(), []);
        let mut broken = sound();
        let g = &mut broken.groups[0];
        (g.dpf, g.n, g.asd, g.voxel_um, g.epsilon) = (-1.0, 2, Some(2), Some(0.0), Some(0.5));
        g.area_um2 = Some(Moments { mean: 3.3e6, sd: f64::NAN });
        g.estimator = String::new();
        broken.groups.push(broken.groups[0].clone());
        broken.schema = "carved.references/2".into();
        let said: Vec<_> = broken.check().iter().map(ToString::to_string).collect();
        assert_eq!(said.len(), 2 + 2 * 7, "{said:#?}");
        assert!(said.contains(&"group \"a\": n = 2; expected 3 larvae or more".to_owned()), "{said:#?}");
        assert!(said[0].starts_with("schema = \"carved.references/2\""), "{said:#?}");
        assert!(said[1].starts_with("group.name = \"a\""), "{said:#?}");
    }

    #[test]
    fn a_covariance_needs_both_quantities_and_less_than_their_spread() {
        let with = |change: fn(&mut Group)| {
            let mut references = sound();
            change(&mut references.groups[0]);
            references.check().len()
        };
        assert_eq!(with(|g| g.covariance_um5 = Some(1e12)), 1);
        assert_eq!(with(|g| g.covariance_um5 = Some(f64::NAN)), 1);
        assert_eq!(with(|g| g.covariance_um5 = Some(-0.99e12)), 0);
        assert_eq!(with(|g| g.volume_um3 = None), 1);
        assert_eq!(with(|g| (g.volume_um3, g.covariance_um5) = (None, None)), 0);
        assert_eq!(with(|g| (g.volume_um3, g.area_um2, g.covariance_um5) = (None, None, None)), 1);
    }
}
