//! The daily gate: whether a few beads show that the instrument has not changed.
//!
//! ```text
//!  3 to 5 beads ─┬─ aspect, roundness, residual, repeat, t score ── against the limits of the method ─┐
//!                └─ the run's means ── against this instrument's own earlier gates: Shewhart, CUSUM ──┴─ verdict, words
//! ```
//! The scale from beads of a batch is known to 25 um divided by the root of their number. A score within its limit is no proof;
//! the gate also reports the bias that it would have detected.

mod chart;
mod judge;
mod numbers;
mod words;

pub use chart::Chart;
pub use judge::{BeadGate, GateVerdict};
pub use numbers::{BeadMeasured, GateNumbers};

use crate::measure::references::limb::BeadMaterial;
use crate::range::{Range, Ranged};
use crate::ranges;
use serde::{Deserialize, Serialize};

/// `[methods.X.quality.gate]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct GateSettings {
    /// Age at which a gate expires, h.
    pub max_age_h: f64,
    /// Fewest different beads of a valid gate.
    pub beads_least: usize,
    /// Nominal mean diameter of the beads, um.
    pub nominal_um: f64,
    /// What the beads are made of: `polystyrene`, `pmma`, `glass`, `opaque` or `unknown`. Clear beads look smaller than they are.
    pub bead_material: BeadMaterial,
    /// Smallest two-sided probability of the t score, %. Below it the mean diameter differs from the nominal one.
    pub t_percent: f64,
    /// Largest deviation of the mean ratio of length to width from 1. That ratio is the ratio of ky to kx.
    pub aspect_off: f64,
    /// Largest root of the mean square distance between a bead's surface and its sphere, um.
    pub roundness_um: f64,
    /// Largest distance between the edges of a bead's median view and those that its other views make expected, px.
    pub residual_px: f64,
    /// Largest difference between two diameters of one bead, um.
    pub repeat_um: f64,
    /// Fewest earlier gates of a chart.
    pub history_least: usize,
    /// Shewhart's limit, standard deviations.
    pub shewhart_sd: f64,
    /// Slack of the cumulative sums: the deviation of one gate that is not accumulated, standard deviations.
    pub cusum_slack_sd: f64,
    /// Limit of the cumulative sums, standard deviations.
    pub cusum_limit_sd: f64,
}

impl GateSettings {
    /// Mean diameter that these beads show, um.
    pub fn expected_um(&self) -> f64 {
        self.bead_material.apparent_um(self.nominal_um)[0]
    }

    /// Differences from it that are no reason to doubt the rig, um, downwards and upwards: what one bead may differ from itself, and what is
    /// not known of how beads of this material look. No bead looks larger than it is.
    pub fn tolerated_um(&self) -> [f64; 2] {
        let looks_um = 2.0 * self.bead_material.apparent_um(self.nominal_um)[1];
        let above_um = if self.bead_material == BeadMaterial::Unknown { 0.0 } else { looks_um };
        [self.repeat_um + looks_um, self.repeat_um + above_um]
    }

    /// Whether a mean diameter, um, is no reason to doubt the rig.
    pub fn tolerates(&self, mean_um: f64) -> bool {
        let [below_um, above_um] = self.tolerated_um();
        (-below_um..=above_um).contains(&(mean_um - self.expected_um()))
    }
}

impl Default for GateSettings {
    /// docs/quality.md gives the source of each value.
    fn default() -> Self {
        Self {
            max_age_h: 24.0,
            beads_least: 3,
            nominal_um: 500.0,
            bead_material: BeadMaterial::Unknown,
            t_percent: 1.0,
            aspect_off: 0.01,
            roundness_um: 3.0,
            residual_px: 1.0,
            repeat_um: 2.0,
            history_least: 5,
            shewhart_sd: 3.5,
            cusum_slack_sd: 0.5,
            cusum_limit_sd: 6.0,
        }
    }
}

impl Ranged for GateSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        max_age_h: 0.1, 8760.0, "h";
        beads_least: 3.0, 100.0, "beads";
        nominal_um: 1.0, 5000.0, "um";
        t_percent: 0.01, 20.0, "%";
        aspect_off: 0.0001, 0.5, "(ratio)";
        roundness_um: 0.01, 100.0, "um";
        residual_px: 0.01, 100.0, "px";
        repeat_um: 0.01, 100.0, "um";
        history_least: 3.0, 1000.0, "gates";
        shewhart_sd: 1.0, 10.0, "standard deviations";
        cusum_slack_sd: 0.0, 5.0, "standard deviations";
        cusum_limit_sd: 1.0, 50.0, "standard deviations";
    ];
}
