//! The flags of a specimen: one word each for what an operator must know of its numbers.
//!
//! ```text
//!   views, hull, calibration (FlagFacts) ──┐
//!   checks that are over their limit ──────┴── flags      each once, in a fixed order
//! ```

use super::checks::Quality;
use crate::calibration::VrvVerdict;

/// Difference between the views' median blur and the configured one from which on the flag is raised, px. From specimen to
/// specimen the blur varies by 0.07 px. Each edge is placed at the blur of its own frame, so that the flag only says that the
/// focus has changed.
const BLUR_MISMATCH_PX: f64 = 0.15;

/// What the flags rest on beside the checks.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::struct_excessive_bools, reason = "facts that do not exclude one another")]
pub(crate) struct FlagFacts<'a> {
    /// Whether a view was left out.
    pub has_bad_view: bool,
    /// Whether the specimen extends beyond the image on the left and on the right, in a view that carved.
    pub is_clipped: [bool; 2],
    /// Whether the hull reaches the end of the voxel box.
    pub touches_box: bool,
    /// Whether the calibration found that the specimen moved during the turn.
    pub has_moved: bool,
    /// Whether the specimen is a sphere, whose turn the edges never show and whose numbers no turn changes.
    pub is_sphere: bool,
    /// Whether the view at 360 deg and the view at 0 deg both have a profile.
    pub has_closure: bool,
    /// For each view that counts and has a detection: whether the larva looks dead in it.
    pub looks_dead: &'a [bool],
    /// Blur of each view that tells one, px.
    pub blurs_px: &'a [f64],
    /// Blur that the method configures, px.
    pub configured_blur_px: f64,
    /// Whether the voxels' numbers are given because slices are not convex.
    pub is_nonconvex: bool,
    /// Whether the specimen may have fins, and the fins that the views show are shorter than half of it.
    pub misses_fins: bool,
    /// The VRV check of the turn's calibration. `None` where the turn is measured with the rig's camera.
    pub vrv: Option<VrvVerdict>,
}

/// The flags that the facts and the checks raise, each once.
pub(crate) fn flags(facts: &FlagFacts, quality: &Quality) -> Vec<String> {
    let mut flags = Vec::new();
    let mut flag = |raised: bool, name: &str| {
        if raised {
            flags.push(name.to_owned());
        }
    };
    flag(facts.has_bad_view, "bad_view");
    flag(facts.is_clipped[0], "clipped_left");
    flag(facts.is_clipped[1], "clipped_right");
    flag(facts.touches_box, "outside_box");
    flag(quality.raises("few_views"), "few_views");
    let moved = quality.raises("moved") || facts.has_moved;
    flag(moved, "moved");
    flag(quality.is_undecided() && !moved && !facts.is_sphere, "closure_undecided");
    flag(!facts.has_closure, "no_closure");
    flag(most(facts.looks_dead), "dead_looking");
    flag(is_blur_off(facts.blurs_px, facts.configured_blur_px), "blur_mismatch");
    flag(facts.is_nonconvex, "nonconvex");
    flag(facts.misses_fins, "fins_unseen");
    flag(facts.vrv.is_none(), "uncalibrated");
    flag(facts.vrv == Some(VrvVerdict::NotLargest), "calibration_gate");
    flag(quality.raises("wrong_steps"), "wrong_steps");
    add_raised(&mut flags, quality);
    flags
}

/// Adds the flags that the checks raise and that are not there yet.
pub(crate) fn add_raised(flags: &mut Vec<String>, quality: &Quality) {
    for name in quality.flags() {
        if !flags.iter().any(|f| f == name) {
            flags.push(name.to_owned());
        }
    }
}

/// Views with a profile that a plan of so many views needs. Opposite views are mirror images: half a turn encloses the body, less
/// leaves the hull open on a side.
pub(crate) fn views_needed(planned: u32) -> usize {
    (planned as usize).div_ceil(2).max(3)
}

