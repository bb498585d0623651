//! What a run and the status say of the rig's calibration and of its daily beads.

use serde::{Deserialize, Serialize};

/// The newest calibration of this rig, by beads or by scale; looked up when the daemon and when a run starts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationStatus {
    pub id: String,
    /// `beads` or `scale`; `gate` where neither is kept, and only daily beads are.
    pub kind: String,
    /// When its last recording was made, RFC 3339, UTC.
    pub measured: String,
    pub age_s: f64,
    /// From this age on it is not valid.
    pub max_age_s: f64,
    /// Of the beads' mean diameter against what it should be; `null` of a scale.
    pub bead_bias_percent: Option<f64>,
    pub valid: bool,
    /// The rig's newest daily beads; `null` where none were kept.
    #[serde(default)]
    pub gate: Option<GateStatus>,
}

impl CalibrationStatus {
    /// Its age at a moment.
    pub fn age_s(&self, now: jiff::Timestamp) -> Option<f64> {
        age_s(&self.measured, now)
    }

    /// Notes what is too old from this moment on; whether anything is that was not before.
    pub fn grows_too_old(&mut self, now: jiff::Timestamp) -> bool {
        let passes = |good: &mut bool, measured: &str, max_age_s: f64| {
            *good && {
                *good = age_s(measured, now).is_some_and(|age_s| age_s < max_age_s);
                !*good
            }
        };
        let size = passes(&mut self.valid, &self.measured, self.max_age_s);
        let gate = self.gate.as_mut().is_some_and(|gate| passes(&mut gate.stands, &gate.measured, gate.max_age_s));
        size || gate
    }
}

/// Seconds from `measured` (RFC 3339) to `now`.
fn age_s(measured: &str, now: jiff::Timestamp) -> Option<f64> {
    Some(now.duration_since(measured.parse().ok()?).as_secs_f64())
}

/// The newest gate of this rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GateStatus {
    pub id: String,
    /// `passed`, `no_history` (passed, with too few earlier gates to tell a change), `failed` or `too_few_beads`.
    pub verdict: String,
    /// When its last bead was recorded, RFC 3339, UTC.
    pub measured: String,
    /// From this age on it does not stand.
    pub max_age_s: f64,
    /// It passed, and is not too old yet.
    pub stands: bool,
    /// What a technician does about it, in short; empty where an earlier build looked it up.
    #[serde(default)]
    pub summary: String,
    /// What was found, in every number, and what to do.
    pub words: Vec<String>,
}
