//! Statistics of one or several runs: groups of wells that were treated alike, compounds, the window between controls, and responses to a
//! dose.
//!
//! ```text
//!  StoredRun ── samples ── numbers of each measured well ──┬─ same condition ─────────── groups       n, mean, sd, interval, median, MAD
//!                                                          ├─ same compound ──────────── compounds    the same, over all concentrations
//!                                                          ├─ controls of one run ────── windows      Z'
//!                                                          └─ one compound, all doses ── responses    four-parameter logistic curve
//! ```
//! Each quantity has statistics of its own. Wells of several runs are pooled, except for Z', which belongs to a plate.

mod flat;
mod samples;

pub use flat::{groups as groups_table, responses as responses_table, windows as windows_table};

use carved_core::assay::{DoseResponse, Parameter, Summary, Window};
use carved_core::flag::{Effect, Flag};
use carved_records::{Control, PlannedWell, SpecimenKind};
use carved_store::StoredRun;
use samples::Sample;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use utoipa::ToSchema;

/// The signal of the second camera.
const SIGNAL: &str = "signal_grey_px_per_nl";

/// A number that has statistics: the name of its column in the table of specimens, its unit, and where it is in `measurement.json`.
pub const QUANTITIES: [(&str, &str, &str); 11] = [
    ("volume_um3", "um^3", "/measurement/volume_um3"),
    ("area_um2", "um^2", "/measurement/area_um2"),
    ("body_length_um", "um", "/shape/body/length_um"),
    ("sphericity", "1", "/shape/solid/sphericity"),
    ("bending_total_deg", "deg", "/shape/body/bending/total_deg"),
    ("max_curvature_per_mm", "1/mm", "/shape/body/bending/max_curvature_per_mm"),
    ("eye_volume_um3", "um^3", "/eyes/mean_volume_um3"),
    ("eye_distance_um", "um", "/eyes/distance_um"),
    ("bladder_volume_um3", "um^3", "/bladder/volume_um3"),
    (SIGNAL, "grey px/nl", "/fluorescence/signal_per_nl"),
    ("diameter_um", "um", "/measurement/diameter_um"),
];

/// Which specimens with flags count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Flagged {
    /// Those whose number holds: no bound, and nothing that makes it doubtful. The table of flags says which flags do
    /// (`docs/quality.md`).
    #[default]
    Sound,
    /// All.
    Included,
    /// None.
    Excluded,
}

/// Statistics of runs.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Statistics {
    pub runs: Vec<String>,
    /// `hardware`, `simulated` or `imported`, each once. Statistics of a simulation say nothing of larvae.
    pub modes: Vec<String>,
    /// Which specimens with flags count.
    pub flagged: Flagged,
    /// Measured specimens, whether they count or not.
    pub specimens: usize,
    /// Measured specimens with flags, whether they count or not.
    pub specimens_with_flags: usize,
    /// One entry per quantity that some specimen has.
    pub quantities: Vec<QuantityStatistics>,
}

/// Statistics of one quantity.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct QuantityStatistics {
    /// The column of the table of specimens.
    pub name: String,
    pub unit: String,
    /// Wells with this number that do not count, and why.
    pub left_out: Vec<LeftOutWell>,
    /// Wells that were treated alike.
    pub groups: Vec<WellGroup>,
    /// Wells of one compound at any concentration.
    pub compounds: Vec<WellGroup>,
    /// One entry per run that has controls.
    pub windows: Vec<ControlWindow>,
    /// One entry per compound at several concentrations.
    pub responses: Vec<DoseSeries>,
}

/// What was done to a well. `null` where the plate map does not say it, or where wells of any value are pooled.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct WellCondition {
    /// `larva` or `bead`.
    pub specimen: String,
    pub dpf: Option<f64>,
    pub strain: Option<String>,
    pub treatment: Option<String>,
    pub compound: Option<String>,
    pub concentration: Option<f64>,
    pub concentration_unit: Option<String>,
    /// `positive` or `negative`.
    pub control: Option<String>,
}

/// An interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Interval {
    pub low: f64,
    pub high: f64,
}

impl From<[f64; 2]> for Interval {
    fn from([low, high]: [f64; 2]) -> Self {
        Self { low, high }
    }
}

impl Interval {
    /// Both ends, changed in the same way.
    pub fn map(self, change: impl Fn(f64) -> f64) -> [f64; 2] {
        [change(self.low), change(self.high)]
    }

    /// Whether a number lies in it.
    pub fn contains(self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }
}

