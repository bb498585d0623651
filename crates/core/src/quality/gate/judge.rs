//! The verdict on a set of beads.

use super::GateSettings;
use super::chart::{Chart, charts};
use super::numbers::{BeadMeasured, GateNumbers};
use super::words::words;
use crate::flag::Flag;
use crate::measure::references::bead::BeadScore;
use crate::quality::Check;
use serde::{Deserialize, Serialize};

/// The verdict of a gate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GateVerdict {
    /// Within every limit and on every chart.
    Passed,
    /// Within every limit, but with too few earlier gates to say whether the instrument has changed.
    NoHistory,
    /// Too few different beads to decide.
    TooFewBeads,
    /// A limit or a chart is exceeded.
    Failed,
}

impl GateVerdict {
    /// Whether specimens may be measured.
    pub fn passes(self) -> bool {
        matches!(self, Self::Passed | Self::NoHistory)
    }
}

/// A gate: every number, the verdict, and what the operator is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BeadGate {
    /// The verdict.
    pub verdict: GateVerdict,
    /// What was found and what to do, one sentence each.
    pub words: Vec<String>,
    /// The numbers of the beads together.
    pub numbers: GateNumbers,
    /// The paper's t score and the bias that this number of beads would show. `None` with fewer than two beads.
    pub score: Option<BeadScore>,
    /// The checks against the limits.
    pub checks: Vec<Check>,
    /// Number of earlier gates that today's is compared with.
    pub history: usize,
    /// The charts of all quantities. Empty with too short a history.
    pub charts: Vec<Chart>,
}

