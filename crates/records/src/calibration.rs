//! The rig's calibration and daily bead gate, as a run and the status show them.

use serde::{Deserialize, Serialize};

/// How far a clock may be ahead of the one that dated a measurement, s. A clock that is synchronised again may step back by so much.
const AHEAD_S: f64 = 300.0;

/// Whether a measurement of this age is of the future: the clock was set back, and nobody knows how old it is.
pub fn is_of_the_future(age_s: f64) -> bool {
    age_s < -AHEAD_S
}

/// Whether a measurement of this age still counts. One of the future does not.
pub fn is_fresh(age_s: f64, max_age_s: f64) -> bool {
    age_s < max_age_s && !is_of_the_future(age_s)
}

/// The newest calibration of this rig, from beads or from a scale. It is looked up at the start of the daemon and of each run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct CalibrationStatus {
    pub id: String,
    /// `beads` or `scale`. `gate` if the rig has no calibration and only a bead gate.
    pub kind: String,
    /// Time of its last recording, RFC 3339, UTC.
    pub measured: String,
    pub age_s: f64,
    /// Age at which it expires, s.
    pub max_age_s: f64,
    /// Deviation of the beads' mean diameter from the nominal one, percent. `null` for a scale.
    pub bead_bias_percent: Option<f64>,
    pub valid: bool,
    /// The rig's newest bead gate. `null` if there is none.
    #[serde(default)]
    pub gate: Option<GateStatus>,
}

impl CalibrationStatus {
    /// The age at the time `now`, s. `None` if `measured` is not a time.
    pub fn age_s(&self, now: jiff::Timestamp) -> Option<f64> {
        age_s(&self.measured, now)
    }

    /// Marks the calibration and the gate as expired if they are too old at the time `now`. Returns whether one of them has just expired.
    pub fn grows_too_old(&mut self, now: jiff::Timestamp) -> bool {
        let passes = |good: &mut bool, measured: &str, max_age_s: f64| {
            *good && {
                *good = age_s(measured, now).is_some_and(|age_s| is_fresh(age_s, max_age_s));
                !*good
            }
        };
        let size = passes(&mut self.valid, &self.measured, self.max_age_s);
        let gate = self.gate.as_mut().is_some_and(|gate| passes(&mut gate.stands, &gate.measured, gate.max_age_s));
        size || gate
    }
}

/// Seconds from `measured` (RFC 3339) to `now`. `None` if `measured` is not a time.
fn age_s(measured: &str, now: jiff::Timestamp) -> Option<f64> {
    Some(now.duration_since(measured.parse().ok()?).as_secs_f64())
}

impl GateStatus {
    /// Whether it was measured after the time `now`: the clock was set back.
    pub fn is_of_the_future(&self, now: jiff::Timestamp) -> bool {
        age_s(&self.measured, now).is_some_and(is_of_the_future)
    }
}

/// The newest bead gate of this rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct GateStatus {
    pub id: String,
    /// `passed`, `no_history` (passed, with too few earlier gates to detect a change), `failed` or `too_few_beads`.
    pub verdict: String,
    /// Time of the recording of its last bead, RFC 3339, UTC.
    pub measured: String,
    /// Age at which it expires, s.
    pub max_age_s: f64,
    /// Whether it passed and has not expired.
    pub stands: bool,
    /// Summary for the operator, with the next action. Empty in records of earlier versions.
    #[serde(default)]
    pub summary: String,
    /// All results, with what to do.
    pub words: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A clock that was set back makes yesterday's beads as young as one likes.
    #[test]
    fn what_was_measured_in_the_future_does_not_count() {
        let now: jiff::Timestamp = "2026-11-20T09:00:00Z".parse().unwrap();
        for (measured, counts) in [
            ("2026-11-20T09:04:00Z", true),
            ("2026-11-20T08:00:00Z", true),
            ("2026-11-19T08:59:00Z", false),
            ("2026-11-20T10:00:00Z", false),
            ("2027-01-01T00:00:00Z", false),
            ("yesterday", false),
        ] {
            let gate = GateStatus {
                id: "g".into(),
                verdict: "passed".into(),
                measured: measured.into(),
                max_age_s: 86400.0,
                stands: true,
                summary: String::new(),
                words: Vec::new(),
            };
            let mut calibration = CalibrationStatus {
                id: "c".into(),
                kind: "scale".into(),
                measured: measured.into(),
                age_s: 0.0,
                max_age_s: 86400.0,
                bead_bias_percent: None,
                valid: true,
                gate: Some(gate),
            };
            assert_eq!(calibration.grows_too_old(now), !counts, "{measured}");
            assert_eq!((calibration.valid, calibration.gate.unwrap().stands), (counts, counts), "{measured}");
        }
    }
}
