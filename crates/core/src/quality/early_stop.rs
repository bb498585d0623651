//! When a turn may end before its last view: when the bias-corrected volume has settled and is known well enough.
//!
//! ```text
//!  estimates after each view ── at least min_views ──┬─ slices told as finely as they ever are ──────────┐
//!                                                    ├─ the last ones within spread_percent of one another ─┼─ stop
//!                                                    └─ t_{0.975} sd of the newest within promised_error_percent
//! ```
//! The raw hull of few views is too large. The estimates come from support functions, which do not have this bias. The views
//! must be well spread around the turn from the start: coarse to fine, not one after the other.

use super::estimate::Estimate;
use crate::calibration::HARMONICS_MOST;
use crate::range::{Range, Ranged};
use crate::ranges;
use serde::{Deserialize, Serialize};

/// `[methods.X.early_stop]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct EarlyStopSettings {
    /// Whether turns may end early. Off by default: a turn that ends early has no view left that could show that something went
    /// wrong.
    pub enabled: bool,
    /// Fewest views after which a turn may end.
    pub min_views: usize,
    /// Number of newest estimates that must agree. A larger number stops later.
    pub last: usize,
    /// Largest allowed difference between the largest and the smallest of these estimates, % of the newest.
    pub spread_percent: f64,
    /// Error of the volume at the stop that is not exceeded in 95 of 100 turns, %. Half of the newest estimate's own 95 %
    /// interval must not be wider.
    pub promised_error_percent: f64,
}

impl Default for EarlyStopSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Ranged for EarlyStopSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        min_views: 7.0, 1000.0, "views";
        last: 2.0, 20.0, "estimates";
        spread_percent: 0.01, 10.0, "%";
        promised_error_percent: 0.05, 10.0, "%";
    ];
}

impl EarlyStopSettings {
    /// Checked on 1000 phantoms: docs/quality.md.
    pub const DEFAULT: Self = Self { enabled: false, min_views: 28, last: 3, spread_percent: 0.4, promised_error_percent: 1.0 };

    /// Whether an estimate after this number of views is used. Earlier ones decide nothing.
    pub fn asks(&self, views: usize) -> bool {
        views + self.last > self.min_views
    }
}

/// Whether the turn may end. `estimates` are in the order of acquisition, the newest last.
pub fn should_stop(estimates: &[Estimate], settings: &EarlyStopSettings) -> bool {
    settings.enabled && has_converged(estimates, settings)
}

/// Whether the volume has settled and is known as well as the rule promises, whether or not a turn may end by it.
pub fn has_converged(estimates: &[Estimate], settings: &EarlyStopSettings) -> bool {
    let Some(newest) = estimates.last() else { return false };
    if newest.views < settings.min_views || estimates.len() < settings.last {
        return false;
    }
    let last = &estimates[estimates.len() - settings.last..];
    let fine = newest.harmonics >= HARMONICS_MOST;
    // There must be an estimate for every view: a missing one may be the one that disagrees.
    let consecutive = last.windows(2).all(|pair| pair[1].views == pair[0].views + 1);
    let [low, high] = last.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], e| [l.min(e.volume_um3), h.max(e.volume_um3)]);
    let numbers = last.iter().all(|e| e.volume_um3.is_finite());
    let agree = numbers && high - low <= settings.spread_percent / 100.0 * newest.volume_um3;
    let known = newest.half_interval_percent().is_some_and(|percent| percent <= settings.promised_error_percent);
    fine && consecutive && agree && known
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ON: EarlyStopSettings =
        EarlyStopSettings { enabled: true, min_views: 10, last: 3, spread_percent: 0.4, promised_error_percent: 1.0 };

    fn estimates(first_views: usize, volumes: &[f64], sd: f64) -> Vec<Estimate> {
        let of = |(i, &volume_um3): (usize, &f64)| {
            let views = first_views + i;
            Estimate { views, volume_um3, volume_sd_um3: sd, stated_sd_um3: sd, harmonics: 8 }
        };
        volumes.iter().enumerate().map(of).collect()
    }

    #[test]
    fn it_stops_when_the_last_agree_and_are_known_and_not_before() {
        let settled = estimates(8, &[100.3, 100.0, 100.1], 0.2);
        assert!(should_stop(&settled, &ON));
        let off = EarlyStopSettings { enabled: false, ..ON };
        assert!(!should_stop(&settled, &off) && has_converged(&settled, &off), "it is told, and no turn ends by it");
        assert!(!should_stop(&settled, &EarlyStopSettings { min_views: 11, ..ON }));
        assert!(!should_stop(&settled, &EarlyStopSettings { last: 4, ..ON }));
        assert!(!should_stop(&settled, &EarlyStopSettings { spread_percent: 0.29, ..ON }), "0.3 apart");
        // 95 % of 9 degrees of freedom: 2.262 times 0.2.
        assert!(!should_stop(&settled, &EarlyStopSettings { promised_error_percent: 0.45, ..ON }));
        assert!(should_stop(&settled, &EarlyStopSettings { promised_error_percent: 0.46, ..ON }));
        assert!(!should_stop(&[settled[0], settled[2]], &EarlyStopSettings { last: 2, ..ON }), "the view between gave no estimate");
        assert!(!should_stop(&[], &ON));
        let mut coarse = settled.clone();
        coarse[2].harmonics = 7;
        assert!(!should_stop(&coarse, &ON), "its slices have no corners");
        assert!(!should_stop(&estimates(8, &[100.0, 100.0, f64::NAN], 0.1), &ON));
        assert!(!should_stop(&estimates(8, &[100.0, f64::NAN, 100.0], 0.1), &ON));
    }

    #[test]
    fn estimates_are_asked_for_as_soon_as_they_decide() {
        let asked: Vec<usize> = (0..20).filter(|v| ON.asks(*v)).collect();
        assert_eq!(asked.first(), Some(&8));
    }

    proptest! {
        /// What stops a turn stops it under any looser rule.
        #[test]
        fn a_looser_rule_stops_no_later(
            volumes in prop::collection::vec(99.0..101.0f64, 3..12), sd in 0.01..1.0f64, looser in 1.0..4.0f64, fewer in 0usize..4
        ) {
            let found = estimates(6, &volumes, sd);
            let loose = EarlyStopSettings {
                min_views: ON.min_views - fewer,
                spread_percent: ON.spread_percent * looser,
                promised_error_percent: ON.promised_error_percent * looser,
                ..ON
            };
            prop_assert!(!should_stop(&found, &ON) || should_stop(&found, &loose));
        }
    }
}