impl BeadGate {
    /// The gate of these turns. `history` contains the gates of this instrument that passed, the oldest first. `None` without
    /// beads.
    pub fn of(turns: &[BeadMeasured], history: &[GateNumbers], settings: &GateSettings) -> Option<Self> {
        let numbers = GateNumbers::of(turns)?;
        let score = BeadScore::at(&numbers.diameters_um, settings.expected_um(), settings.t_percent / 100.0);
        // Beads that differ from each other less than one bead differs between its turns would make a bias significant that is
        // within the repeatability of the rig, or within what is known of how beads of this material look.
        let beyond_repeat = score.as_ref().filter(|_| !settings.tolerates(numbers.diameter_um.mean));
        let most = |name: &str, unit: &str, found, limit| Check::at_most(name, unit, Flag::BeadGate, found, limit);
        let checks = vec![
            Check::at_least("beads_least", "beads", Flag::BeadGate, Some(numbers.beads as f64), settings.beads_least as f64),
            Check::at_least("t_percent", "%", Flag::BeadGate, beyond_repeat.map(|s| 100.0 * s.p), settings.t_percent),
            most("aspect_off", "(ratio)", Some(numbers.aspect_ratio.mean - 1.0), settings.aspect_off),
            most("roundness_um", "um", Some(numbers.worst_sphere_rms_um), settings.roundness_um),
            most("residual_px", "px", numbers.worst_residual_px, settings.residual_px),
            most("repeat_um", "um", numbers.repeat_um, settings.repeat_um),
        ];
        let charts = charts(history, &numbers, settings);
        let out = checks.iter().any(|c| c.over) || charts.iter().any(|c| c.jumped || c.drifted);
        let verdict = match out {
            _ if numbers.beads < settings.beads_least => GateVerdict::TooFewBeads,
            true => GateVerdict::Failed,
            false if history.len() < settings.history_least => GateVerdict::NoHistory,
            false => GateVerdict::Passed,
        };
        let mut gate = Self { verdict, words: Vec::new(), numbers, score, checks, history: history.len(), charts };
        gate.words = words(&gate, settings);
        Some(gate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::references::limb::BeadMaterial;

    /// Beads as an instrument that is well measures them, a little off from day to day.
    fn beads(n: usize, day: usize) -> Vec<BeadMeasured> {
        let wave = |at: usize| (1.7 * at as f64 + 0.6 * day as f64).sin();
        (0..n)
            .map(|i| BeadMeasured {
                bead: format!("A{:02}", i + 1),
                diameter_um: 499.5 + 3.0 * wave(i),
                aspect_ratio: 1.001 + 0.0004 * wave(i + 3),
                sphere_rms_um: 0.8 + 0.1 * wave(i + 5),
                residual_px: Some(0.15 + 0.02 * wave(i + 1)),
                uy_px: Some(511.5 + 0.08 * wave(2 * i)),
                gamma_deg: Some(0.25 + 0.01 * wave(i + 2)),
            })
            .collect()
    }

    fn history(days: usize) -> Vec<GateNumbers> {
        (0..days).map(|day| GateNumbers::of(&beads(3, day)).unwrap()).collect()
    }

    fn gate(turns: &[BeadMeasured], days: usize) -> BeadGate {
        BeadGate::of(turns, &history(days), &GateSettings::default()).unwrap()
    }

    #[test]
    fn a_certain_bias_within_the_repeats_own_limit_is_none() {
        use GateVerdict::{Failed, NoHistory};
        let alike = |mean_um: f64, bead_material: BeadMaterial| {
            let settings = GateSettings { bead_material, ..GateSettings::default() };
            let turns: Vec<BeadMeasured> =
                beads(7, 20).into_iter().zip(0..7).map(|(b, i)| BeadMeasured { diameter_um: mean_um + 0.01 * f64::from(i), ..b }).collect();
            let gate = BeadGate::of(&turns, &[], &settings).unwrap();
            assert!(gate.score.as_ref().unwrap().p < 1e-6, "{:?}", gate.score);
            assert_eq!(gate.verdict.passes(), gate.words.iter().any(|w| w.contains("This is certain")), "{:?}", gate.words);
            gate.verdict
        };
        let opaque = [498.9, 501.9, 497.0, 503.0].map(|um| alike(um, BeadMaterial::Opaque));
        assert_eq!(opaque, [NoHistory, NoHistory, Failed, Failed]);
        // Clear beads look smaller than they are: by 2.2 +- 0.7 um, or by an unknown part of this.
        let polystyrene = [494.0, 495.0, 501.0, 502.0].map(|um| alike(um, BeadMaterial::Polystyrene));
        assert_eq!(polystyrene, [Failed, NoHistory, NoHistory, Failed]);
        let unknown = [495.0, 496.0, 501.9, 503.0].map(|um| alike(um, BeadMaterial::Unknown));
        assert_eq!(unknown, [Failed, NoHistory, NoHistory, Failed]);
    }

    #[test]
    fn the_verdict_is_one_of_four() {
        assert_eq!(gate(&beads(3, 20), 8).verdict, GateVerdict::Passed);
        assert_eq!(gate(&beads(3, 20), 4).verdict, GateVerdict::NoHistory);
        assert_eq!(gate(&beads(2, 20), 8).verdict, GateVerdict::TooFewBeads);
        assert_eq!(BeadGate::of(&[], &history(8), &GateSettings::default()), None);
        let passed = gate(&beads(3, 20), 8);
        assert_eq!((passed.charts.len(), passed.history), (6, 8));
        let power = passed.words.iter().find(|w| w.contains("can miss a bias")).unwrap();
        assert!(power.contains("3 beads") && power.contains(" um"), "{power}");
    }

    #[test]
    fn each_thing_that_is_wrong_fails_it_and_is_reported() {
        let changed = |change: fn(&mut BeadMeasured)| {
            let mut turns = beads(4, 20);
            turns.iter_mut().for_each(change);
            gate(&turns, 0)
        };
        let over = |gate: &BeadGate| gate.checks.iter().filter(|c| c.over).map(|c| c.name.clone()).collect::<Vec<_>>();
        for (found, name, word) in [
            (changed(|b| b.aspect_ratio = 1.011), "aspect_off", "ky"),
            (changed(|b| b.sphere_rms_um = 3.2), "roundness_um", "clean"),
            (changed(|b| b.residual_px = Some(1.2)), "residual_px", "focus"),
            (changed(|b| b.diameter_um += 60.0), "t_percent", "scale"),
        ] {
            assert_eq!((found.verdict, over(&found)), (GateVerdict::Failed, vec![name.to_owned()]));
            assert!(found.words.iter().any(|w| w.contains(word)), "{name}: {:?}", found.words);
        }
        let mut twice = beads(3, 20);
        twice.push(BeadMeasured { diameter_um: twice[0].diameter_um + 2.5, ..twice[0].clone() });
        let found = gate(&twice, 0);
        assert_eq!((over(&found), found.numbers.beads, found.numbers.turns), (vec!["repeat_um".to_owned()], 3, 4));
        assert!((found.numbers.repeat_um.unwrap() - 2.5).abs() < 1e-9);
        // Two turns of one bead are one bead.
        twice.remove(1);
        assert_eq!(gate(&twice, 0).verdict, GateVerdict::TooFewBeads);
    }

    #[test]
    fn an_axis_that_jumped_within_all_limits_is_seen_in_the_history() {
        let mut turns = beads(3, 20);
        for bead in &mut turns {
            bead.uy_px = Some(514.0);
        }
        assert_eq!(gate(&turns, 0).verdict, GateVerdict::NoHistory);
        let found = gate(&turns, 8);
        let out: Vec<&str> = found.charts.iter().filter(|c| c.jumped || c.drifted).map(|c| c.name.as_str()).collect();
        assert_eq!((found.verdict, out), (GateVerdict::Failed, vec!["uy_px"]));
        assert!(found.words.iter().any(|w| w.contains("uy_px")), "{:?}", found.words);
    }

    #[test]
    fn a_gate_survives_being_written_down() {
        let found = gate(&beads(3, 20), 8);
        let text = serde_json::to_string(&found).unwrap();
        assert_eq!(serde_json::from_str::<BeadGate>(&text).unwrap(), found);
    }
}
