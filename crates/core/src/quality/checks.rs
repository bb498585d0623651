//! One number against one limit, and all of a specimen's.

use serde::{Deserialize, Serialize};

/// A number beside its limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// The limit's key in the method's `quality`.
    pub name: String,
    pub unit: String,
    /// `null` where nothing tells it.
    pub found: Option<f64>,
    /// Standard deviation of `found`. `None` where the check does not use one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    pub limit: f64,
    /// The view that it is of, where it is the worst of the views'.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<u32>,
    /// Beyond the limit: the flag is raised. Where there is an `sd`, the interval of two `sd` about `found` is wholly beyond it.
    pub over: bool,
    /// That interval holds the limit: the measurement cannot tell whether the limit is exceeded. `flag` is not raised.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub undecided: bool,
    pub flag: String,
}

/// Standard deviations to either side of a number that has one: 95 % of readings lie within them.
const SURE: f64 = 2.0;

impl Check {
    fn new(name: &str, unit: &str, flag: &str, found: Option<f64>, limit: f64, over: impl Fn(f64) -> bool) -> Self {
        // What is no number is no measure of anything: it is within no limit.
        let over = found.is_some_and(|x| !x.is_finite() || over(x));
        let found = found.filter(|x| x.is_finite());
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            found,
            sd: None,
            limit,
            view: None,
            over,
            undecided: false,
            flag: flag.to_owned(),
        }
    }

    /// At most, whatever the sign.
    pub(super) fn at_most(name: &str, unit: &str, flag: &str, found: Option<f64>, limit: f64) -> Self {
        Self::new(name, unit, flag, found, limit, |x| x.abs() > limit)
    }

    /// At most, whatever the sign, of a number with a standard deviation. Without one as [`Self::at_most`].
    pub(super) fn at_most_surely(name: &str, unit: &str, flag: &str, found: Option<f64>, sd: Option<f64>, limit: f64) -> Self {
        let Some(sd) = sd.filter(|sd| sd.is_finite()) else { return Self::at_most(name, unit, flag, found, limit) };
        let check = Self::new(name, unit, flag, found, limit, |x| x.abs() - SURE * sd > limit);
        let undecided = !check.over && check.found.is_some_and(|x| x.abs() + SURE * sd > limit);
        Self { sd: Some(sd), undecided, ..check }
    }

    pub(super) fn at_least(name: &str, unit: &str, flag: &str, found: Option<f64>, limit: f64) -> Self {
        Self::new(name, unit, flag, found, limit, |x| x < limit)
    }

    pub(super) fn of_view(self, view: Option<u32>) -> Self {
        Self { view, ..self }
    }
}

/// A specimen's checks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Nothing is over its limit.
    pub passed: bool,
    pub checks: Vec<Check>,
}

const REFERENCE_Z: &str = "reference_z";
/// Flags of a volume and of an area that are far from those of reference larvae.
pub const OFF_REFERENCES: [&str; 2] = ["volume_off_references", "area_off_references"];

impl Quality {
    pub(super) fn new(checks: Vec<Check>) -> Self {
        let passed = checks.iter().all(|c| !c.over);
        Self { passed, checks }
    }

    /// The same with a larva's place among reference larvae, in standard deviations from their mean: volume and area.
    #[must_use]
    pub fn among_references(mut self, volume_z: Option<f64>, area_z: Option<f64>, limit: f64) -> Self {
        // Of other references, where it was held against some before.
        self.checks.retain(|c| c.name != REFERENCE_Z);
        let of = |flag: &str, z| Check::at_most(REFERENCE_Z, "standard deviations", flag, z, limit);
        self.checks.extend([of(OFF_REFERENCES[0], volume_z), of(OFF_REFERENCES[1], area_z)]);
        Self::new(self.checks)
    }

    pub fn check(&self, name: &str) -> Option<&Check> {
        self.checks.iter().find(|c| c.name == name)
    }

    pub fn raises(&self, flag: &str) -> bool {
        self.checks.iter().any(|c| c.over && c.flag == flag)
    }

    /// Whether the measurement cannot tell of some number whether it is over its limit.
    pub fn is_undecided(&self) -> bool {
        self.checks.iter().any(|c| c.undecided)
    }

    /// Each flag that is raised, once.
    pub fn flags(&self) -> Vec<&str> {
        let mut flags: Vec<&str> = Vec::new();
        for check in self.checks.iter().filter(|c| c.over) {
            if !flags.contains(&check.flag.as_str()) {
                flags.push(&check.flag);
            }
        }
        flags
    }
}
