//! Reference groups from single controls: n, mean, SD and covariance of larvae that were measured alike.

use super::estimate::EYES;
use super::group::{Group, Moments};
use statrs::statistics::Statistics;
use std::collections::{BTreeMap, BTreeSet};

/// Least larvae of a group. Two larvae have a spread, but t with one degree of freedom says nothing (its 95 % interval is 15.6
/// SD to either side; with three larvae 5.0).
pub const FEWEST: usize = 3;

/// One control larva by one estimator. `None` means not known.
#[derive(Debug, Clone, PartialEq)]
pub struct Control {
    /// Age, days post fertilisation.
    pub dpf: f64,
    /// Treatment.
    pub treatment: Option<String>,
    /// Strain.
    pub strain: Option<String>,
    /// Batch or clutch.
    pub cohort: Option<String>,
    /// Views per revolution.
    pub asd: Option<u32>,
    /// Edge of a voxel, um.
    pub voxel_um: Option<f64>,
    /// Share of the views that may miss a voxel.
    pub epsilon: Option<f64>,
    /// Name of the estimator.
    pub estimator: String,
    /// Whether it was measured on an emulated rig.
    pub simulated: bool,
    /// Volume, um^3.
    pub volume_um3: Option<f64>,
    /// Area, um^2.
    pub area_um2: Option<f64>,
    /// Mean volume of both eyes, um^3. The estimator is then `eyes`.
    pub eye_volume_um3: Option<f64>,
    /// Distance between the centres of the eyes, um. The estimator is then `eyes`.
    pub eye_distance_um: Option<f64>,
}

/// Why controls do not make a group.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// Too few larvae.
    #[error("{group}: {n} larva(e); a place among fewer than {FEWEST} says nothing: measure more controls or leave these out")]
    TooFew {
        /// Name of the group.
        group: String,
        /// Larvae.
        n: usize,
    },
    /// Only some larvae have the number.
    #[error("{group}: {with} of {n} larvae have {key}; give it for all of them or for none")]
    Uneven {
        /// Name of the group.
        group: String,
        /// Name of the number.
        key: &'static str,
        /// Larvae that have it.
        with: usize,
        /// Larvae.
        n: usize,
    },
    /// All larvae have the same number.
    #[error("{group}: {key} is the same number {n} times: is one larva given more than once?")]
    NoSpread {
        /// Name of the group.
        group: String,
        /// Name of the number.
        key: &'static str,
        /// Larvae.
        n: usize,
    },
}

/// The groups that a set of controls gives.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Summaries {
    /// Youngest first.
    pub groups: Vec<Group>,
    /// Sets that make no group.
    pub refusals: Vec<Unfit>,
    /// Ways of measuring that are mixed in the set; their groups are kept apart.
    pub warnings: Vec<String>,
}

/// Groups controls by age, treatment, strain, cohort and way of measuring. `source` is stored with each group.
pub fn summarise(controls: &[Control], source: &str) -> Summaries {
    let mut by_name: BTreeMap<String, Vec<&Control>> = BTreeMap::new();
    for control in controls {
        by_name.entry(control.group_name()).or_default().push(control);
    }
    let mut summaries = Summaries { warnings: mixtures(controls), ..Summaries::default() };
    for (name, members) in by_name {
        match group(name, &members, source) {
            Ok(group) => summaries.groups.push(group),
            Err(unfit) => summaries.refusals.push(unfit),
        }
    }
    summaries.groups.sort_by(|a, b| a.dpf.total_cmp(&b.dpf));
    summaries
}

impl Control {
    /// Age and what was done, which every way of measuring the same larvae shares.
    fn larvae_name(&self) -> String {
        let words = [&self.treatment, &self.strain, &self.cohort];
        let words = words.iter().filter_map(|w| w.as_deref()).collect::<Vec<_>>().join(" ");
        format!("{words}{}{} dpf", if words.is_empty() { "" } else { ", " }, self.dpf)
    }

