//! A quantity over the gates of one instrument: Shewhart's chart for a jump, cumulative sums for a drift.
//!
//! ```text
//!  x_1 .. x_n earlier, x today       T = sqrt(i / (i + 1)) (x_{i+1} - mean_i) / sd_i      Student's t, i - 1 degrees of freedom
//!  U = the normal deviate as rare as T ── |U| over the limit: today is out
//!  C+ = max(0, C+ + U - slack), C- likewise ── over the limit: it has drifted
//! ```
//! The charts are self-starting (Hawkins 1987): mean and standard deviation come from the instrument's own earlier gates,
//! however few. The deviates are standard normal for any number of gates, so that the limits have the same error rate from the
//! first chart on.

use super::GateSettings;
use super::numbers::GateNumbers;
use crate::statistics::Spread;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// The chart of one quantity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    /// Name of the quantity.
    pub name: String,
    /// Unit of the quantity.
    pub unit: String,
    /// Today's value.
    pub found: f64,
    /// Mean and standard deviation of the earlier gates.
    pub history: Spread,
    /// Lower and upper limit; a value outside of them is a jump.
    pub limits: [f64; 2],
    /// Today's value as a standard normal deviate.
    pub deviate: f64,
    /// Cumulative sums upwards and downwards, including today's, standard deviations.
    pub cusum: [f64; 2],
    /// Whether today's value is outside of `limits`.
    pub jumped: bool,
    /// Whether a cumulative sum exceeds its limit.
    pub drifted: bool,
}

type Of = fn(&GateNumbers) -> Option<f64>;

/// The quantities, each with the smallest day-to-day standard deviation that is accepted: repeats that agree to the last digit
/// say nothing about tomorrow's.
const QUANTITIES: [(&str, &str, f64, Of); 6] = [
    ("diameter_um", "um", 0.5, |n| Some(n.diameter_um.mean)),
    ("aspect_ratio", "(ratio)", 0.0005, |n| Some(n.aspect_ratio.mean)),
    ("sphere_rms_um", "um", 0.1, |n| Some(n.sphere_rms_um.mean)),
    ("residual_px", "px", 0.02, |n| n.residual_px.map(|s| s.mean)),
    ("uy_px", "px", 0.05, |n| n.uy_px.map(|s| s.mean)),
    ("gamma_deg", "deg", 0.005, |n| n.gamma_deg.map(|s| s.mean)),
];

/// Charts of all quantities with enough of a history, which is sorted with the oldest gate first.
pub(super) fn charts(history: &[GateNumbers], today: &GateNumbers, settings: &GateSettings) -> Vec<Chart> {
    let of = |&(name, unit, sd_least, of): &(&str, &str, f64, Of)| {
        let earlier: Vec<f64> = history.iter().filter_map(of).collect();
        (earlier.len() >= settings.history_least).then(|| chart(&earlier, of(today)?, sd_least, settings))?.map(|chart| Chart {
            name: name.to_owned(),
            unit: unit.to_owned(),
            ..chart
        })
    };
    QUANTITIES.iter().filter_map(of).collect()
}

/// The state of the chart after one gate.
#[derive(Debug, Clone, Copy)]
struct Step {
    deviate: f64,
    cusum: [f64; 2],
}

impl Step {
    fn jumped(&self, settings: &GateSettings) -> bool {
        self.deviate.abs() > settings.shewhart_sd
    }

    fn drifted(&self, settings: &GateSettings) -> bool {
        self.cusum.iter().any(|c| *c > settings.cusum_limit_sd)
    }
}

/// One step per gate from the third on: two gates give no standard deviation.
fn steps(all: &[f64], sd_least: f64, slack_sd: f64) -> Option<Vec<Step>> {
    let mut cusum = [0.0_f64; 2];
    let step = |at: usize| {
        let deviate = deviate_of(&all[..at], all[at], sd_least)?;
        cusum = [(cusum[0] + deviate - slack_sd).max(0.0), (cusum[1] - deviate - slack_sd).max(0.0)];
        Some(Step { deviate, cusum })
    };
    (2..all.len()).map(step).collect()
}

fn chart(earlier: &[f64], found: f64, sd_least: f64, settings: &GateSettings) -> Option<Chart> {
    let all: Vec<f64> = earlier.iter().copied().chain([found]).collect();
    let today = *steps(&all, sd_least, settings.cusum_slack_sd)?.last()?;
    let history = Spread::of(earlier)?;
    let n = earlier.len() as f64;
    let student = StudentsT::new(0.0, 1.0, n - 1.0).ok()?;
    let most = student.inverse_cdf(Normal::standard().cdf(settings.shewhart_sd));
    let half = most * history.sd?.max(sd_least) * (1.0 + 1.0 / n).sqrt();
    Some(Chart {
        name: String::new(),
        unit: String::new(),
        found,
        history,
        limits: [history.mean - half, history.mean + half],
        deviate: today.deviate,
        cusum: today.cusum,
        jumped: today.jumped(settings),
        drifted: today.drifted(settings),
    })
}

