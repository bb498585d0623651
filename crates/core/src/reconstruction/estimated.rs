//! The volume of a turn that is not complete.
//!
//! ```text
//!   views so far ── from enough sides? ── calibrated on just these ── slices ── Estimate       volume, sd
//! ```
//! The raw hull of few views is too large; the slices' support functions do not have this bias. With all views the estimate
//! equals the final measurement to the last bit, unless the final measurement uses the voxels.

use super::Reconstruction;
use super::calibrated::{Calibrated, Judged, given};
use super::finned::Finned;
use super::turn::HULL_LEAST;
use crate::calibration::Pose;
use crate::measure::support::{Sections, SupportEstimate, calibration_sd};
use crate::quality::Estimate;

impl Reconstruction {
    /// The volume from support functions after the views so far, calibrated on just these. It takes as long as [`Self::refine`]
    /// without its carving. `None` where the views do not determine it or it is not to be trusted.
    pub fn estimate(&self, sphere: bool) -> Option<Estimate> {
        if self.is_seen_around() { self.estimated(&self.finned(self.calibrate(), sphere)) } else { None }
    }

    /// The same from a given calibration on the views so far.
    pub(super) fn estimated(&self, finned: &Finned) -> Option<Estimate> {
        let Finned { views: observed, fins, calibrated: Calibrated { order, found } } = finned;
        let Judged { calibration, .. } = found.as_ref().ok()?;
        let given = given(observed, order);
        let used = || order.iter().zip(&calibration.views).filter(|(_, state)| state.bad.is_none());
        let open = self.open(&used().map(|(&i, _)| i));
        let views = calibration.turn_views(&given);
        let sections = Sections::with_fins(&Pose::new(&calibration.camera), &views, calibration.residual_sd_um, open, fins).ok()?;
        let support = SupportEstimate::of(&sections);
        let calibration = calibration_sd(calibration, &given).ok()?;
        let spread = self.spread(&sections, &support, [support.volume_um3, support.area_um2], calibration);
        Estimate::of(self.observed.len(), &support, &spread)
    }

    /// Whether the newest refined hull is too small for an estimate. Slices are then hollow, and the final measurement will use
    /// the voxels.
    pub fn is_hollow(&self, estimate: &Estimate) -> bool {
        self.refined.is_some() && self.live().volume_um3 < HULL_LEAST * estimate.volume_um3
    }
}
