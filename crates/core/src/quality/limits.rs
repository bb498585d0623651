//! The limits of a method, `[methods.X.quality]`.

use super::gate::GateSettings;
use crate::range::{OutOfRange, Range, Ranged, outside_in};
use crate::ranges;
use serde::{Deserialize, Serialize};

/// A number beyond one of these limits is flagged, never dropped. Each check has the name of its limit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct QualitySettings {
    /// Smallest overlap of the profiles at 0 and 360 deg, intersection over union.
    pub closure_overlap: f64,
    /// Largest displacement of the specimen at 360 deg along the capillary, px.
    pub closure_along_px: f64,
    /// Largest displacement of the specimen at 360 deg across the capillary, px.
    pub closure_across_px: f64,
    /// Largest turn of the specimen in the capillary, deg.
    pub closure_turn_deg: f64,
    /// Fewest views that count.
    pub views_least: usize,
    /// Smallest share of the planned views that count, %.
    pub usable_percent: f64,
    /// Widest angle in which no view sees an edge, deg.
    pub gap_deg: f64,
    /// Largest residual of the median view: the distance between its edges and those that the others make expected, px.
    pub residual_px: f64,
    /// Largest residual of any view, px.
    pub residual_view_px: f64,
    /// Largest distance (root mean square) between the edges that are measured and the outlines of the slices fitted to them, px.
    pub scatter_px: f64,
    /// Smallest share of any view's profile that the hull that no view misses (VRV) covers, %.
    pub overlap_percent: f64,
    /// Largest standard deviation of the volume, %: from views, calibration, corners and fins, without the rig's scale and edges.
    pub volume_sd_percent: f64,
    /// Largest difference in uy between the turn's camera and the rig's, px.
    pub uy_px: f64,
    /// Largest difference in gamma between the turn's camera and the rig's, deg.
    pub gamma_deg: f64,
    /// Largest difference in alpha between the turn's camera and the rig's, deg.
    pub alpha_deg: f64,
    /// Largest difference between true angles and the ledger's, %. It is checked where it exceeds five of its standard
    /// deviations.
    pub rho_percent: f64,
    /// Largest distance from the mean of reference larvae of the same age, standard deviations.
    pub reference_z: f64,
    /// Limits of the daily bead gate.
    pub gate: GateSettings,
}

impl Default for QualitySettings {
    /// docs/quality.md gives the source of each value.
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
            scatter_px: 1.0,
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

impl Ranged for QualitySettings {
    const RANGES: &'static [Range<Self>] = ranges![
        closure_overlap: 0.0, 1.0, "(share)";
        closure_along_px: 0.0, 1000.0, "px";
        closure_across_px: 0.0, 1000.0, "px";
        closure_turn_deg: 0.0, 180.0, "deg";
        views_least: 3.0, 1000.0, "views";
        usable_percent: 0.0, 100.0, "%";
        gap_deg: 1.0, 180.0, "deg";
        residual_px: 0.01, 100.0, "px";
        residual_view_px: 0.01, 100.0, "px";
        scatter_px: 0.01, 100.0, "px";
        overlap_percent: 0.0, 100.0, "%";
        volume_sd_percent: 0.01, 100.0, "%";
        uy_px: 0.1, 1000.0, "px";
        gamma_deg: 0.01, 10.0, "deg";
        alpha_deg: 0.01, 10.0, "deg";
        rho_percent: 0.1, 50.0, "%";
        reference_z: 0.1, 1000.0, "standard deviations";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        outside_in("gate", &self.gate).collect()
    }
}