/// Reference larvae of the age of a group, as the first measured well of the group has them.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct GroupReference {
    /// What the larvae have in common: `fixed, 3 dpf`.
    pub group: String,
    /// Number of the reference larvae.
    pub n: u64,
    /// Interval that holds 95 % of further larvae of this kind.
    pub interval_95: Interval,
}

/// The number of one well.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct WellValue {
    pub run: String,
    pub well: String,
    pub value: f64,
    pub flagged: bool,
}

/// A well whose number does not count.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct LeftOutWell {
    pub run: String,
    pub well: String,
    pub value: f64,
    /// Whether the well did not succeed. Its number is what was computed before it was refused.
    pub failed: bool,
    /// The flags for which it does not count.
    pub flags: Vec<String>,
}

/// A sample of wells.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct WellGroup {
    pub condition: WellCondition,
    /// Wells that count.
    pub n: usize,
    /// Wells of this condition that do not count.
    pub left_out: usize,
    pub mean: f64,
    /// Divisor n - 1; `null` of a single well.
    pub sd: Option<f64>,
    /// 95 % confidence interval of the mean by Student's t; `null` of a single well.
    pub mean_interval_95: Option<Interval>,
    pub median: f64,
    /// Median distance from the median, not scaled.
    pub mad: f64,
    /// `null` of quantities and ages without reference larvae.
    pub reference: Option<GroupReference>,
    pub values: Vec<WellValue>,
}

/// The window between the controls of a run.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ControlWindow {
    pub run: String,
    pub positive: usize,
    pub negative: usize,
    /// 1 - 3 (sd + sd) / |difference of the means|; `null` with a reason.
    pub z_prime: Option<f64>,
    /// Why there is no Z'.
    pub reason: Option<String>,
}

/// The wells of one compound at several concentrations.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DoseSeries {
    /// Without concentration.
    pub condition: WellCondition,
    /// Unit of the doses.
    pub concentration_unit: String,
    pub points: Vec<DosePoint>,
    /// `null` with a reason.
    pub curve: Option<DoseCurve>,
    /// Why there is no curve.
    pub reason: Option<String>,
}

/// One well of a response.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DosePoint {
    pub run: String,
    pub well: String,
    /// 0 for a negative control.
    pub dose: f64,
    pub value: f64,
}

/// A fitted number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct FittedParameter {
    pub value: f64,
    pub sd: f64,
    pub interval_95: Interval,
}

/// `y = at_zero + (at_infinity - at_zero) / (1 + (ec50 / dose)^hill)`.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DoseCurve {
    pub at_zero: FittedParameter,
    pub at_infinity: FittedParameter,
    /// In the unit of the doses.
    pub ec50: f64,
    pub ec50_interval_95: Interval,
    pub log10_ec50: FittedParameter,
    pub hill: FittedParameter,
    /// Outside the doses it is an extrapolation.
    pub ec50_is_within_doses: bool,
    pub residual_sd: f64,
    /// F test of the curve against the mean.
    pub p_no_effect: f64,
    /// The curve at even steps of the dose's logarithm, from the smallest dose above 0 to the largest.
    pub line: Vec<CurvePoint>,
}

/// The mean response at a dose, by the curve.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct CurvePoint {
    pub dose: f64,
    pub value: f64,
    /// Of the mean response at this dose, not of the next well.
    pub interval_95: Interval,
}

impl From<Parameter> for FittedParameter {
    fn from(Parameter { value, sd, interval_95 }: Parameter) -> Self {
        Self { value, sd, interval_95: interval_95.into() }
    }
}

/// Steps of a curve's line.
const LINE_STEPS: u32 = 60;

impl DoseCurve {
    /// `points`: those of the fit, in rising order of the dose.
    fn new(fit: &DoseResponse, points: &[DosePoint]) -> Self {
        let ends = points.iter().find(|p| p.dose > 0.0).zip(points.last()).map(|(least, most)| [least.dose, most.dose]);
        let doses = ends.into_iter().flat_map(|[least, most]| {
            (0..=LINE_STEPS).map(move |step| least * (most / least).powf(f64::from(step) / f64::from(LINE_STEPS)))
        });
        let at = |dose| fit.at(dose).map(|at| CurvePoint { dose, value: at.value, interval_95: at.interval_95.into() });
        Self {
            at_zero: fit.at_zero.into(),
            at_infinity: fit.at_infinity.into(),
            ec50: fit.ec50,
            ec50_interval_95: fit.ec50_interval_95.into(),
            log10_ec50: fit.log10_ec50.into(),
            hill: fit.hill.into(),
            ec50_is_within_doses: fit.ec50_is_within_doses,
            residual_sd: fit.residual_sd,
            p_no_effect: fit.p_no_effect,
            line: doses.filter_map(at).collect(),
        }
    }
}