    /// Names everything that keeps groups apart.
    fn group_name(&self) -> String {
        let mut name = self.larvae_name();
        if let Some(asd) = self.asd {
            name += &format!(", ASD {asd}");
        }
        if let Some(size) = self.voxel_um {
            name += &format!(", SD {size} um");
        }
        if let Some(epsilon) = self.epsilon {
            name += &format!(", epsilon {epsilon}");
        }
        name += &format!(", {}", self.estimator);
        if self.simulated { name + ", simulated" } else { name }
    }
}

fn group(name: String, members: &[&Control], source: &str) -> Result<Group, Unfit> {
    let n = members.len();
    if n < FEWEST {
        return Err(Unfit::TooFew { group: name, n });
    }
    let values = |key, of: fn(&Control) -> Option<f64>| {
        let values: Vec<f64> = members.iter().filter_map(|c| of(c)).collect();
        match values.len() {
            0 => Ok(None),
            with if with < n => Err(Unfit::Uneven { group: name.clone(), key, with, n }),
            _ if values.iter().all(|v| v.total_cmp(&values[0]).is_eq()) => Err(Unfit::NoSpread { group: name.clone(), key, n }),
            _ => Ok(Some(values)),
        }
    };
    let volumes = values("volume_um3", |c| c.volume_um3)?;
    let areas = values("area_um2", |c| c.area_um2)?;
    let eye_volumes = values("eye_volume_um3", |c| c.eye_volume_um3)?;
    let eye_distances = values("eye_distance_um", |c| c.eye_distance_um)?;
    let moments = |values: &Option<Vec<f64>>| values.as_ref().map(|v| Moments { mean: v.mean(), sd: v.std_dev() });
    let first = members[0];
    Ok(Group {
        dpf: first.dpf,
        treatment: first.treatment.clone(),
        strain: first.strain.clone(),
        cohort: first.cohort.clone(),
        n: n as u32,
        asd: first.asd,
        voxel_um: first.voxel_um,
        epsilon: first.epsilon,
        estimator: first.estimator.clone(),
        simulated: first.simulated,
        volume_um3: moments(&volumes),
        area_um2: moments(&areas),
        eye_volume_um3: moments(&eye_volumes),
        eye_distance_um: moments(&eye_distances),
        covariance_um5: volumes.zip(areas).map(|(v, a)| v.covariance(a)),
        source: source.to_owned(),
        name,
    })
}

/// One line for each thing in which larvae of one age and treatment were measured differently.
fn mixtures(controls: &[Control]) -> Vec<String> {
    let mut larvae: BTreeMap<String, Vec<&Control>> = BTreeMap::new();
    for control in controls {
        larvae.entry(control.larvae_name()).or_default().push(control);
    }
    let number = |x: Option<f64>| x.map_or_else(|| "not given".to_owned(), |x| x.to_string());
    let mut warnings = Vec::new();
    for (name, members) in larvae {
        let mut mixed = |what: &str, values: BTreeSet<String>| {
            if values.len() > 1 {
                let list = values.into_iter().collect::<Vec<_>>().join(", ");
                warnings.push(format!("{name}: {what} is mixed ({list}); these are kept apart"));
            }
        };
        mixed("ASD", members.iter().map(|c| number(c.asd.map(f64::from))).collect());
        mixed("SD (voxel_um)", members.iter().map(|c| number(c.voxel_um)).collect());
        mixed("epsilon", members.iter().map(|c| number(c.epsilon)).collect());
        mixed("mode", members.iter().map(|c| if c.simulated { "simulated" } else { "hardware" }.to_owned()).collect());
        // Every recording has all estimators' numbers; larvae that have only some of them are of another origin.
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        // Larvae of which an eye was not found have no control of the eyes.
        for control in members.iter().filter(|control| control.estimator != EYES) {
            *counts.entry(control.estimator.as_str()).or_default() += 1;
        }
        let uneven = counts.values().collect::<BTreeSet<_>>().len() > 1;
        mixed("estimator", counts.keys().filter(|_| uneven).map(|e| (*e).to_owned()).collect());
    }
    warnings
}
