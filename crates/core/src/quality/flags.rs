//! The flags that the measurement of a turn raises.
//!
//! ```text
//!   views, hull, calibration (FlagFacts) ──┐
//!   checks that are over their limit ──────┴── flags      each once, in a fixed order
//! ```

use super::checks::Quality;
use crate::calibration::VrvVerdict;
use crate::flag::{Flag, StoredFlag};

/// What the flags rest on beside the checks.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::struct_excessive_bools, reason = "facts that do not exclude one another")]
pub(crate) struct FlagFacts {
    /// Whether a view was left out.
    pub has_bad_view: bool,
    /// Whether the specimen extends beyond the image on the left and on the right, in a view that carved.
    pub is_clipped: [bool; 2],
    /// Whether the hull reaches the end of the voxel box.
    pub touches_box: bool,
    /// Whether more than half of the views that carved show something else than one specimen.
    pub is_not_one: bool,
    /// Whether the scale of the camera contradicts the bore of its glass.
    pub is_off_scale: bool,
    /// Whether the calibration found that the specimen moved during the turn.
    pub has_moved: bool,
    /// Whether the specimen is a sphere, whose turn the edges never show and whose numbers no turn changes.
    pub is_sphere: bool,
    /// Whether the view at 360 deg and the view at 0 deg both have a profile.
    pub has_closure: bool,
    /// Whether the voxels' numbers are given because slices are not convex.
    pub is_nonconvex: bool,
    /// Whether the voxels' numbers are given for another reason: the slices' outlines, or the standard deviation, could not be computed.
    pub is_uncertain: bool,
    /// Whether the specimen may have fins, and the fins that the views show are shorter than half of it.
    pub misses_fins: bool,
    /// The VRV check of the turn's calibration. `None` where the turn is measured with the rig's camera.
    pub vrv: Option<VrvVerdict>,
}

/// The flags that the facts and the checks raise, each once.
pub(crate) fn flags(facts: &FlagFacts, quality: &Quality) -> Vec<StoredFlag> {
    let mut flags = Vec::new();
    let mut raise = |raised: bool, flag: Flag| {
        if raised {
            flags.push(flag.into());
        }
    };
    raise(facts.has_bad_view, Flag::BadView);
    raise(facts.is_clipped[0], Flag::ClippedLeft);
    raise(facts.is_clipped[1], Flag::ClippedRight);
    raise(facts.touches_box, Flag::OutsideBox);
    raise(facts.is_not_one, Flag::NotOneSpecimen);
    raise(facts.is_off_scale, Flag::ScaleOffBore);
    raise(quality.raises(Flag::FewViews), Flag::FewViews);
    let moved = quality.raises(Flag::Moved) || facts.has_moved;
    raise(moved, Flag::Moved);
    raise(quality.is_undecided() && !moved && !facts.is_sphere, Flag::ClosureUndecided);
    raise(!facts.has_closure, Flag::NoClosure);
    raise(facts.is_nonconvex, Flag::Nonconvex);
    raise(facts.is_uncertain, Flag::Uncertain);
    raise(facts.misses_fins, Flag::FinsUnseen);
    raise(facts.vrv.is_none(), Flag::Uncalibrated);
    raise(facts.vrv == Some(VrvVerdict::NotLargest), Flag::CalibrationGate);
    raise(quality.raises(Flag::WrongSteps), Flag::WrongSteps);
    add_raised(&mut flags, quality);
    flags
}

/// Adds the flags that the checks raise and that are not there yet.
pub(crate) fn add_raised(flags: &mut Vec<StoredFlag>, quality: &Quality) {
    for flag in quality.flags() {
        if !flags.contains(&flag) {
            flags.push(flag);
        }
    }
}

/// Views with a profile that a plan of so many views needs. Opposite views are mirror images: half a turn encloses the body, less
/// leaves the hull open on a side.
pub(crate) fn views_needed(planned: u32) -> usize {
    (planned as usize).div_ceil(2).max(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::Check;

    const GOOD: FlagFacts = FlagFacts {
        has_bad_view: false,
        is_clipped: [false; 2],
        touches_box: false,
        is_not_one: false,
        is_off_scale: false,
        has_moved: false,
        is_sphere: false,
        has_closure: true,
        is_nonconvex: false,
        is_uncertain: false,
        misses_fins: false,
        vrv: Some(VrvVerdict::Passed),
    };

    fn raised(facts: &FlagFacts) -> Vec<StoredFlag> {
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
                flag: Flag::Moved.into(),
            }],
            passed: true,
        };
        assert_eq!(flags(&GOOD, &closure(-6.0)), [Flag::ClosureUndecided]);
        assert!(flags(&GOOD, &closure(-4.0)).is_empty());
        assert!(flags(&FlagFacts { is_sphere: true, ..GOOD }, &closure(6.0)).is_empty());
        assert_eq!(flags(&FlagFacts { has_moved: true, ..GOOD }, &closure(6.0)), [Flag::Moved]);
    }

    #[test]
    fn a_good_specimen_has_no_flag_and_each_fact_has_its_own() {
        assert!(raised(&GOOD).is_empty());
        for (facts, flag) in [
            (FlagFacts { has_bad_view: true, ..GOOD }, Flag::BadView),
            (FlagFacts { is_clipped: [true, false], ..GOOD }, Flag::ClippedLeft),
            (FlagFacts { is_clipped: [false, true], ..GOOD }, Flag::ClippedRight),
            (FlagFacts { touches_box: true, ..GOOD }, Flag::OutsideBox),
            (FlagFacts { is_not_one: true, ..GOOD }, Flag::NotOneSpecimen),
            (FlagFacts { is_off_scale: true, ..GOOD }, Flag::ScaleOffBore),
            (FlagFacts { has_moved: true, ..GOOD }, Flag::Moved),
            (FlagFacts { has_closure: false, ..GOOD }, Flag::NoClosure),
            (FlagFacts { is_nonconvex: true, ..GOOD }, Flag::Nonconvex),
            (FlagFacts { is_uncertain: true, ..GOOD }, Flag::Uncertain),
            (FlagFacts { misses_fins: true, ..GOOD }, Flag::FinsUnseen),
            (FlagFacts { vrv: None, ..GOOD }, Flag::Uncalibrated),
            (FlagFacts { vrv: Some(VrvVerdict::NotLargest), ..GOOD }, Flag::CalibrationGate),
        ] {
            assert_eq!(raised(&facts), [flag]);
        }
    }

    #[test]
    fn what_two_rules_raise_is_one_flag() {
        let check = |flag| Check::at_most("name", "px", flag, Some(2.0), 1.0);
        let quality = Quality::new(vec![check(Flag::Moved), check(Flag::Residual), check(Flag::Residual)]);
        assert_eq!(flags(&FlagFacts { has_moved: true, ..GOOD }, &quality), [Flag::Moved, Flag::Residual]);
    }

    #[test]
    fn half_of_the_planned_views_are_needed() {
        assert_eq!([4, 7, 21, 84].map(views_needed), [3, 4, 11, 42]);
    }
}