fn most(answers: &[bool]) -> bool {
    2 * answers.iter().filter(|yes| **yes).count() > answers.len()
}

fn is_blur_off(found_px: &[f64], configured_px: f64) -> bool {
    let mut found = found_px.to_vec();
    found.sort_by(f64::total_cmp);
    found.get(found.len() / 2).is_some_and(|median| (median - configured_px).abs() > BLUR_MISMATCH_PX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::Check;

    const GOOD: FlagFacts = FlagFacts {
        has_bad_view: false,
        is_clipped: [false; 2],
        touches_box: false,
        has_moved: false,
        is_sphere: false,
        has_closure: true,
        looks_dead: &[false, true, false],
        blurs_px: &[1.0, 1.1, 2.0],
        configured_blur_px: 1.1,
        is_nonconvex: false,
        misses_fins: false,
        vrv: Some(VrvVerdict::Passed),
    };

    fn raised(facts: &FlagFacts) -> Vec<String> {
        flags(facts, &Quality::default())
    }

    /// A closure that is within its limit and only shows little is no sign of a movement.
    #[test]
    fn a_closure_over_its_limit_by_less_than_two_sd_is_flagged_except_for_a_sphere() {
        let closure = |found: f64| Quality {
            checks: vec![Check {
                name: "closure_turn_deg".into(),
                unit: "deg".into(),
                found: Some(found),
                sd: Some(2.0),
                limit: 5.0,
                view: None,
                over: false,
                undecided: true,
                flag: "moved".into(),
            }],
            passed: true,
        };
        assert_eq!(flags(&GOOD, &closure(-6.0)), ["closure_undecided"]);
        assert!(flags(&GOOD, &closure(-4.0)).is_empty());
        assert!(flags(&FlagFacts { is_sphere: true, ..GOOD }, &closure(6.0)).is_empty());
        assert_eq!(flags(&FlagFacts { has_moved: true, ..GOOD }, &closure(6.0)), ["moved"]);
    }

    #[test]
    fn a_good_specimen_has_no_flag_and_each_fact_has_its_own() {
        assert!(raised(&GOOD).is_empty());
        for (facts, name) in [
            (FlagFacts { has_bad_view: true, ..GOOD }, "bad_view"),
            (FlagFacts { is_clipped: [true, false], ..GOOD }, "clipped_left"),
            (FlagFacts { is_clipped: [false, true], ..GOOD }, "clipped_right"),
            (FlagFacts { touches_box: true, ..GOOD }, "outside_box"),
            (FlagFacts { has_moved: true, ..GOOD }, "moved"),
            (FlagFacts { has_closure: false, ..GOOD }, "no_closure"),
            (FlagFacts { looks_dead: &[true, true, false], ..GOOD }, "dead_looking"),
            (FlagFacts { configured_blur_px: 0.9, ..GOOD }, "blur_mismatch"),
            (FlagFacts { is_nonconvex: true, ..GOOD }, "nonconvex"),
            (FlagFacts { misses_fins: true, ..GOOD }, "fins_unseen"),
            (FlagFacts { vrv: None, ..GOOD }, "uncalibrated"),
            (FlagFacts { vrv: Some(VrvVerdict::NotLargest), ..GOOD }, "calibration_gate"),
        ] {
            assert_eq!(raised(&facts), [name]);
        }
        assert!(raised(&FlagFacts { looks_dead: &[], blurs_px: &[], ..GOOD }).is_empty(), "nothing is known of them");
    }

    #[test]
    fn what_two_rules_raise_is_one_flag() {
        let check = |flag: &str| Check::at_most("name", "px", flag, Some(2.0), 1.0);
        let quality = Quality::new(vec![check("moved"), check("residual"), check("residual")]);
        assert_eq!(flags(&FlagFacts { has_moved: true, ..GOOD }, &quality), ["moved", "residual"]);
    }

    #[test]
    fn half_of_the_planned_views_are_needed() {
        assert_eq!([4, 7, 21, 84].map(views_needed), [3, 4, 11, 42]);
    }
}
