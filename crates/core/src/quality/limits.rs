//! The limits of a method, `[methods.X.quality]`.

use super::gate::GateSettings;
use crate::range::{OutOfRange, outside};
use serde::{Deserialize, Serialize};

/// What is over one of these is flagged, never dropped. Each check bears the name of its limit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct QualitySettings {
    /// Least overlap of the profiles at 0 and 360 deg, intersection over union.
    pub closure_overlap: f64,
    /// Most that the specimen may lie elsewhere at 360 deg, along the capillary and across it.
    pub closure_along_px: f64,
    pub closure_across_px: f64,
    /// Most that it may have turned in the capillary.
    pub closure_turn_deg: f64,
    /// Least views that count, and least of the planned ones, %.
    pub views_least: usize,
    pub usable_percent: f64,
    /// Widest angle in which no view sees an edge.
    pub gap_deg: f64,
    /// Most that the edges of the views may lie from what the others make expected: of the median view, and of any.
    pub residual_px: f64,
    pub residual_view_px: f64,
    /// Least of a profile that what no view misses covers, %: of any view.
    pub overlap_percent: f64,
    /// Most that the volume may be uncertain by, %: the standard deviation by views, calibration and corners, without the rig's scale and edges.
    pub volume_sd_percent: f64,
    /// Most that the turn's camera may be off the rig's.
    pub uy_px: f64,
    pub gamma_deg: f64,
    pub alpha_deg: f64,
    /// Most that true angles may be off the ledger's, %, where they are by five of their standard deviations.
    pub rho_percent: f64,
    /// Most standard deviations off the mean of reference larvae of its age.
    pub reference_z: f64,
    /// Of the daily beads.
    pub gate: GateSettings,
}

impl Default for QualitySettings {
    /// Where each is from stands in docs/quality.md.
    fn default() -> Self {
        Self {
            closure_overlap: 0.95,
            closure_along_px: 3.0,
            closure_across_px: 3.0,
            closure_turn_deg: 5.0,
            views_least: 7,
            usable_percent: 80.0,
            gap_deg: 45.0,
            residual_px: 1.5,
            residual_view_px: 3.0,
            overlap_percent: 85.0,
            volume_sd_percent: 2.0,
            uy_px: 30.0,
            gamma_deg: 3.0,
            alpha_deg: 2.0,
            rho_percent: 1.0,
            reference_z: 5.0,
            gate: GateSettings::default(),
        }
    }
}

impl QualitySettings {
    /// Every limit that is out of its range.
    pub fn check(&self) -> Vec<OutOfRange> {
        outside([
            ("closure_overlap", self.closure_overlap, 0.0..=1.0, "(share)"),
            ("closure_along_px", self.closure_along_px, 0.0..=1000.0, "px"),
            ("closure_across_px", self.closure_across_px, 0.0..=1000.0, "px"),
            ("closure_turn_deg", self.closure_turn_deg, 0.0..=180.0, "deg"),
            ("views_least", self.views_least as f64, 3.0..=1000.0, "views"),
            ("usable_percent", self.usable_percent, 0.0..=100.0, "%"),
            ("gap_deg", self.gap_deg, 1.0..=180.0, "deg"),
            ("residual_px", self.residual_px, 0.01..=100.0, "px"),
            ("residual_view_px", self.residual_view_px, 0.01..=100.0, "px"),
            ("overlap_percent", self.overlap_percent, 0.0..=100.0, "%"),
            ("volume_sd_percent", self.volume_sd_percent, 0.01..=100.0, "%"),
            ("uy_px", self.uy_px, 0.1..=1000.0, "px"),
            ("gamma_deg", self.gamma_deg, 0.01..=10.0, "deg"),
            ("alpha_deg", self.alpha_deg, 0.01..=10.0, "deg"),
            ("rho_percent", self.rho_percent, 0.1..=50.0, "%"),
            ("reference_z", self.reference_z, 0.1..=1000.0, "standard deviations"),
        ])
    }
}
