//! The volume of a turn that is not complete.

use crate::measure::Spread;
use crate::measure::support::SupportEstimate;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A volume after some of the views, corrected for the bias of few views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Number of views that it rests on.
    pub views: usize,
    /// The volume, um^3.
    pub volume_um3: f64,
    /// Standard deviation of the volume between turns of the same specimen, um^3: views, calibration, and the corners of fins
    /// that few views do not show.
    pub volume_sd_um3: f64,
    /// Standard deviation including the rig's scale and edges, which are the same in every turn, um^3. It is the one that is
    /// reported with a measurement.
    pub stated_sd_um3: f64,
    /// Number of harmonics in each slice's series. Fewer than the maximum leave out the corners of fins: up to 1 % of the
    /// volume of a larva with fins.
    pub harmonics: usize,
}

impl Estimate {
    /// The estimate of a turn's support functions. `None` where slices do not give the volume: the final measurement would be
    /// the voxels'.
    pub fn of(views: usize, support: &SupportEstimate, spread: &Spread) -> Option<Self> {
        (!support.is_hollow() && !support.is_all_error()).then(|| Self {
            views,
            volume_um3: support.volume_um3,
            volume_sd_um3: spread.volume_of_turn_um3(),
            stated_sd_um3: spread.volume_um3(),
            harmonics: support.harmonics,
        })
    }

    /// Half of the 95 % interval, % of the volume, by Student's t with one degree of freedom less than views. `None` with fewer
    /// than two views.
    pub fn half_interval_percent(&self) -> Option<f64> {
        let student = StudentsT::new(0.0, 1.0, self.views as f64 - 1.0).ok()?;
        Some(100.0 * student.inverse_cdf(0.975) * self.volume_sd_um3 / self.volume_um3)
    }
}