impl WellCondition {
    pub(crate) fn of(planned: &PlannedWell) -> Self {
        let control = planned.control.map(|control| match control {
            Control::Positive => "positive".to_owned(),
            Control::Negative => "negative".to_owned(),
        });
        let specimen = match planned.specimen {
            SpecimenKind::Larva => "larva",
            SpecimenKind::Bead => "bead",
        };
        Self {
            specimen: specimen.to_owned(),
            dpf: planned.dpf,
            strain: planned.strain.clone(),
            treatment: planned.treatment.clone(),
            compound: planned.compound.clone(),
            concentration: planned.concentration,
            concentration_unit: planned.concentration_unit.map(|unit| unit.symbol().to_owned()),
            control,
        }
    }

    fn without_concentration(self) -> Self {
        Self { concentration: None, concentration_unit: None, ..self }
    }

    /// A few words for a person: `rapamycin 10 uM, 4 dpf`, `negative control: DMSO 0.1 %, 4 dpf`, `larva, 4 dpf, ABxTL`. Two conditions that
    /// differ have different words.
    pub fn words(&self) -> String {
        self.parts().into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    /// The parts of [`Self::words`]: treatment by a compound (always there), age, strain, other treatment.
    pub(crate) fn parts(&self) -> [Option<String>; 4] {
        let control = self.control.as_ref().map(|control| format!("{control} control"));
        let dose = self.concentration.map(|c| format!(" {c} {}", self.concentration_unit.as_deref().unwrap_or_default()));
        let compound = self.compound.as_ref().map(|compound| format!("{compound}{}", dose.unwrap_or_default().trim_end()));
        let treated = match (control, compound) {
            (Some(control), Some(compound)) => format!("{control}: {compound}"),
            (Some(only), None) | (None, Some(only)) => only,
            (None, None) => self.specimen.clone(),
        };
        [Some(treated), self.dpf.map(|dpf| format!("{dpf} dpf")), self.strain.clone(), self.treatment.clone()]
    }
}

impl QuantityStatistics {
    /// How many wells do not count, and why: `3 of 12 wells are left out: 1 by a person, 2 because their numbers are doubtful (moved)`.
    /// Each well counts once: what a person said comes first, then a well that did not succeed, a bound, and a doubtful number. `None` if all
    /// count.
    pub fn left_out_words(&self) -> Option<String> {
        let n = self.left_out.len();
        let all = n + self.groups.iter().map(|group| group.n).sum::<usize>();
        let mut by_reason: BTreeMap<Reason, (usize, BTreeSet<&str>)> = BTreeMap::new();
        for well in &self.left_out {
            let failed = well.failed.then_some(Reason::Failed);
            let reason = well.flags.iter().map(|flag| Reason::of(flag)).chain(failed).min().unwrap_or(Reason::Flag);
            let (wells, flags) = by_reason.entry(reason).or_default();
            *wells += 1;
            flags.extend(well.flags.iter().map(String::as_str).filter(|flag| Reason::of(flag) == reason));
        }
        let why: Vec<String> = by_reason.iter().map(|(reason, (wells, flags))| reason.words(*wells, flags)).collect();
        (n > 0).then(|| format!("{n} of {all} wells {} left out: {}", if n == 1 { "is" } else { "are" }, why.join(", ")))
    }
}

/// Why a well does not count. The first that holds is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Reason {
    Person,
    Failed,
    Bound,
    Doubtful,
    /// A flag of a number that holds. Statistics leave it out on request.
    Flag,
}

impl Reason {
    fn of(flag: &str) -> Self {
        match Flag::ALL.iter().find(|known| known.code() == flag).map(|known| known.effect()) {
            Some(Effect::Excluded) => Self::Person,
            Some(Effect::LowerBound) => Self::Bound,
            Some(Effect::Doubtful) => Self::Doubtful,
            Some(Effect::Holds) | None => Self::Flag,
        }
    }

    fn words(self, wells: usize, flags: &BTreeSet<&str>) -> String {
        let why = match (self, wells) {
            (Self::Person, _) => return format!("{wells} by a person"),
            (Self::Failed, 1) => return "1 because it did not succeed".to_owned(),
            (Self::Failed, _) => return format!("{wells} because they did not succeed"),
            (Self::Bound, 1) => "its number is a bound",
            (Self::Bound, _) => "their numbers are bounds",
            (Self::Doubtful, 1) => "its number is doubtful",
            (Self::Doubtful, _) => "their numbers are doubtful",
            (Self::Flag, 1) => "it has a flag",
            (Self::Flag, _) => "they have flags",
        };
        format!("{wells} because {why} ({})", flags.iter().copied().collect::<Vec<_>>().join(", "))
    }
}