/// The standard normal deviate with the same tail probability as this value has among the earlier ones.
fn deviate_of(earlier: &[f64], value: f64, sd_least: f64) -> Option<f64> {
    let spread = Spread::of(earlier)?;
    let n = earlier.len() as f64;
    let t = (value - spread.mean) / (spread.sd?.max(sd_least) * (1.0 + 1.0 / n).sqrt());
    let student = StudentsT::new(0.0, 1.0, n - 1.0).ok()?;
    // Computed in the nearer tail, where probabilities keep their digits. Beyond 8 deviates values can no longer be
    // distinguished.
    let tail = student.cdf(-t.abs()).max(1e-15);
    Some(-Normal::standard().inverse_cdf(tail) * t.signum())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal deviates of a seed, by the sum of twelve evens.
    fn deviates(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        move || {
            (0..12)
                .map(|_| {
                    state ^= state << 13;
                    state ^= state >> 7;
                    state ^= state << 17;
                    (state >> 11) as f64 / (1_u64 << 53) as f64
                })
                .sum::<f64>()
                - 6.0
        }
    }

    // python3 -c "from scipy.stats import t, norm; import math, statistics as s
    // x = [498.2, 500.1, 499.4, 501.0, 499.9]; T = (503.0 - s.mean(x)) / (s.stdev(x) * math.sqrt(1.2)); print(norm.ppf(t.cdf(T, 4)))"
    #[test]
    fn a_deviate_is_as_rare_as_students_t_says() {
        let x = [498.2, 500.1, 499.4, 501.0, 499.9];
        let spread = Spread::of(&x).unwrap();
        let t = (503.0 - spread.mean) / (spread.sd.unwrap() * 1.2_f64.sqrt());
        let wanted = Normal::standard().inverse_cdf(StudentsT::new(0.0, 1.0, 4.0).unwrap().cdf(t));
        let found = deviate_of(&x, 503.0, 0.01).unwrap();
        assert!((found - wanted).abs() < 1e-9 && (1.5..2.5).contains(&found), "{found} {wanted}");
        assert!((deviate_of(&x, 2.0 * spread.mean - 503.0, 0.01).unwrap() + found).abs() < 1e-9, "either way");
        assert!(deviate_of(&[500.0; 5], 500.1, 0.5).unwrap().abs() < 1.0, "repeats that agree to the last digit are not believed");
    }

    /// At the limits is what the chart says is a jump.
    #[test]
    fn the_limits_are_where_a_jump_begins() {
        let earlier = [1.0, 1.4, 0.7, 1.1, 0.9, 1.3];
        let settings = GateSettings::default();
        let [low, high] = chart(&earlier, 1.0, 0.01, &settings).unwrap().limits;
        for (value, jumped) in [(low + 1e-6, false), (low - 1e-6, true), (high - 1e-6, false), (high + 1e-6, true)] {
            assert_eq!(chart(&earlier, value, 0.01, &settings).unwrap().jumped, jumped, "{value} of {low} to {high}");
        }
    }

    /// How many gates pass until the chart says out: `shift` standard deviations from the 13th gate on; of 100 at most.
    fn until_out(seed: u64, shift: f64, settings: &GateSettings) -> usize {
        const BEFORE: usize = 12;
        let mut next = deviates(seed);
        let all: Vec<f64> = (0..BEFORE + 100).map(|i| next() + if i < BEFORE { 0.0 } else { shift }).collect();
        let after = steps(&all, 0.01, settings.cusum_slack_sd).unwrap().split_off(BEFORE - 2);
        after.iter().position(|s| s.jumped(settings) || s.drifted(settings)).map_or(100, |at| at + 1)
    }

    #[test]
    fn a_drift_is_found_in_days_and_nothing_seldom() {
        let settings = GateSettings::default();
        let alone = GateSettings { cusum_limit_sd: 1e9, ..settings };
        let found = |shift: f64, settings: &GateSettings| {
            let mut gates: Vec<usize> = (1..=60).map(|seed| until_out(seed, shift, settings)).collect();
            gates.sort_unstable();
            gates
        };
        let false_alarms = found(0.0, &settings).iter().filter(|n| **n < 100).count();
        assert!(false_alarms <= 12, "{false_alarms} of 60 instruments that are well are said to be out within 100 gates");
        let (jump, drift) = (found(4.0, &settings)[30], found(1.5, &settings)[30]);
        assert!(jump <= 3 && drift <= 15, "half of jumps of 4 SD after {jump} gates, of shifts of 1.5 SD after {drift}");
        // Shewhart's chart alone is slower.
        let shewhart = found(1.5, &alone)[30];
        assert!(shewhart > 2 * drift, "{shewhart} {drift}");
    }
}
