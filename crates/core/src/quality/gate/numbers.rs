//! The numbers of measured beads taken together.

use crate::statistics::{Spread, mean};
use serde::{Deserialize, Serialize};

/// One turn of one bead.
#[derive(Debug, Clone, PartialEq)]
pub struct BeadMeasured {
    /// Name of the bead. The same name means the same bead, measured again.
    pub bead: String,
    /// Diameter of the fitted sphere, um.
    pub diameter_um: f64,
    /// Length along the capillary over width across it.
    pub aspect_ratio: f64,
    /// Root of the mean square distance between the surface and its sphere, um.
    pub sphere_rms_um: f64,
    /// Residual of the median view, px. `None` where the turn was not calibrated.
    pub residual_px: Option<f64>,
    /// Shift uy of the turn's own camera, px. `None` where the turn was not calibrated.
    pub uy_px: Option<f64>,
    /// Roll gamma of the turn's own camera, deg. `None` where the turn was not calibrated.
    pub gamma_deg: Option<f64>,
}

/// The numbers of a gate. Later gates are compared with them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GateNumbers {
    /// Number of different beads.
    pub beads: usize,
    /// Number of turns of these beads.
    pub turns: usize,
    /// Diameter over the beads, um. A bead that was measured several times counts with its mean.
    pub diameter_um: Spread,
    /// Length over width, over the turns.
    pub aspect_ratio: Spread,
    /// Deviation from the sphere over the turns, um.
    pub sphere_rms_um: Spread,
    /// Residual of the median view over the turns, px. `None` where no turn has one.
    pub residual_px: Option<Spread>,
    /// Shift uy over the turns, px. `None` where no turn has one.
    pub uy_px: Option<Spread>,
    /// Roll gamma over the turns, deg. `None` where no turn has one.
    pub gamma_deg: Option<Spread>,
    /// Deviation from the sphere of the bead that is least round, um.
    pub worst_sphere_rms_um: f64,
    /// Residual of the bead whose views agree least, px. `None` where no turn has one.
    pub worst_residual_px: Option<f64>,
    /// Largest difference between the diameters of one bead, um. `None` where no bead was measured twice.
    pub repeat_um: Option<f64>,
    /// Diameter of each bead, um.
    pub diameters_um: Vec<f64>,
}

impl GateNumbers {
    /// The numbers of these turns. `None` without any.
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