impl Statistics {
    /// The statistics of runs. A well with a file that cannot be read, or was altered, does not count.
    pub fn of(runs: &[StoredRun], flagged: Flagged) -> Self {
        let names: Vec<String> = runs.iter().map(|run| run.record().id.clone()).collect();
        let mut modes: Vec<String> = Vec::new();
        for run in runs {
            let mode = super::mode(run.record().mode).to_owned();
            if !modes.contains(&mode) {
                modes.push(mode);
            }
        }
        Self::of_samples(&samples::of(runs), names, modes, flagged)
    }

    /// Whether any specimen counts.
    pub fn counts_any(&self) -> bool {
        self.quantities.iter().any(|quantity| !quantity.groups.is_empty())
    }

    fn of_samples(all: &[Sample], runs: Vec<String>, modes: Vec<String>, flagged: Flagged) -> Self {
        let specimens_with_flags = all.iter().filter(|s| !s.flags.is_empty()).count();
        let quantities = (0..QUANTITIES.len()).filter_map(|q| quantity(q, all, flagged, &runs)).collect();
        Self { runs, modes, flagged, specimens: all.len(), specimens_with_flags, quantities }
    }
}

/// A sample and its number.
type Valued<'s> = (&'s Sample, f64);

/// The statistics of one quantity. `None` where no specimen has it.
fn quantity(q: usize, samples: &[Sample], flagged: Flagged, runs: &[String]) -> Option<QuantityStatistics> {
    let (name, unit, _) = QUANTITIES[q];
    let all = samples.iter().filter_map(|s| Some((s, s.numbers[q]?)));
    let (valued, out): (Vec<Valued>, Vec<Valued>) = all.partition(|(s, _)| s.counts(q, flagged));
    if valued.is_empty() && out.is_empty() {
        return None;
    }
    let of_compound = |s: &Sample| s.condition.compound.is_some().then(|| s.condition.clone().without_concentration());
    let left_out = |&(sample, value): &Valued| LeftOutWell {
        run: sample.run.clone(),
        well: sample.well.clone(),
        value,
        failed: sample.is_refused,
        flags: sample.left_out(q, flagged).iter().map(ToString::to_string).collect(),
    };
    Some(QuantityStatistics {
        name: name.to_owned(),
        unit: unit.to_owned(),
        left_out: out.iter().map(left_out).collect(),
        groups: groups(q, &valued, &out, |s| Some(s.condition.clone())),
        compounds: groups(q, &valued, &out, of_compound),
        windows: runs.iter().filter_map(|run| window(run, &valued)).collect(),
        responses: responses(&valued),
    })
}

/// Samples of one condition each: negative controls, then by compound and concentration, then positive controls. Equal ones are in the order
/// of the plates.
fn groups(q: usize, valued: &[Valued], out: &[Valued], condition: impl Fn(&Sample) -> Option<WellCondition>) -> Vec<WellGroup> {
    let mut parts: Vec<(WellCondition, Vec<Valued>)> = Vec::new();
    for &(sample, value) in valued {
        let Some(condition) = condition(sample) else { continue };
        match parts.iter_mut().find(|(known, _)| *known == condition) {
            Some((_, members)) => members.push((sample, value)),
            None => parts.push((condition, vec![(sample, value)])),
        }
    }
    let dose = |c: &WellCondition| c.concentration.unwrap_or(-1.0);
    let control = |c: &WellCondition| c.control.as_ref().map_or(1, |control| if control == "negative" { 0 } else { 2 });
    parts.sort_by(|(a, _), (b, _)| (control(a), &a.compound).cmp(&(control(b), &b.compound)).then(dose(a).total_cmp(&dose(b))));
    let left_out = |known: &WellCondition| out.iter().filter(|(s, _)| condition(s).as_ref() == Some(known)).count();
    parts
        .into_iter()
        .filter_map(|(condition, members)| {
            let left_out = left_out(&condition);
            group(q, condition, &members, left_out)
        })
        .collect()
}

fn group(q: usize, condition: WellCondition, members: &[Valued], left_out: usize) -> Option<WellGroup> {
    let Summary { n, mean, sd, mean_interval_95, median, mad } = Summary::of(&members.iter().map(|m| m.1).collect::<Vec<_>>())?;
    let well = |&(sample, value): &Valued| WellValue {
        run: sample.run.clone(),
        well: sample.well.clone(),
        value,
        flagged: !sample.flags.is_empty(),
    };
    Some(WellGroup {
        condition,
        n,
        left_out,
        mean,
        sd,
        mean_interval_95: mean_interval_95.map(Into::into),
        median,
        mad,
        reference: members.iter().find_map(|(sample, _)| sample.references[q].clone()),
        values: members.iter().map(well).collect(),
    })
}

