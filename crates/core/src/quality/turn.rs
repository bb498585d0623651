//! The checks of a turn.
//!
//! ```text
//!  closure ─── overlap, px along, px across, deg of turn ─┐
//!  strip ───── residual of the median view, of the worst; least overlap with VRV ─┤
//!  slices ──── distance of the edges from the fitted outlines ────────────────────┤
//!  angles ──── views that count, of those planned; widest gap ────────────────────┼─ Quality
//!  volume ──── its standard deviation ────────────────────────────────────────────┤
//!  camera ──── uy, gamma, alpha off the rig's; rho off 1 ─────────────────────────┘
//! ```

use super::checks::{Check, Quality};
use super::limits::QualitySettings;
use super::strip::ViewStrip;
use crate::calibration::widest_gap;
use crate::flag::Flag;
use crate::statistics::upper_median;

/// The view at 360 deg compared with the view at 0 deg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClosureOff {
    pub overlap: f64,
    pub along_px: f64,
    pub across_px: f64,
    /// `None` where the turn's slices do not determine it.
    pub turn_deg: Option<f64>,
    /// Standard deviations of the three numbers above. `None` where they are only the shift of the profile's centroid.
    pub sd: Option<ClosureSd>,
}

impl ClosureOff {
    /// Whether the specimen has certainly moved, judged by the two profiles alone before the turn is measured. A fin that one
    /// of the profiles lacks shifts the centroid by as much as a limit, so twice the limit is allowed here.
    pub fn is_far(&self, limits: &QualitySettings) -> bool {
        self.overlap < limits.closure_overlap
            || self.along_px.abs() > 2.0 * limits.closure_along_px
            || self.across_px.abs() > 2.0 * limits.closure_across_px
    }
}

/// Standard deviations of a [`ClosureOff`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClosureSd {
    pub along_px: f64,
    pub across_px: f64,
    pub turn_deg: f64,
}

/// The turn's own camera minus the rig's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CalibrationOff {
    pub uy_px: f64,
    pub gamma_deg: f64,
    pub alpha_deg: f64,
    pub rho_percent: f64,
    /// Whether the ratio of angles differs significantly from 1.
    pub is_rho_significant: bool,
}

/// The facts of a turn that are checked.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TurnFacts<'a> {
    pub planned_views: usize,
    /// Angles of the views that count, rad.
    pub omegas: &'a [f64],
    pub strip: &'a [ViewStrip],
    pub closure: Option<ClosureOff>,
    pub calibration: Option<CalibrationOff>,
    /// Distance between the edges and the outlines of the slices fitted to them, px.
    pub scatter_px: Option<f64>,
    /// Standard deviation of the volume from views, calibration, corners and fins, %.
    pub volume_sd_percent: Option<f64>,
}

/// Whether there are too few views, or too few directions, to determine the shape of a slice.
pub fn tell_little(omegas: &[f64], limits: &QualitySettings) -> bool {
    omegas.len() < limits.views_least || widest_gap(omegas).to_degrees() > limits.gap_deg
}

