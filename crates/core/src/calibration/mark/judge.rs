//! The operator's sighting of the mark, compared with the track of the mark.
//!
//! ```text
//!   said near, goes down at the first view ── sense as recorded        said top, seen below the axis ── upside down
//!   said near, goes up                     ── the other                said left, seen right         ── left for right
//!                                           one of the two: a mirror image; both: turned by half a turn, which is none
//! ```

use super::{MarkError, MarkTrack};
use crate::geometry::Camera;

/// Whether something is in the half towards the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// In the half towards the camera.
    Near,
    /// In the half away from the camera.
    Far,
}

/// Whether something is in the upper or the lower half.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// Above the axis.
    Top,
    /// Below the axis.
    Bottom,
}

/// Whether something is to the left or to the right of the picture's middle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// To the left.
    Left,
    /// To the right.
    Right,
}

/// Where the operator sees the mark at the first view, with the eye at the camera, upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MarkSighting {
    /// Near or far.
    pub depth: Depth,
    /// Above or below.
    pub edge: Edge,
    /// Left or right.
    pub end: End,
}

/// What the mark says of the sense of rotation and of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Whether positive omega, as recorded, moves the near wall to larger v.
    pub sense_agrees: bool,
    /// Whether the picture has left and right exchanged.
    pub left_for_right: bool,
    /// Whether the picture has top and bottom exchanged.
    pub upside_down: bool,
    /// How much further from the picture's middle the mark is seen while the sighting makes it near, px; and how much the
    /// perspective makes expected, px. `None` where a tilt of the capillary could have the same effect.
    pub perspective_px: Option<[f64; 2]>,
    /// Place of the mark at the first view, down the picture, in radii.
    pub down: f64,
    /// Place of the mark at the first view, towards the camera, in radii.
    pub near: f64,
    /// Radius of the circle on which the mark goes, um: the outer radius of the glass.
    pub radius_um: f64,
}

impl Verdict {
    /// Whether the picture is a mirror image: one of the two exchanges, not both.
    pub fn mirrored(&self) -> bool {
        self.left_for_right != self.upside_down
    }
}

/// An eye is not sure of a mark that is nearer than this to the border of two quarters, deg.
const SURE_DEG: f64 = 15.0;
/// The same of left and right, as a share of the picture's width.
const SURE_SHARE: f64 = 0.05;
/// Tilt that a capillary may have, deg. The depth then moves the mark along u, too.
const TILT_DEG: f64 = 1.0;
/// The perspective must exceed the effect of the tilt by this factor.
const CLEAR: f64 = 1.2;
/// Standard deviations within which a shift agrees with the expected one.
const WITHIN_SD: f64 = 4.0;
const CLOSURE_MOST_PX: f64 = 5.0;

/// Compares the sighting with the track. `first` is the angle (rad) of the view that the operator looked at. `back_px` is the
/// distance of the mark from its first place after one turn, px; `None` where there is no such view.
///
/// # Errors
/// Names what an eye or the picture cannot distinguish, and a sighting that the perspective contradicts.
pub fn judge(track: &MarkTrack, camera: &Camera, first: f64, said: MarkSighting, back_px: Option<f64>) -> Result<Verdict, MarkError> {
    if let Some(found_px) = back_px.filter(|px| *px > CLOSURE_MOST_PX) {
        return Err(MarkError::Closure { found_px, most_px: CLOSURE_MOST_PX });
    }
    let [down, near] = track.at(first);
    for (of_border, between) in [(down, "the upper and the lower half"), (near, "the near and the far half")] {
        let found_deg = of_border.clamp(-1.0, 1.0).asin().to_degrees().abs();
        if found_deg < SURE_DEG {
            return Err(MarkError::Between { between, found_deg, least_deg: SURE_DEG });
        }
    }
    let width = f64::from(camera.width);
    let from_middle = track.u_px - (width - 1.0) / 2.0;
    if from_middle.abs() < SURE_SHARE * width {
        return Err(MarkError::Middle { found_px: from_middle.abs(), least_px: SURE_SHARE * width });
    }
    let sense_agrees = (near > 0.0) == (said.depth == Depth::Near);
    let radius_um = track.amplitude_px() / camera.ky;
    // A mark that is nearer by the radius is seen further out by radius / f. The sighting says on which half of the turn this
    // is.
    let beside = track.u_px - camera.ux;
    let expected_px = beside.abs() * radius_um / camera.f;
    let found_px = beside.signum() * if sense_agrees { track.out_px } else { -track.out_px };
    let by_tilt = camera.kx * radius_um * TILT_DEG.to_radians().sin();
    let unsure = by_tilt + WITHIN_SD * track.out_sd_px;
    let tells = expected_px > CLEAR * by_tilt && expected_px > WITHIN_SD * track.out_sd_px;
    let fits = |px: f64| (found_px - px).abs() < unsure;
    if tells && fits(-expected_px) && !fits(expected_px) {
        let said = if said.depth == Depth::Near { "near" } else { "far" };
        return Err(MarkError::Contradiction { said, found_px, expected_px });
    }
    Ok(Verdict {
        sense_agrees,
        left_for_right: (from_middle < 0.0) != (said.end == End::Left),
        upside_down: (down < 0.0) != (said.edge == Edge::Top),
        perspective_px: (tells && fits(expected_px)).then_some([found_px, expected_px]),
        down,
        near: if sense_agrees { near } else { -near },
        radius_um,
    })
}
