//! The live model with a camera calibrated on the views so far.
//!
//! ```text
//!   view ── observe ──┬─ hull through the camera as given         what the end is made of: runs, edges, angles
//!                     └─ hull through the refined camera ── page
//!   now and then, when nobody waits: refine ── calibrate on the views so far ── all of them carved again
//! ```
//! A refined model is only shown. [`Reconstruction::finish`] calibrates on all views and gives the same bits whether or not
//! anything was refined before.

use super::calibrated::Judged;
use super::finned::Finned;
use super::{LiveVolume, Reconstruction};
use crate::calibration::Calibration;
use crate::carver::{CarveError, Carver, Leaves};
use crate::profile::Mask;
use crate::quality::Estimate;
use std::f64::consts::{PI, TAU};

/// Fewer views determine the axis less well than the rig's camera does.
const VIEWS_LEAST: usize = 7;
/// Half a turn shows every slice from each side once, which any axis fits. Later views see what others saw from the opposite
/// side; from 30 deg of overlap on the axis is determined.
const GAP_MOST: f64 = 150.5 / 180.0 * PI;
/// Between two refinements this share of the planned views must be observed: one in `SHARE`.
const SHARE: usize = 12;

/// A camera and the hull carved with it.
#[derive(Debug, Clone)]
pub(super) struct Refined {
    calibration: Calibration,
    carver: Carver,
}

impl Refined {
    /// Carves with a view that came after the calibration. The calibration gives its angle, but not its own shift.
    pub fn observe(&mut self, mask: &Mask, omega: f64, leaves: Leaves) -> Result<(), CarveError> {
        let Calibration { camera, .. } = &self.calibration;
        self.carver.observe(mask, &camera.projection(self.calibration.angle(omega)), leaves)
    }
}

impl Reconstruction {
    /// Whether enough views from enough sides have arrived since the last refinement for another one to be worth its time.
    pub fn is_refinable(&self) -> bool {
        let due = self.refined_at + self.hull.carver().planned_views().div_ceil(SHARE);
        self.settings.calibration.enabled && self.observed.len() >= due && self.is_seen_around()
    }

    /// Whether the views so far determine axis and slices.
    pub(super) fn is_seen_around(&self) -> bool {
        is_seen_around(self.observed.iter().map(|s| s.omega))
    }

    /// Calibrates on the views so far and carves them again, with the fins that they share, for the live model; with the given
    /// camera where they do not determine one. A view that does not belong is left out. `sphere` is that of [`Self::finish`], whose
    /// result does not depend on this. The estimate is that of [`Self::estimate`].
    pub fn refine(&mut self, sphere: bool) -> Option<Estimate> {
        self.refined_at = self.observed.len();
        let finned = self.finned(self.calibrate(), sphere);
        let estimate = self.estimated(&finned);
        self.refined = self.refined_with(finned);
        estimate
    }

    /// The live model of these views. `None` where they have no calibration.
    fn refined_with(&self, finned: Finned) -> Option<Refined> {
        let given = self.hull.carver();
        let mut carver = given.through(&[]);
        for (i, projection) in finned.calibrated.used(self) {
            let view = &given.views()[i];
            carver.observe(&finned.views[i].mask(view), &projection, view.leaves).ok()?;
        }
        let Judged { calibration, .. } = finned.calibrated.found.ok()?;
        Some(Refined { calibration, carver })
    }

    /// The hull that is displayed.
    pub(crate) fn live_carver(&self) -> &Carver {
        self.refined.as_ref().map_or(self.hull.carver(), |r| &r.carver)
    }

    /// The model so far. From view to view its volume never increases; a refinement may increase it.
    pub fn live(&self) -> LiveVolume {
        let carver = self.live_carver();
        LiveVolume { views: self.observed.len(), voxels: carver.live_voxels(), volume_um3: carver.volume_um3() }
    }
}

/// Whether views from these angles (rad) are enough, and see the specimen from enough sides, to determine axis and slices.
pub fn is_seen_around(omegas: impl Iterator<Item = f64>) -> bool {
    let mut angles: Vec<f64> = omegas.map(|omega| omega.rem_euclid(TAU)).collect();
    angles.sort_by(f64::total_cmp);
    let around = angles.first().map_or(TAU, |first| first + TAU);
    let next = angles.iter().copied().skip(1).chain(std::iter::once(around));
    let gap = angles.iter().zip(next).map(|(a, b)| b - a).fold(0.0, f64::max);
    angles.len() >= VIEWS_LEAST && gap <= GAP_MOST
}
