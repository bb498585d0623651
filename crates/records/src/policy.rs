//! The policy of a method: time limits of phases, retries, and how an interrupted run continues.

use crate::Phase;
use carved_core::range::{OutOfRange, Range, Ranged, outside_in};
use carved_core::ranges;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// `[methods.NAME.policy]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// Longest time of each phase of a specimen, s. A phase that takes longer is ended and its motors are stopped.
    pub deadlines_s: Deadlines,
    /// How often a specimen that is still in the capillary is tried again before its well is given up. With 0 it is never tried again.
    pub retries: u32,
    /// What becomes of the specimen that was in progress when its run was interrupted.
    pub interrupted: Interrupted,
    /// Who continues a run after a crash of the daemon, or when a lost camera, folder or disk has come back. After a lost axis or a restart of the
    /// computer it is always the operator.
    pub resume: Resume,
    /// How often a run that is held because the camera sent no whole frame, or was changed, continues by itself without a finished well. After
    /// that, or with 0, a person continues it.
    pub held_tries: u32,
    /// Pause before the first of these tries, min. Each further pause is twice as long.
    pub held_pause_min: f64,
    /// What is done with a specimen that extends beyond the picture and cannot be moved into view.
    pub clipped: Clipped,
    /// What it means for a run that the daily bead check failed or has expired (see `quality.gate`).
    pub bead_gate: BeadGate,
}

/// One time for each phase, s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct Deadlines {
    /// From the request for a specimen until it is in the capillary.
    pub load: f64,
    /// Until it is known what is in the capillary.
    pub detect: f64,
    /// Until the specimen is in the middle of the picture.
    pub position: f64,
    /// All views of the revolution.
    pub revolve: f64,
    /// From the last view until there is a model.
    pub reconstruct: f64,
    /// From the model to its numbers and files.
    pub measure: f64,
    /// Until the specimen has left the capillary.
    pub eject: f64,
    /// Until the capillary is clean again.
    pub wash: f64,
}

/// What becomes of the specimen whose run was interrupted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Interrupted {
    /// It is measured from the beginning. What there is of it is kept.
    #[default]
    Redo,
    /// Its well is given up.
    Skip,
}

/// Who continues a run after a crash of the daemon, or when a lost camera, folder or disk has come back. After a lost axis or a restart of the
/// computer it is always the operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Resume {
    /// The run continues by itself, also after the pauses of `held_tries`. After any other fault the operator continues it.
    #[default]
    Automatic,
    /// The operator continues it.
    Operator,
}

/// What is done with a specimen that extends beyond the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Clipped {
    /// It is measured as far as it is seen, and flagged.
    #[default]
    Flag,
    /// Its well is skipped.
    Skip,
}

/// What a bead check that failed or has expired means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum BeadGate {
    /// The numbers are flagged.
    #[default]
    Flag,
    /// No run of specimens starts.
    Refuse,
    /// The bead check is ignored.
    Off,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            deadlines_s: Deadlines::default(),
            retries: 1,
            interrupted: Interrupted::default(),
            resume: Resume::default(),
            held_tries: 5,
            held_pause_min: 1.0,
            clipped: Clipped::default(),
            bead_gate: BeadGate::default(),
        }
    }
}

impl Default for Deadlines {
    fn default() -> Self {
        Self { load: 3600.0, detect: 60.0, position: 120.0, revolve: 900.0, reconstruct: 600.0, measure: 600.0, eject: 120.0, wash: 120.0 }
    }
}

/// A pause before a held run tries again does not grow beyond this.
const LONGEST_PAUSE_MIN: f64 = 60.0;

/// Range of a deadline, s: from a millisecond to a day.
const DEADLINES_S: [f64; 2] = [0.001, 86_400.0];

impl Ranged for Policy {
    const RANGES: &'static [Range<Self>] = ranges![
        // Each attempt harms the specimen.
        retries: 0.0, 5.0, "times";
        held_tries: 0.0, 10.0, "times";
        held_pause_min: 0.01, 60.0, "min";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        outside_in("deadlines_s", &self.deadlines_s).collect()
    }
}

impl Ranged for Deadlines {
    const RANGES: &'static [Range<Self>] = ranges![
        load: DEADLINES_S[0], DEADLINES_S[1], "s";
        detect: DEADLINES_S[0], DEADLINES_S[1], "s";
        position: DEADLINES_S[0], DEADLINES_S[1], "s";
        revolve: DEADLINES_S[0], DEADLINES_S[1], "s";
        reconstruct: DEADLINES_S[0], DEADLINES_S[1], "s";
        measure: DEADLINES_S[0], DEADLINES_S[1], "s";
        eject: DEADLINES_S[0], DEADLINES_S[1], "s";
        wash: DEADLINES_S[0], DEADLINES_S[1], "s";
    ];
}

impl Policy {
    /// Pause before a run that the camera holds continues by itself, after so many continuations. `None` if a person continues it.
    pub fn held_pause(&self, continued: u32) -> Option<Duration> {
        let is_allowed = self.resume == Resume::Automatic && continued < self.held_tries;
        is_allowed.then(|| Duration::from_secs_f64(60.0 * (self.held_pause_min * 2f64.powi(continued as i32)).min(LONGEST_PAUSE_MIN)))
    }
}

impl Deadlines {
    /// The deadline of a phase.
    pub fn of(&self, phase: Phase) -> Duration {
        Duration::from_secs_f64(match phase {
            Phase::Load => self.load,
            Phase::Detect => self.detect,
            Phase::Position => self.position,
            Phase::Revolve => self.revolve,
            Phase::Reconstruct => self.reconstruct,
            Phase::Measure => self.measure,
            Phase::Eject => self.eject,
            Phase::Wash => self.wash,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_policy_is_written_by_its_own_words_and_what_cannot_be_meant_is_named() {
        let policy: Policy =
            toml::from_str("retries = 9\ninterrupted = \"skip\"\nresume = \"operator\"\n[deadlines_s]\nwash = 0\n").unwrap();
        assert_eq!((policy.interrupted, policy.resume, policy.bead_gate), (Interrupted::Skip, Resume::Operator, BeadGate::Flag));
        let breaches: Vec<String> = policy.outside().iter().map(ToString::to_string).collect();
        assert!(breaches.len() == 2 && breaches[0].contains("retries = 9") && breaches[1].contains("deadlines_s.wash = 0"), "{breaches:?}");
        assert!(Policy::default().outside().is_empty());
        assert!(toml::from_str::<Policy>("[deadlines_s]\nhoming = 3").is_err());
    }
}
