//! The operator's word against the mark's way.
//!
//! ```text
//!   said near, goes down at the first view ── sense as recorded        said top, seen below the axis ── upside down
//!   said near, goes up                     ── the other                said left, seen right         ── left for right
//!                                           one of the two: a mirror image; both: turned by half a turn, which is none
//! ```

use super::{MarkError, MarkTrack};
use crate::geometry::Camera;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    Near,
    Far,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    Top,
    Bottom,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    Left,
    Right,
}

/// Where the mark is at the first view to an eye where the camera stands, upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MarkSighting {
    pub depth: Depth,
    pub edge: Edge,
    pub end: End,
}

/// What the mark tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Positive omega, as recorded, moves the near wall to larger v.
    pub sense_agrees: bool,
    /// The picture shows left for right; top for bottom.
    pub left_for_right: bool,
    pub upside_down: bool,
    /// By how much the mark is seen further out where the word makes it near, and what perspective makes of that, where this bears the
    /// word out. `None` where a tilt could do as much.
    pub perspective_px: Option<[f64; 2]>,
    /// Where the mark is at the first view, in radii: down the picture, and towards the camera.
    pub down: f64,
    pub near: f64,
    /// The outer radius that the mark goes around with.
    pub radius_um: f64,
}

impl Verdict {
    pub fn mirrored(&self) -> bool {
        self.left_for_right != self.upside_down
    }
}

/// Nearer to the border of two quarters an eye is not sure.
const SURE_DEG: f64 = 15.0;
/// The same of left and right, share of the picture's width.
const SURE_SHARE: f64 = 0.05;
/// What the capillary may be tilted by, deg: depth then moves the mark along u too.
const TILT_DEG: f64 = 1.0;
/// Perspective must be larger than tilt by this.
const CLEAR: f64 = 1.2;
/// Standard deviations within which a shift is what is expected.
const WITHIN_SD: f64 = 4.0;
const CLOSURE_MOST_PX: f64 = 5.0;

/// `first` is the angle of the view that the operator looked at; `back_px` how far beside its first place the mark is after a turn.
///
/// # Errors
/// Names what an eye or the picture cannot tell, and a word that the perspective contradicts.
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
    // Nearer by the radius is further out by radius / f; the word says on which half of the turn that is.
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
