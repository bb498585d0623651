//! The volume of a turn that is not over.

use crate::measure::Spread;
use crate::measure::support::SupportEstimate;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A volume after so many views, with what few views make of it taken off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    pub views: usize,
    pub volume_um3: f64,
    /// Of another turn of the same specimen: views, calibration, and the corners of fins that few views do not show.
    pub volume_sd_um3: f64,
    /// With the rig's scale and edges, which are the same in every turn: what stands beside a measurement.
    pub stated_sd_um3: f64,
    /// Of each slice's series. Fewer than the most leave out the corners of fins: up to 1 % of a finned larva.
    pub harmonics: usize,
}

impl Estimate {
    /// Nothing where slices do not tell the volume: it would be the voxels' in the end.
    pub fn of(views: usize, support: &SupportEstimate, spread: &Spread) -> Option<Self> {
        (!support.is_hollow() && !support.is_all_error()).then(|| Self {
            views,
            volume_um3: support.volume_um3,
            volume_sd_um3: spread.volume_of_turn_um3(),
            stated_sd_um3: spread.volume_um3(),
            harmonics: support.harmonics,
        })
    }

    /// Half of the 95 % interval, % of the volume: Student's t of the views less one.
    pub fn half_interval_percent(&self) -> Option<f64> {
        let student = StudentsT::new(0.0, 1.0, self.views as f64 - 1.0).ok()?;
        Some(100.0 * student.inverse_cdf(0.975) * self.volume_sd_um3 / self.volume_um3)
    }
}
