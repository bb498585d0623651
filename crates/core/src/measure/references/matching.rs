//! Selects the group of references that a specimen may be compared with, and lists what does not match.
//!
//! ```text
//!  groups ─ of its age? ─ of this estimator? ─ with this quantity? ─ not of another ASD? ─► the one with fewest mismatches
//!                │               │                    │                      │
//!               Age          Estimator             Quantity                 Asd          Missing, with what there is
//! ```

use super::estimate::{Estimate, EyeNumbers};
use super::group::{Group, Quantity, References};
use serde::{Deserialize, Serialize};

/// Largest difference of age, days, at which larvae are compared: in a tenth of a day the paper's larvae grow by at most a
/// fifth of their standard deviation (table 5, ASD 21: 0.29e6 um^2 from 4 to 5 dpf, SD 0.14e6).
const SAME_AGE_DAYS: f64 = 0.1;

/// One larva, as it was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Specimen {
    /// Days post fertilisation.
    pub dpf: f64,
    /// Views per revolution of the method.
    pub asd: u32,
    /// Views that carved.
    pub views: usize,
    /// Edge of a voxel, um.
    pub voxel_um: f64,
    /// Share of the views that may miss a voxel.
    pub epsilon: f64,
    /// Whether it was measured on an emulated rig.
    pub simulated: bool,
    /// Strain by the plate map. `None` where the map does not state it.
    pub strain: Option<String>,
    /// Treatment by the plate map. `None` where the map does not state it.
    pub treatment: Option<String>,
    /// Whether the plate map states that nothing was done to the larva: it matches untreated and living references.
    pub untreated: bool,
    /// The numbers of every estimator.
    pub estimates: Vec<Estimate>,
    /// `None` unless both eyes were found.
    pub eyes: Option<EyeNumbers>,
    /// Whether a part of it was not measured: [`StoredFlag::is_bound`](crate::flag::StoredFlag::is_bound).
    pub is_bound: bool,
}

/// Treatments of living larvae to which nothing was done. `living` is the paper's word for those that were not fixed.
const UNTREATED: [&str; 6] = ["none", "no treatment", "untreated", "living", "live", "alive"];

/// Whether a treatment says that nothing was done to a living larva.
pub fn is_untreated(treatment: &str) -> bool {
    UNTREATED.iter().any(|word| is_same(word, treatment))
}

/// Whether two words of an operator are the same.
fn is_same(one: &str, other: &str) -> bool {
    one.trim().eq_ignore_ascii_case(other.trim())
}

/// A value of a setting, or a word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum Known {
    /// A number.
    Number(f64),
    /// A word.
    Word(String),
}

/// One difference between a specimen and its reference larvae. `null` means not known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Mismatch {
    /// `asd`, `views`, `voxel_um`, `epsilon`, `treatment`, `strain`, `cohort` or `mode`.
    pub key: String,
    /// Value of the specimen.
    pub specimen: Option<Known>,
    /// Value of the references.
    pub reference: Option<Known>,
}

/// The question at which no group was left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum MissingReason {
    /// No group of this age.
    Age,
    /// No group of this estimator.
    Estimator,
    /// No group with this quantity.
    Quantity,
    /// No group of this ASD.
    Asd,
}

/// Why there is no reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Missing {
    /// The quantity.
    pub quantity: Quantity,
    /// The question at which no group was left.
    pub reason: MissingReason,
    /// What there is instead: ages in dpf, or views per revolution.
    pub there_are: Vec<f64>,
    /// The reasons that the references themselves state.
    pub why: Vec<String>,
}

/// A group that may be compared with.
#[derive(Debug, Clone)]
pub(super) struct Match<'a> {
    pub group: &'a Group,
    pub mismatches: Vec<Mismatch>,
}

/// Best first: of the specimen's ASD, then with the fewest mismatches, then of the most larvae.
type Rank = (bool, usize, std::cmp::Reverse<u32>);

impl Match<'_> {
    pub fn rank(&self) -> Rank {
        (!asd_is_matched(&self.mismatches), self.mismatches.len(), std::cmp::Reverse(self.group.n))
    }
}

/// Whether reference and specimen have the same ASD, as far as it is known.
pub(super) fn asd_is_matched(mismatches: &[Mismatch]) -> bool {
    mismatches.iter().all(|m| m.key != "asd")
}