/// The window of a run. `None` where its plate map marks no control.
fn window(run: &str, valued: &[Valued]) -> Option<ControlWindow> {
    let of = |control: &str| -> Vec<&Valued> {
        valued.iter().filter(|(s, _)| s.run == run && s.condition.control.as_deref() == Some(control)).collect()
    };
    let (positive, negative) = (of("positive"), of("negative"));
    if positive.is_empty() && negative.is_empty() {
        return None;
    }
    let values = |controls: &[&Valued]| controls.iter().map(|(_, value)| *value).collect::<Vec<_>>();
    let found = match unlike_controls(&positive, &negative) {
        Some(why) => Err(why),
        None => Window::of(&values(&positive), &values(&negative)).map_err(|why| why.to_string()),
    };
    Some(ControlWindow {
        run: run.to_owned(),
        positive: positive.len(),
        negative: negative.len(),
        z_prime: found.as_ref().ok().map(|window| window.z_prime),
        reason: found.err(),
    })
}

/// Why the controls of a run have no common Z': they were not treated alike, so their spread is more than scatter.
fn unlike_controls(positive: &[&Valued], negative: &[&Valued]) -> Option<String> {
    for (kind, controls) in [("positive", positive), ("negative", negative)] {
        let [first, others @ ..] = controls else { continue };
        if let Some(other) = others.iter().find(|other| other.0.condition != first.0.condition) {
            let [first, other] = [first, other].map(|well| format!("{} ({})", well.0.well, well.0.condition.words()));
            return Some(format!("the {kind} controls are not treated alike: {first} and {other}"));
        }
    }
    let (positive, negative) = (positive.first()?.0, negative.first()?.0);
    let larvae = |s: &Sample| (s.condition.specimen.clone(), s.condition.dpf, s.condition.strain.clone());
    let of = |s: &Sample| format!("{} ({})", s.well, s.condition.words());
    (larvae(positive) != larvae(negative)).then(|| format!("the controls are other larvae: {} and {}", of(positive), of(negative)))
}

/// Compounds at two or more concentrations, controls left out, each with the negative controls of its specimen, age, strain and other
/// treatment at dose 0.
fn responses(valued: &[Valued]) -> Vec<DoseSeries> {
    let mut found: Vec<(WellCondition, String, Vec<DosePoint>)> = Vec::new();
    let point = |sample: &Sample, dose, value| DosePoint { run: sample.run.clone(), well: sample.well.clone(), dose, value };
    for &(sample, value) in valued.iter().filter(|(s, _)| s.condition.control.is_none() && s.condition.compound.is_some()) {
        let Some((dose, unit)) = sample.condition.concentration.zip(sample.condition.concentration_unit.clone()) else { continue };
        let condition = sample.condition.clone().without_concentration();
        match found.iter_mut().find(|(known, of, _)| *known == condition && *of == unit) {
            Some((.., points)) => points.push(point(sample, dose, value)),
            None => found.push((condition, unit, vec![point(sample, dose, value)])),
        }
    }
    found.retain(|(.., points)| points.iter().any(|p| p.dose.total_cmp(&points[0].dose).is_ne()));
    found.sort_by(|a, b| a.0.compound.cmp(&b.0.compound));
    let untreated = |condition: &WellCondition, s: &Sample| {
        let with = |c: &WellCondition| (c.specimen.clone(), c.dpf, c.strain.clone(), c.treatment.clone());
        s.condition.control.as_deref() == Some("negative") && with(&s.condition) == with(condition)
    };
    let response = |(condition, concentration_unit, mut points): (WellCondition, String, Vec<DosePoint>)| {
        points.extend(valued.iter().filter(|(s, _)| untreated(&condition, s)).map(|&(s, value)| point(s, 0.0, value)));
        points.sort_by(|a, b| a.dose.total_cmp(&b.dose));
        let fit = DoseResponse::fit(&points.iter().map(|p| [p.dose, p.value]).collect::<Vec<_>>());
        let reason = fit.as_ref().err().map(ToString::to_string);
        let curve = fit.ok().map(|fit| DoseCurve::new(&fit, &points));
        DoseSeries { condition, concentration_unit, points, curve, reason }
    };
    found.into_iter().map(response).collect()
}

#[cfg(test)]
mod tests;
