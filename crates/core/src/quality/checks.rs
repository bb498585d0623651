//! One number against one limit, and all checks of a specimen.

use super::turning::TurnFinding;
use crate::flag::{Flag, StoredFlag};
use serde::{Deserialize, Serialize};

/// A number and its limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Check {
    /// Key of the limit in the method's `quality` table.
    pub name: String,
    /// Unit of `found`, `sd` and `limit`.
    pub unit: String,
    /// The number. `None` where the data do not determine it; it is serialized as `null`.
    pub found: Option<f64>,
    /// Standard deviation of `found`. `None` where the check does not use one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// The limit, from the method's `quality` table.
    pub limit: f64,
    /// The view that the number belongs to, where it is the worst of all views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<u32>,
    /// Whether the limit is exceeded, so that the flag is raised. Where there is an `sd`, the interval of two `sd` about
    /// `found` must lie wholly beyond the limit.
    pub over: bool,
    /// Whether that interval contains the limit: the measurement cannot tell whether the limit is exceeded. `flag` is not raised.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub undecided: bool,
    /// The flag that this check raises.
    pub flag: StoredFlag,
}

/// Half width of the interval, standard deviations: 95 % of readings lie within it.
const SURE: f64 = 2.0;

impl Check {
    fn new(name: &str, unit: &str, flag: Flag, found: Option<f64>, limit: f64, over: impl Fn(f64) -> bool) -> Self {
        // A value that is not a number measures nothing, so it is within no limit.
        let over = found.is_some_and(|x| !x.is_finite() || over(x));
        let found = found.filter(|x| x.is_finite());
        Self { name: name.to_owned(), unit: unit.to_owned(), found, sd: None, limit, view: None, over, undecided: false, flag: flag.into() }
    }

    /// An upper limit on the magnitude.
    pub(super) fn at_most(name: &str, unit: &str, flag: Flag, found: Option<f64>, limit: f64) -> Self {
        Self::new(name, unit, flag, found, limit, |x| x.abs() > limit)
    }

    /// An upper limit on the magnitude of a number with a standard deviation. Without one the same as [`Self::at_most`].
    pub(super) fn at_most_surely(name: &str, unit: &str, flag: Flag, found: Option<f64>, sd: Option<f64>, limit: f64) -> Self {
        let Some(sd) = sd.filter(|sd| sd.is_finite()) else { return Self::at_most(name, unit, flag, found, limit) };
        let check = Self::new(name, unit, flag, found, limit, |x| x.abs() - SURE * sd > limit);
        let undecided = !check.over && check.found.is_some_and(|x| x.abs() + SURE * sd > limit);
        Self { sd: Some(sd), undecided, ..check }
    }

    pub(super) fn at_least(name: &str, unit: &str, flag: Flag, found: Option<f64>, limit: f64) -> Self {
        Self::new(name, unit, flag, found, limit, |x| x < limit)
    }

    pub(super) fn of_view(self, view: Option<u32>) -> Self {
        Self { view, ..self }
    }
}

/// The checks of a specimen.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Quality {
    /// Whether no number exceeds its limit.
    pub passed: bool,
    /// Every check that was made, in a fixed order.
    pub checks: Vec<Check>,
}

/// The check of the comparison of the views. It has no limit in the method: a turn is one, or none.
const TURN_FINDINGS: &str = "turn_findings";
const REFERENCE_Z: &str = "reference_z";

impl Quality {
    pub(super) fn new(checks: Vec<Check>) -> Self {
        let passed = checks.iter().all(|c| !c.over);
        Self { passed, checks }
    }

    /// These checks and those of a larva's place among reference larvae, in standard deviations from their mean: volume and
    /// area. `None` for a quantity without a reference. Earlier checks against references are replaced.
    #[must_use]
    pub fn among_references(mut self, volume_z: Option<f64>, area_z: Option<f64>, limit: f64) -> Self {
        // Checks against the references that were used before.
        self.checks.retain(|c| c.name != REFERENCE_Z);
        let of = |flag, z| Check::at_most(REFERENCE_Z, "standard deviations", flag, z, limit);
        self.checks.extend([of(Flag::VolumeOffReferences, volume_z), of(Flag::AreaOffReferences, area_z)]);
        Self::new(self.checks)
    }

    /// These checks, and whether the views show one specimen that turns: a check for each finding, or one that is passed.
    #[must_use]
    pub(crate) fn with_turn(mut self, findings: &[TurnFinding]) -> Self {
        let of = |flag, found: f64| Check::at_most(TURN_FINDINGS, "findings", flag, Some(found), 0.0);
        if findings.is_empty() {
            self.checks.push(of(Flag::RotationSuspect, 0.0));
        }
        self.checks.extend(findings.iter().map(|finding| of(finding.flag(), 1.0)));
        Self::new(self.checks)
    }

    /// The check of the limit `name`, if it was made.
    pub fn check(&self, name: &str) -> Option<&Check> {
        self.checks.iter().find(|c| c.name == name)
    }

    /// Whether a check raises this flag.
    pub fn raises(&self, flag: Flag) -> bool {
        self.checks.iter().any(|c| c.over && c.flag == flag)
    }

    /// Whether some number is over its limit, but by less than two of its standard deviations.
    pub fn is_undecided(&self) -> bool {
        self.checks.iter().any(|c| c.undecided && c.found.is_some_and(|found| found.abs() > c.limit))
    }

    /// Each raised flag, once, in the order of the checks.
    pub fn flags(&self) -> Vec<StoredFlag> {
        let mut flags = Vec::new();
        for check in self.checks.iter().filter(|c| c.over) {
            if !flags.contains(&check.flag) {
                flags.push(check.flag.clone());
            }
        }
        flags
    }
}
