//! The views of a turn with the fins that they agree on.
//!
//! ```text
//!   found edges, body edges ── calibrated ── fins ── edges amended ── calibrated again ── carved and measured
//! ```

use super::Reconstruction;
use super::calibrated::{Calibrated, Judged};
use super::turn::ObservedView;
use crate::calibration::{Pose, TurnView};
use crate::fins::{self, FinView, SharedFins};
use crate::parallel::prelude::*;

/// Views amended by the fins, and their calibration.
#[derive(Debug)]
pub struct Finned {
    /// In the order of observing.
    pub(super) views: Vec<ObservedView>,
    pub(super) fins: SharedFins,
    pub(super) calibrated: Calibrated,
}

impl Reconstruction {
    /// Finds fins, amends the views by them and calibrates again. A sphere has no fins. The views of a specimen that moved
    /// have none in common, and without a calibration it is not known where they meet: such views stay as they are.
    pub fn finned(&self, calibrated: Calibrated, sphere: bool) -> Finned {
        let unchanged = |calibrated| Finned { views: self.observed.clone(), fins: SharedFins::default(), calibrated };
        let Ok(Judged { calibration, .. }) = &calibrated.found else { return unchanged(calibrated) };
        if sphere || calibration.moved.is_some() {
            return unchanged(calibrated);
        }
        let mut turned: Vec<FinView> = Vec::with_capacity(self.observed.len());
        for (at, (&i, state)) in calibrated.order.iter().zip(&calibration.views).enumerate() {
            let seen = &self.observed[i];
            let turn = TurnView { columns: &seen.columns, omega: calibration.angle(seen.omega), dy_px: state.dy_px };
            let projection = calibration.projection(at, seen.omega);
            turned.push(FinView { turn, body: seen.body.as_ref(), borders: seen.borders.as_ref(), projection });
        }
        let used: Vec<FinView> =
            turned.iter().zip(&calibration.views).filter(|(_, state)| state.bad.is_none()).map(|(view, _)| *view).collect();
        let found = fins::find(&Pose::new(&calibration.camera), &used);
        if !found.is_searched() {
            return unchanged(calibrated);
        }
        let mut views = self.observed.clone();
        // A view that does not belong stays as it is, so that it is left out again.
        let amended: Vec<(usize, ObservedView)> = calibrated
            .order
            .par_iter()
            .zip(&turned)
            .enumerate()
            .filter(|(at, _)| calibration.views[*at].bad.is_none())
            .map(|(_, (&i, view))| {
                let seen = &self.observed[i];
                let columns = found.amended(view);
                let outlines = seen.outlines.iter().map(|outline| outline.with_edges(&seen.columns, &columns)).collect();
                let mask = self.hull.carver().views()[i].runs.mask().with_edges(&seen.columns, &columns);
                (i, ObservedView { columns, outlines, mask: Some(mask), ..seen.clone() })
            })
            .collect();
        for (i, view) in amended {
            views[i] = view;
        }
        let again = self.calibrate_on(&views);
        if again.found.is_err() || again.has_moved() {
            return unchanged(calibrated);
        }
        Finned { views, fins: found, calibrated: again }
    }
}
