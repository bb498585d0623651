//! What measured beads say together.

use crate::statistics::{Spread, mean};
use serde::{Deserialize, Serialize};

/// One bead of one turn.
#[derive(Debug, Clone, PartialEq)]
pub struct BeadMeasured {
    /// Which bead: the same name is the same bead, measured again.
    pub bead: String,
    pub diameter_um: f64,
    /// Length along the capillary over width across it.
    pub aspect_ratio: f64,
    /// Of its surface off its sphere.
    pub sphere_rms_um: f64,
    /// Of its median view.
    pub residual_px: Option<f64>,
    /// Of the turn's own camera, where it calibrated itself.
    pub uy_px: Option<f64>,
    pub gamma_deg: Option<f64>,
}

/// A gate's numbers, which the next one's are held against.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GateNumbers {
    /// Different beads, and turns of them.
    pub beads: usize,
    pub turns: usize,
    /// Over the beads; one that was measured several times has its mean.
    pub diameter_um: Spread,
    /// Over the turns.
    pub aspect_ratio: Spread,
    pub sphere_rms_um: Spread,
    pub residual_px: Option<Spread>,
    pub uy_px: Option<Spread>,
    pub gamma_deg: Option<Spread>,
    /// Of the bead that is least round, and of the one whose views agree least.
    pub worst_sphere_rms_um: f64,
    pub worst_residual_px: Option<f64>,
    /// Largest less smallest diameter of one bead; of the bead for which that is largest. `null` where none was measured twice.
    pub repeat_um: Option<f64>,
    /// Diameter of each bead.
    pub diameters_um: Vec<f64>,
}

impl GateNumbers {
    /// Nothing of no beads.
    pub fn of(turns: &[BeadMeasured]) -> Option<Self> {
        let mut names: Vec<&str> = turns.iter().map(|t| t.bead.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let of_bead = |name: &str| turns.iter().filter(|t| t.bead == name).map(|t| t.diameter_um).collect::<Vec<f64>>();
        let beads: Vec<Vec<f64>> = names.iter().map(|name| of_bead(name)).collect();
        let diameters_um: Vec<f64> = beads.iter().map(|d| mean(d)).collect();
        let range = |d: &Vec<f64>| d.iter().copied().fold(f64::MIN, f64::max) - d.iter().copied().fold(f64::MAX, f64::min);
        let all = |of: fn(&BeadMeasured) -> Option<f64>| turns.iter().filter_map(of).collect::<Vec<f64>>();
        let worst = |values: &[f64]| values.iter().copied().max_by(f64::total_cmp);
        let (rms, residuals) = (all(|t| Some(t.sphere_rms_um)), all(|t| t.residual_px));
        Some(Self {
            beads: beads.len(),
            turns: turns.len(),
            diameter_um: Spread::of(&diameters_um)?,
            aspect_ratio: Spread::of(&all(|t| Some(t.aspect_ratio)))?,
            sphere_rms_um: Spread::of(&rms)?,
            residual_px: Spread::of(&residuals),
            uy_px: Spread::of(&all(|t| t.uy_px)),
            gamma_deg: Spread::of(&all(|t| t.gamma_deg)),
            worst_sphere_rms_um: worst(&rms)?,
            worst_residual_px: worst(&residuals),
            repeat_um: beads.iter().filter(|d| d.len() > 1).map(range).max_by(f64::total_cmp),
            diameters_um,
        })
    }
}
