//! Estimates of a specimen's volume during its turn.
//!
//! ```text
//!   every twelfth of the turn, if no view waits: refine ──────┐
//!   each view, from the rule's first view on: estimate ───────┴─ newest ── volume, sd     rule ── converged, enough
//! ```

use crate::api::VolumeWait;
use carved_core::measure::Estimator;
use carved_core::quality::{EarlyStopSettings, Estimate, has_converged, should_stop};
use carved_records::{LiveEstimate, WellStatus};

pub struct LiveEstimator {
    rule: EarlyStopSettings,
    /// In the order of the views.
    estimates: Vec<Estimate>,
    newest: Option<Estimate>,
    /// The newest attempt gave no estimate.
    is_undetermined: bool,
}

impl LiveEstimator {
    pub fn new(rule: EarlyStopSettings) -> Self {
        Self { rule, estimates: Vec::new(), newest: None, is_undetermined: false }
    }

    /// Takes a new estimate. An untrusted estimate is not shown. The end of a turn does not depend on the available time: every estimate
    /// that the rule asks for is made.
    pub fn take(&mut self, found: Option<Estimate>, is_trusted: bool) {
        self.newest = found.filter(|_| is_trusted);
        self.is_undetermined = self.newest.is_none();
        if let Some(estimate) = found {
            // A retaken view does not increase the number of views, so its estimate replaces the earlier one.
            self.estimates.retain(|e| e.views < estimate.views);
            self.estimates.push(estimate);
        }
    }

    /// Whether the method's rule ends the turn.
    pub fn is_enough(&self) -> bool {
        should_stop(&self.estimates, &self.rule)
    }

    pub fn known(&self) -> LiveEstimate {
        LiveEstimate {
            volume_um3: self.newest.map(|e| e.volume_um3),
            volume_sd_um3: self.newest.map(|e| e.stated_sd_um3),
            volume_views: self.newest.map(|e| e.views as u32),
            converged: self.newest.map(|_| has_converged(&self.estimates, &self.rule)),
        }
    }

    /// Why there is no estimate. `None` if there is one. `is_seen_around`: the views are enough for an estimate.
    pub fn wait(&self, is_seen_around: bool) -> Option<VolumeWait> {
        match self.newest {
            Some(_) => None,
            None if !is_seen_around => Some(VolumeWait::Views),
            None if self.is_undetermined => Some(VolumeWait::Slices),
            None => Some(VolumeWait::Computing),
        }
    }

    /// The estimate after the specimen is measured.
    pub fn end(&self, measured: &WellStatus) -> LiveEstimate {
        let of_slices = measured.estimator.as_deref() == Some(Estimator::Support.name());
        LiveEstimate {
            volume_um3: measured.volume_um3,
            volume_sd_um3: measured.volume_sd_um3,
            volume_views: measured.views,
            converged: Some(of_slices && has_converged(&self.estimates, &self.rule)),
        }
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod tests {
    use super::*;

    const RULE: EarlyStopSettings = EarlyStopSettings { min_views: 9, ..EarlyStopSettings::DEFAULT };

    fn estimate(views: usize, volume_um3: f64) -> Estimate {
        Estimate { views, volume_um3, volume_sd_um3: 0.1, stated_sd_um3: 0.3, harmonics: 8 }
    }

    #[test]
    fn nothing_is_known_until_something_is_estimated_and_trusted() {
        let mut estimator = LiveEstimator::new(RULE);
        let nothing = LiveEstimate { volume_um3: None, volume_sd_um3: None, volume_views: None, converged: None };
        assert_eq!(estimator.known(), nothing);
        assert_eq!((estimator.wait(false), estimator.wait(true)), (Some(VolumeWait::Views), Some(VolumeWait::Computing)));
        estimator.take(None, true);
        assert_eq!(estimator.known(), nothing);
        assert_eq!((estimator.wait(false), estimator.wait(true)), (Some(VolumeWait::Views), Some(VolumeWait::Slices)));
        estimator.take(Some(estimate(7, 100.0)), true);
        let told = LiveEstimate { volume_um3: Some(100.0), volume_sd_um3: Some(0.3), volume_views: Some(7), converged: Some(false) };
        assert_eq!(estimator.known(), told, "with the rig's share of the spread");
        assert_eq!(estimator.wait(true), None);
        estimator.take(Some(estimate(8, 100.0)), false);
        assert_eq!(estimator.known(), nothing, "the hull says that the end will trust the voxels");
        estimator.take(Some(estimate(9, 100.1)), true);
        estimator.take(None, true);
        assert_eq!(estimator.known(), nothing, "what was told no longer holds");
    }

    #[test]
    fn it_has_converged_by_the_rule_whether_or_not_that_ends_the_turn() {
        let of = |rule: EarlyStopSettings, volumes: [f64; 3]| {
            let mut estimator = LiveEstimator::new(rule);
            (7..).zip(volumes).for_each(|(views, volume)| estimator.take(Some(estimate(views, volume)), true));
            (estimator.known().converged, estimator.is_enough())
        };
        assert_eq!(of(RULE, [100.0, 100.1, 100.2]), (Some(true), false), "not enabled");
        assert_eq!(of(EarlyStopSettings { enabled: true, ..RULE }, [100.0, 100.1, 100.2]), (Some(true), true));
        assert_eq!(of(RULE, [100.0, 100.1, 100.9]), (Some(false), false), "0.9 % apart");
        assert_eq!(of(EarlyStopSettings { min_views: 10, ..RULE }, [100.0, 100.1, 100.2]), (Some(false), false), "too few views");
    }

    #[test]
    fn a_view_taken_again_replaces_what_it_showed() {
        let mut estimator = LiveEstimator::new(RULE);
        for (views, volume) in [(7, 100.0), (8, 100.0), (9, 103.0), (9, 100.1)] {
            estimator.take(Some(estimate(views, volume)), true);
        }
        let known = estimator.known();
        assert_eq!((known.volume_um3, known.converged), (Some(100.1), Some(true)));
    }
}
