//! Reasons to skip a well before its turn. They are found in the detection frame.

use carved_core::profile::Profile;
use carved_records::{Clipped, Policy};

/// Share of the bore from which it counts as blocked. A larva of 5 dpf covers a third, and no larva covers this much.
const BLOCKED_SHARE: f64 = 0.9;

/// Reason to skip a well for which the other program stored no picture.
pub const NO_PICTURES: &str = "no_pictures";

/// Why a well with this frame is skipped: a name of [`carved_core::profile::Kind`], `blocked` or `clipped`. `None` if it is measured.
pub fn reason(profile: &Profile, policy: &Policy) -> Option<&'static str> {
    let found = &profile.detection;
    if filled_share(profile) > BLOCKED_SHARE {
        return Some("blocked");
    }
    let clipped = found.is_clipped_left() || found.is_clipped_right();
    found.skip_reason().or_else(|| (clipped && policy.clipped == Clipped::Skip).then_some("clipped"))
}

/// Share of the bore in the picture that blocks the light.
fn filled_share(profile: &Profile) -> f64 {
    let width = profile.mask.width() as f64;
    let bore_px = profile.walls.bore_px(width / 2.0);
    profile.mask.area_px() as f64 / (bore_px * width).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::frame::{PixelFormat, RawFrame};
    use carved_core::profile::{Picture, SegmentSettings, segment};
    use hardware_sim::scene::{Exposure, Placement, Scene, SceneSettings, Specimen};

    fn profile(x_um: f64) -> Profile {
        let scene = Scene::new(SceneSettings::default());
        scene.load(Some(Specimen::larva(4, 1).unwrap().placed(Placement { x_um, ..Placement::default() }))).unwrap();
        let seen = scene.render(&Exposure { angle_rad: 0.0, number: 0 });
        let frame = RawFrame::new(seen.width, seen.height, PixelFormat::BayerRG8, seen.to_bayer_rg8()).unwrap();
        segment(&Picture::from_frame(&frame), &SegmentSettings::default()).unwrap()
    }

    #[test]
    fn a_larva_is_worth_its_turn_and_a_full_bore_is_not() {
        let mut seen = profile(0.0);
        let policy = Policy::default();
        assert_eq!(reason(&seen, &policy), None);
        assert!(filled_share(&seen) < 0.5, "{}", filled_share(&seen));
        for v in 0..seen.mask.height() {
            for u in 0..seen.mask.width() {
                let inside = seen.walls.upper.inner.at(u as f64) < v as f64 && (v as f64) < seen.walls.lower.inner.at(u as f64);
                seen.mask.set(u, v, inside);
            }
        }
        assert_eq!(reason(&seen, &policy), Some("blocked"));
    }

    #[test]
    fn a_larva_that_the_picture_cuts_is_skipped_only_where_the_method_says_so() {
        let cut = profile(2000.0);
        assert_eq!(reason(&cut, &Policy::default()), None);
        assert_eq!(reason(&cut, &Policy { clipped: Clipped::Skip, ..Policy::default() }), Some("clipped"));
    }
}