impl Specimen {
    /// The best group of the specimen's age and this estimator, with the numbers that `numbers` takes from it for this
    /// quantity.
    pub(super) fn find<'a, N>(
        &self,
        references: &'a [References],
        estimator: &str,
        quantity: Quantity,
        numbers: impl Fn(&Group) -> Option<N>,
    ) -> Result<(Match<'a>, N), Missing> {
        let gaps = references.iter().flat_map(|r| &r.gaps).filter(|g| g.quantity == quantity);
        let mut why: Vec<String> = Vec::new();
        for gap in gaps.filter(|g| g.dpf.is_none_or(|dpf| self.is_of(dpf))) {
            // Several files may lack the same.
            if !why.contains(&gap.why) {
                why.push(gap.why.clone());
            }
        }
        let missing = |reason, mut there_are: Vec<f64>| {
            there_are.sort_by(f64::total_cmp);
            there_are.dedup();
            Missing { quantity, reason, there_are, why }
        };
        let all: Vec<_> = references.iter().flat_map(|r| &r.groups).collect();
        let of_age: Vec<_> = all.iter().filter(|g| self.is_of(g.dpf)).collect();
        if of_age.is_empty() {
            return Err(missing(MissingReason::Age, all.iter().map(|g| g.dpf).collect()));
        }
        let of_estimator: Vec<_> = of_age.into_iter().filter(|g| g.estimator == estimator).collect();
        if of_estimator.is_empty() {
            return Err(missing(MissingReason::Estimator, Vec::new()));
        }
        let with_quantity: Vec<_> = of_estimator.into_iter().filter_map(|g| Some((*g, numbers(g)?))).collect();
        if with_quantity.is_empty() {
            return Err(missing(MissingReason::Quantity, Vec::new()));
        }
        let asds = with_quantity.iter().filter_map(|(g, _)| g.asd.map(f64::from)).collect();
        let fits = with_quantity.into_iter().filter_map(|(g, numbers)| Some((self.fit(g)?, numbers)));
        fits.min_by_key(|(fit, _)| fit.rank()).ok_or_else(|| missing(MissingReason::Asd, asds))
    }

    fn is_of(&self, dpf: f64) -> bool {
        // Decimal ages are not exact; a hundredth of a second is ignored.
        (self.dpf - dpf).abs() <= SAME_AGE_DAYS + 1e-7
    }

    /// The differences from a group, apart from age and quantities. `None` where the group has another ASD.
    #[allow(clippy::float_cmp, reason = "a method's settings are the same or they are not")]
    pub(super) fn fit<'a>(&self, group: &'a Group) -> Option<Match<'a>> {
        if group.asd.is_some_and(|asd| asd != self.asd) {
            return None;
        }
        let mut mismatches = Vec::new();
        let mut differs = |key: &str, specimen: Option<Known>, reference: Option<Known>| {
            mismatches.push(Mismatch { key: key.to_owned(), specimen, reference });
        };
        let asd = Known::Number(self.asd.into());
        if group.asd.is_none() {
            differs("asd", Some(asd.clone()), None);
        }
        if self.views != self.asd as usize {
            differs("views", Some(Known::Number(self.views as f64)), Some(asd));
        }
        for (key, specimen, reference) in [("voxel_um", self.voxel_um, group.voxel_um), ("epsilon", self.epsilon, group.epsilon)] {
            if reference != Some(specimen) {
                differs(key, Some(Known::Number(specimen)), reference.map(Known::Number));
            }
        }
        // A plate map has no cohort.
        let words =
            [("treatment", &self.treatment, &group.treatment), ("strain", &self.strain, &group.strain), ("cohort", &None, &group.cohort)];
        for (key, specimen, reference) in words {
            let Some(expected) = reference else { continue };
            let is_untreated = key == "treatment" && self.untreated && is_untreated(expected);
            if !is_untreated && !specimen.as_ref().is_some_and(|word| is_same(word, expected)) {
                differs(key, specimen.clone().map(Known::Word), Some(Known::Word(expected.clone())));
            }
        }
        if self.simulated != group.simulated {
            let mode = |simulated: bool| Some(Known::Word(if simulated { "simulated" } else { "hardware" }.into()));
            differs("mode", mode(self.simulated), mode(group.simulated));
        }
        Some(Match { group, mismatches })
    }
}
