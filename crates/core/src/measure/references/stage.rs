//! The age that a larva looks like: the probability of each age for which there are references of one kind, with equal priors.
//!
//! ```text
//!  P(age | x) = f_age(x) / sum of f over the ages      f: density of the next value, Student's t of that age's n larvae
//! ```

use super::estimate::Estimate;
use super::group::{Group, Quantity, References};
use super::joint::JointPredictive;
use super::matching::{Match, Mismatch, Missing, MissingReason, Specimen};
use super::predictive::Predictive;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;

/// The probability of each age.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Stage {
    /// Quantity that the probabilities rest on.
    pub by: Quantity,
    /// One per age, youngest first; they sum to 1.
    pub ages: Vec<StageShare>,
    /// Differences between the specimen and the references.
    pub mismatches: Vec<Mismatch>,
}

/// The probability of one age.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct StageShare {
    /// Age, days post fertilisation.
    pub dpf: f64,
    /// Name of the group.
    pub group: String,
    /// Larvae of the group.
    pub n: u32,
    /// Probability, 0 to 1.
    pub probability: f64,
}

/// Groups that differ in nothing but their age, each with its density's logarithm at the specimen.
type Series<'a> = Vec<(Match<'a>, f64)>;

impl Specimen {
    /// By volume and area together where the references have both, else by one of them: the one whose references match better,
    /// then the one with more ages, then the area, which depends less on the place of the edge.
    pub(super) fn stage(&self, references: &[References], estimate: &Estimate) -> Result<Stage, Missing> {
        let quantities = [Quantity::Joint, Quantity::Area, Quantity::Volume];
        let series = quantities.iter().filter_map(|by| Some((*by, self.series(references, estimate, *by)?)));
        let (by, series) = series.min_by_key(|(_, s)| rank(s)).ok_or_else(|| Missing {
            quantity: Quantity::Area,
            reason: MissingReason::Age,
            there_are: Vec::new(),
            why: vec!["no two ages have references of one kind at this ASD".into()],
        })?;
        let highest = series.iter().map(|(_, ln)| *ln).fold(f64::NEG_INFINITY, f64::max);
        let share = |ln: f64| (ln - highest).exp();
        let sum: f64 = series.iter().map(|(_, ln)| share(*ln)).sum();
        let ages = series.iter().map(|(fit, ln)| StageShare {
            dpf: fit.group.dpf,
            group: fit.group.name.clone(),
            n: fit.group.n,
            probability: share(*ln) / sum,
        });
        Ok(Stage { by, ages: ages.collect(), mismatches: series[0].0.mismatches.clone() })
    }

    /// The best series of at least two ages, youngest first.
    fn series<'a>(&self, references: &'a [References], estimate: &Estimate, by: Quantity) -> Option<Series<'a>> {
        let mut found: Vec<Series<'a>> = Vec::new();
        for file in references {
            let first = found.len();
            for group in file.groups.iter().filter(|g| g.estimator == estimate.estimator) {
                let Some(member) = self.fit(group).zip(ln_density(group, by, estimate)) else { continue };
                match found[first..].iter_mut().find(|s| of_one_kind(s[0].0.group, group)) {
                    Some(series) => series.push(member),
                    None => found.push(vec![member]),
                }
            }
        }
        for series in &mut found {
            series.sort_by(|(a, _), (b, _)| a.group.dpf.total_cmp(&b.group.dpf));
            series.dedup_by(|(later, _), (first, _)| later.group.dpf.total_cmp(&first.group.dpf).is_eq());
        }
        found.into_iter().filter(|s| s.len() > 1).min_by_key(rank)
    }
}

/// Best first: of the specimen's ASD, then with the fewest mismatches, then of the most ages.
fn rank(series: &Series) -> (bool, usize, Reverse<usize>) {
    let (other_asd, mismatches, _) = series[0].0.rank();
    (other_asd, mismatches, Reverse(series.len()))
}

fn ln_density(group: &Group, by: Quantity, estimate: &Estimate) -> Option<f64> {
    let of = |moments, value| Some(Predictive::new(moments?, group.n)?.ln_density(value));
    match by {
        Quantity::Volume => of(group.volume_um3, estimate.volume_um3),
        Quantity::Area => of(group.area_um2, estimate.area_um2),
        Quantity::Joint => Some(JointPredictive::of(group)?.ln_density(estimate.volume_um3, estimate.area_um2)),
        // The age is judged by the whole larva.
        Quantity::EyeVolume | Quantity::EyeDistance => None,
    }
}

/// Whether two groups differ in age at most, apart from their numbers.
#[allow(clippy::float_cmp, reason = "a method's settings are the same or they are not")]
fn of_one_kind(a: &Group, b: &Group) -> bool {
    let words = |g: &Group| (g.treatment.clone(), g.strain.clone(), g.cohort.clone(), g.estimator.clone(), g.simulated);
    words(a) == words(b) && (a.asd, a.voxel_um, a.epsilon) == (b.asd, b.voxel_um, b.epsilon)
}
