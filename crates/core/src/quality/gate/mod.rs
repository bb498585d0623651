//! The daily gate: whether a few beads say that the instrument is today what it was.
//!
//! ```text
//!  3 to 5 beads ─┬─ aspect, roundness, residual, repeat, t score ── against the limits of the method ─┐
//!                └─ the run's means ── against this instrument's own earlier gates: Shewhart, CUSUM ──┴─ verdict, words
//! ```
//! Beads of a batch tell the scale to 25 um over the root of their number: a score within its limit is no proof, and says what bias
//! it would have found.

mod chart;
mod judge;
mod numbers;
mod words;

pub use chart::Chart;
pub use judge::{BeadGate, GateVerdict};
pub use numbers::{BeadMeasured, GateNumbers};

use crate::range::{OutOfRange, outside};
use serde::{Deserialize, Serialize};

/// `[methods.X.quality.gate]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GateSettings {
    /// From this age on a gate is no gate any more.
    pub max_age_h: f64,
    /// Fewer different beads are no gate.
    pub beads_least: usize,
    /// What the beads' mean diameter should be.
    pub nominal_um: f64,
    /// Of the t score's two-sided probability, %: below, the mean diameter is off.
    pub t_percent: f64,
    /// Most that the mean length over width may be off 1: it is that of ky over kx.
    pub aspect_off: f64,
    /// Most that a bead's surface may lie off its sphere, root of the mean square.
    pub roundness_um: f64,
    /// Most that the edges of a bead's median view may lie from what the others make expected.
    pub residual_px: f64,
    /// Most that one bead's diameters may differ by.
    pub repeat_um: f64,
    /// Of fewer earlier gates there is no chart.
    pub history_least: usize,
    /// Shewhart's limit, standard deviations.
    pub shewhart_sd: f64,
    /// Of the cumulative sums: what a gate may be off without being summed, and their limit, standard deviations.
    pub cusum_slack_sd: f64,
    pub cusum_limit_sd: f64,
}

impl Default for GateSettings {
    /// Where each is from stands in docs/quality.md.
    fn default() -> Self {
        Self {
            max_age_h: 24.0,
            beads_least: 3,
            nominal_um: 500.0,
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

impl GateSettings {
    /// Every limit that is out of its range.
    pub fn check(&self) -> Vec<OutOfRange> {
        outside([
            ("max_age_h", self.max_age_h, 0.1..=8760.0, "h"),
            ("beads_least", self.beads_least as f64, 3.0..=100.0, "beads"),
            ("nominal_um", self.nominal_um, 1.0..=5000.0, "um"),
            ("t_percent", self.t_percent, 0.01..=20.0, "%"),
            ("aspect_off", self.aspect_off, 0.0001..=0.5, "(ratio)"),
            ("roundness_um", self.roundness_um, 0.01..=100.0, "um"),
            ("residual_px", self.residual_px, 0.01..=100.0, "px"),
            ("repeat_um", self.repeat_um, 0.01..=100.0, "um"),
            ("history_least", self.history_least as f64, 3.0..=1000.0, "gates"),
            ("shewhart_sd", self.shewhart_sd, 1.0..=10.0, "standard deviations"),
            ("cusum_slack_sd", self.cusum_slack_sd, 0.0..=5.0, "standard deviations"),
            ("cusum_limit_sd", self.cusum_limit_sd, 1.0..=50.0, "standard deviations"),
        ])
    }
}
