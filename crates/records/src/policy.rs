//! What is done when a well does not go as it should: how long a phase may take, what is tried again, how a run goes on.

use crate::Phase;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// `[methods.NAME.policy]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// Longest time that each phase of a specimen may take, s.
    pub deadlines_s: Deadlines,
    /// How often a specimen that is still in the capillary is tried again before its well is given up.
    pub retries: u32,
    /// What becomes of the specimen that was under way when its run was interrupted.
    pub interrupted: Interrupted,
    /// Who lets a run go on whose lost device is back.
    pub resume: Resume,
    /// What a specimen that goes on beyond the picture means, where it cannot be carried into view.
    pub clipped: Clipped,
    /// What a rig whose beads are off, or too old, means for the numbers.
    pub bead_gate: BeadGate,
}

/// One time for each phase, s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Deadlines {
    pub load: f64,
    pub detect: f64,
    pub position: f64,
    pub revolve: f64,
    pub reconstruct: f64,
    pub measure: f64,
    pub eject: f64,
    pub wash: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Interrupted {
    /// It is taken from the beginning; what there is of it is kept beside.
    #[default]
    Redo,
    Skip,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resume {
    /// A run goes on by itself where a lost device has come back; after any other fault the operator says so.
    #[default]
    Automatic,
    Operator,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clipped {
    /// It is measured as far as it is seen, and flagged.
    #[default]
    Flag,
    Skip,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BeadGate {
    #[default]
    Flag,
    Refuse,
    Off,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            deadlines_s: Deadlines::default(),
            retries: 1,
            interrupted: Interrupted::default(),
            resume: Resume::default(),
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

/// Longest deadline that can be meant, s: a day.
const LONGEST_S: f64 = 86_400.0;
/// More than this is not trying again but hammering.
const RETRIES_MOST: u32 = 5;

impl Policy {
    /// Every value that cannot be meant, as `key = value; expected ...`.
    pub fn check(&self) -> Vec<String> {
        let mut breaches = Vec::new();
        if self.retries > RETRIES_MOST {
            breaches.push(format!("retries = {}; expected 0 to {RETRIES_MOST}", self.retries));
        }
        for (name, seconds) in self.deadlines_s.named() {
            if !(seconds > 0.0 && seconds <= LONGEST_S) {
                breaches.push(format!("deadlines_s.{name} = {seconds}; expected more than 0, up to {LONGEST_S} s"));
            }
        }
        breaches
    }
}

impl Deadlines {
    /// Longest time of a phase.
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

    fn named(&self) -> [(&'static str, f64); 8] {
        [
            ("load", self.load),
            ("detect", self.detect),
            ("position", self.position),
            ("revolve", self.revolve),
            ("reconstruct", self.reconstruct),
            ("measure", self.measure),
            ("eject", self.eject),
            ("wash", self.wash),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_those_that_the_shipped_file_names() {
        let text = include_str!("../../../config/simulated.toml");
        let (_, block) = text.split_once("# [methods.standard.policy]").unwrap();
        let keys: String = block.lines().skip(1).take_while(|l| !l.starts_with("# [")).map(|l| format!("{}\n", &l[2..])).collect();
        assert_eq!(toml::from_str::<Policy>(&keys).unwrap(), Policy::default(), "{keys}");
    }

    #[test]
    fn a_policy_is_written_by_its_own_words_and_what_cannot_be_meant_is_named() {
        let policy: Policy =
            toml::from_str("retries = 9\ninterrupted = \"skip\"\nresume = \"operator\"\n[deadlines_s]\nwash = 0\n").unwrap();
        assert_eq!((policy.interrupted, policy.resume, policy.bead_gate), (Interrupted::Skip, Resume::Operator, BeadGate::Flag));
        let breaches = policy.check();
        assert!(breaches.len() == 2 && breaches[0].contains("retries = 9") && breaches[1].contains("deadlines_s.wash = 0"), "{breaches:?}");
        assert!(Policy::default().check().is_empty());
        assert!(toml::from_str::<Policy>("[deadlines_s]\nhoming = 3").is_err());
    }
}