impl Quality {
    pub(crate) fn of(turn: &TurnFacts, l: &QualitySettings) -> Self {
        let used = || turn.strip.iter().filter(|v| v.used);
        let residuals: Vec<f64> = used().filter_map(|v| v.residual_px).collect();
        let residual = (!residuals.is_empty()).then(|| upper_median(residuals));
        let worst = used().filter_map(|v| Some((v.residual_px?, v.view))).max_by(|a, b| a.0.total_cmp(&b.0)).unzip();
        let least = used().filter_map(|v| Some((v.overlap_percent?, v.view))).min_by(|a, b| a.0.total_cmp(&b.0)).unzip();
        let views = turn.omegas.len() as f64;
        let closure = |of: fn(&ClosureOff) -> f64| turn.closure.as_ref().map(of);
        let sd = |of: fn(&ClosureSd) -> f64| turn.closure.and_then(|c| c.sd).as_ref().map(of);
        let surely = |name, unit, found, sd, limit| Check::at_most_surely(name, unit, Flag::Moved, found, sd, limit);
        let off = |of: fn(&CalibrationOff) -> f64| turn.calibration.as_ref().map(of);
        // A ratio that does not differ significantly from 1 counts as 1.
        let rho = turn.calibration.map(|c| if c.is_rho_significant { c.rho_percent } else { 0.0 });
        Self::new(vec![
            Check::at_least("closure_overlap", "share", Flag::Moved, closure(|c| c.overlap), l.closure_overlap),
            surely("closure_along_px", "px", closure(|c| c.along_px), sd(|s| s.along_px), l.closure_along_px),
            surely("closure_across_px", "px", closure(|c| c.across_px), sd(|s| s.across_px), l.closure_across_px),
            surely("closure_turn_deg", "deg", turn.closure.and_then(|c| c.turn_deg), sd(|s| s.turn_deg), l.closure_turn_deg),
            Check::at_least("views_least", "views", Flag::FewViews, Some(views), l.views_least as f64),
            Check::at_least(
                "usable_percent",
                "%",
                Flag::UnusableViews,
                Some(100.0 * views / turn.planned_views.max(1) as f64),
                l.usable_percent,
            ),
            Check::at_most("gap_deg", "deg", Flag::FewViews, Some(widest_gap(turn.omegas).to_degrees()), l.gap_deg),
            Check::at_most("residual_px", "px", Flag::Residual, residual, l.residual_px),
            Check::at_most("residual_view_px", "px", Flag::Residual, worst.0, l.residual_view_px).of_view(worst.1),
            Check::at_most("scatter_px", "px", Flag::Residual, turn.scatter_px, l.scatter_px),
            Check::at_least("overlap_percent", "%", Flag::Overlap, least.0, l.overlap_percent).of_view(least.1),
            Check::at_most("volume_sd_percent", "%", Flag::Uncertain, turn.volume_sd_percent, l.volume_sd_percent),
            Check::at_most("uy_px", "px", Flag::CalibrationOff, off(|c| c.uy_px), l.uy_px),
            Check::at_most("gamma_deg", "deg", Flag::CalibrationOff, off(|c| c.gamma_deg), l.gamma_deg),
            Check::at_most("alpha_deg", "deg", Flag::CalibrationOff, off(|c| c.alpha_deg), l.alpha_deg),
            Check::at_most("rho_percent", "%", Flag::WrongSteps, rho, l.rho_percent),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flag::StoredFlag;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    fn even(n: u32) -> Vec<f64> {
        (0..n).map(|i| TAU * f64::from(i) / f64::from(n)).collect()
    }

    fn strip(n: u32) -> Vec<ViewStrip> {
        let view = |view| ViewStrip { view, used: true, reason: None, residual_px: Some(0.4), overlap_percent: Some(97.0) };
        (0..n).map(view).collect()
    }

    const GOOD: ClosureOff = ClosureOff { overlap: 0.985, along_px: 0.2, across_px: -0.3, turn_deg: Some(0.4), sd: Some(KNOWN) };
    const KNOWN: ClosureSd = ClosureSd { along_px: 0.02, across_px: 0.02, turn_deg: 0.04 };
    const NEAR: CalibrationOff =
        CalibrationOff { uy_px: -12.0, gamma_deg: 0.4, alpha_deg: -0.2, rho_percent: 1.4, is_rho_significant: false };

    fn of(omegas: &[f64], strip: &[ViewStrip], closure: Option<ClosureOff>, calibration: Option<CalibrationOff>) -> Quality {
        let facts =
            TurnFacts { planned_views: 21, omegas, strip, closure, calibration, scatter_px: Some(0.2), volume_sd_percent: Some(0.6) };
        Quality::of(&facts, &QualitySettings::default())
    }

    fn good() -> Quality {
        of(&even(21), &strip(21), Some(GOOD), Some(NEAR))
    }

    #[test]
    fn a_good_turn_passes_and_has_every_number() {
        let found = good();
        assert!(found.passed && found.flags().is_empty(), "{found:?}");
        assert!(found.checks.iter().all(|c| c.found.is_some()));
        // Every limit has its key: the names are those of the settings.
        let keys = serde_json::to_value(QualitySettings::default()).unwrap();
        assert!(found.checks.iter().all(|c| keys.get(&c.name).is_some_and(|l| (l.as_f64().unwrap() - c.limit).abs() < 1e-12)));
    }

    #[test]
    fn the_table_of_flags_names_the_checks_that_raise_each() {
        let checks = good().with_turn(&[]).among_references(None, None, 5.0).checks;
        for Check { name, flag, .. } in &checks {
            let StoredFlag::Known(flag) = flag else { panic!("{name} raises {flag}, which is no flag") };
            assert!(flag.entry().limits.contains(&name.as_str()), "the table of flags lacks {name} as a limit of {flag}");
        }
        for flag in Flag::ALL {
            for limit in flag.entry().limits {
                assert!(checks.iter().any(|check| check.name == *limit), "{flag}: no check is named {limit}");
            }
        }
    }

    #[test]
    fn each_number_over_its_limit_raises_its_flag_alone() {
        let closure = |c: ClosureOff| of(&even(21), &strip(21), Some(c), Some(NEAR));
        let camera = |c: CalibrationOff| of(&even(21), &strip(21), Some(GOOD), Some(c));
        let seen = |omegas: &[f64], views: &[ViewStrip]| of(omegas, views, Some(GOOD), Some(NEAR));
        for moved in [
            closure(ClosureOff { overlap: 0.94, ..GOOD }),
            closure(ClosureOff { along_px: -3.1, ..GOOD }),
            closure(ClosureOff { across_px: 3.1, ..GOOD }),
            closure(ClosureOff { turn_deg: Some(-5.1), ..GOOD }),
        ] {
            assert_eq!((moved.flags(), moved.passed), (vec![Flag::Moved.into()], false));
        }
        for off in [
            camera(CalibrationOff { uy_px: 30.5, ..NEAR }),
            camera(CalibrationOff { gamma_deg: -3.1, ..NEAR }),
            camera(CalibrationOff { alpha_deg: 2.1, ..NEAR }),
        ] {
            assert_eq!(off.flags(), [Flag::CalibrationOff]);
        }
        assert_eq!(camera(CalibrationOff { is_rho_significant: true, ..NEAR }).flags(), [Flag::WrongSteps]);
        let mut views = strip(21);
        views[6].residual_px = Some(3.5);
        let found = seen(&even(21), &views);
        assert_eq!((found.flags(), found.check("residual_view_px").unwrap().view), (vec![Flag::Residual.into()], Some(6)));
        views[6] = ViewStrip { overlap_percent: Some(80.0), ..strip(1)[0].clone() };
        assert_eq!(seen(&even(21), &views).flags(), [Flag::Overlap]);
        // A view that was left out is not held against the model.
        views[6].used = false;
        assert!(seen(&even(21), &views).passed);
        assert_eq!(seen(&even(21)[..16], &strip(21)).flags(), [Flag::UnusableViews]);
        assert_eq!(seen(&even(84)[..30], &strip(30)).flags(), [Flag::FewViews]);
        let (omegas, strip) = (even(21), strip(21));
        let measured = |scatter_px, volume_sd_percent| {
            let (closure, calibration) = (Some(GOOD), Some(NEAR));
            let facts =
                TurnFacts { planned_views: 21, omegas: &omegas, strip: &strip, closure, calibration, scatter_px, volume_sd_percent };
            Quality::of(&facts, &QualitySettings::default()).flags()
        };
        let uncertain = |volume_sd_percent| measured(Some(0.2), volume_sd_percent);
        assert_eq!(
            [Some(2.1), Some(f64::NAN), Some(1.9), None].map(uncertain),
            [vec![Flag::Uncertain], vec![Flag::Uncertain], vec![], vec![]]
        );
        let scattered = |scatter_px| measured(scatter_px, Some(0.6));
        assert_eq!(
            [Some(1.1), Some(f64::NAN), Some(0.9), None].map(scattered),
            [vec![Flag::Residual], vec![Flag::Residual], vec![], vec![]]
        );
    }

    /// A reading is over its limit only by more than twice its own standard deviation. One that cannot be told from the limit says so.
    #[test]
    fn a_closure_is_over_its_limit_only_as_far_as_it_is_known() {
        let turned = |turn_deg: f64, sd_deg: Option<f64>| {
            let sd = sd_deg.map(|turn_deg| ClosureSd { turn_deg, ..KNOWN });
            let found = of(&even(21), &strip(21), Some(ClosureOff { turn_deg: Some(turn_deg), sd, ..GOOD }), Some(NEAR));
            let check = found.check("closure_turn_deg").unwrap();
            assert_eq!((check.over, check.sd), (found.raises(Flag::Moved), sd_deg.filter(|sd| sd.is_finite())));
            (check.over, check.undecided)
        };
        let (moved, stayed, unknown) = ((true, false), (false, false), (false, true));
        assert_eq!(turned(5.09, Some(1.2)), unknown);
        assert_eq!(turned(-4.0, Some(1.2)), unknown);
        assert_eq!(turned(2.0, Some(1.2)), stayed);
        assert_eq!(turned(-10.0, Some(1.2)), moved);
        assert_eq!(turned(0.0, Some(9.0)), unknown, "a specimen that is round");
        assert_eq!((turned(5.1, None), turned(4.9, None)), (moved, stayed), "of the profile's centroid nothing is known");
        assert_eq!(turned(5.1, Some(f64::NAN)), moved, "what is no number excuses nothing");
        let old = serde_json::json!({"name": "n", "unit": "px", "found": 1.0, "limit": 2.0, "over": false, "flag": "f"});
        let old: Check = serde_json::from_value(old).unwrap();
        assert!(old.sd.is_none() && !old.undecided && old.flag.as_str() == "f");
    }

    #[test]
    fn what_is_not_known_is_null_and_no_number_is_over() {
        let found = of(&even(21), &strip(21), None, None);
        assert!(found.passed && found.check("closure_turn_deg").unwrap().found.is_none());
        let found = of(&even(21), &strip(21), Some(ClosureOff { along_px: f64::NAN, ..GOOD }), None);
        assert!(!found.passed && found.raises(Flag::Moved) && found.check("closure_along_px").unwrap().found.is_none());
        serde_json::to_string(&found).unwrap();
    }

    #[test]
    fn a_place_among_references_is_a_check_like_others() {
        let found = good().among_references(Some(-5.2), Some(0.3), 5.0);
        assert_eq!((found.flags(), found.passed), (vec![Flag::VolumeOffReferences.into()], false));
        assert!(good().among_references(None, Some(4.9), 5.0).passed);
    }

    proptest! {
        /// Whatever the numbers, the flags are those of the checks that are over, and a wider limit raises none.
        #[test]
        fn a_wider_limit_raises_nothing(along in -10.0..10.0f64, uy in -60.0..60.0f64, residual in 0.0..6.0f64, wider in 1.0..5.0f64) {
            let (omegas, mut views) = (even(21), strip(21));
            views[3].residual_px = Some(residual);
            let facts = TurnFacts {
                scatter_px: Some(0.2),
                planned_views: 21,
                omegas: &omegas,
                strip: &views,
                closure: Some(ClosureOff { along_px: along, ..GOOD }),
                calibration: Some(CalibrationOff { uy_px: uy, ..NEAR }),
                volume_sd_percent: None,
            };
            let narrow = QualitySettings::default();
            let wide = QualitySettings {
                closure_along_px: wider * narrow.closure_along_px,
                uy_px: wider * narrow.uy_px,
                residual_view_px: wider * narrow.residual_view_px,
                ..narrow
            };
            let (narrow, wide) = (Quality::of(&facts, &narrow), Quality::of(&facts, &wide));
            prop_assert!(wide.flags().iter().all(|f| narrow.flags().contains(f)));
            prop_assert_eq!(narrow.passed, narrow.checks.iter().all(|c| !c.over));
            prop_assert_eq!(narrow.raises(Flag::Moved), along.abs() - 2.0 * KNOWN.along_px > 3.0);
        }
    }
}
