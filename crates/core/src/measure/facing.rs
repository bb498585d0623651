//! The sides of a larva that the views of its turn show.
//!
//! ```text
//!        camera                         roll_deg: how far the capillary must be turned from omega = 0
//!          |                            for the back to face the camera
//!    back  v
//!      \ .--.                           dorsal view: the view nearest to that; ventral: half a turn on;
//!       \|  |                           lateral: a quarter turn to either side
//!        '--'
//! ```
//! The back is where [`Dorsal`](super::shape::Dorsal) puts it, with the confidence stated there: in the direction in which the slices are
//! longest, on the side away from the belly's bulge. Where both eyes are found, it is turned until the line from eye to eye runs from side to
//! side: the shape gives that direction to some degrees, the eyes of rendered larvae to less than two. Where the shape does not determine a
//! back, or the eyes lie at the other end than its head, there is no such view.

use super::shape::{Body, End, Shape};
use crate::geometry::Camera;
use crate::inside::Eyes;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Which views of a turn show the back, the belly and the sides of a larva.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Facing {
    /// End of the picture at which the head lies. `null` where both ends are alike.
    pub head: Option<End>,
    /// Confidence of the head, 0 to 1.
    pub head_confidence: f64,
    /// Angle by which the capillary must be turned from omega = 0 for the back to face the camera, -180 to 180 deg.
    pub roll_deg: f64,
    /// Confidence of the back, 0 to 1: that of the shape, raised where the eyes confirm its median plane.
    pub confidence: f64,
    /// The view that shows the back.
    pub dorsal_view: u32,
    /// Angle between that view and the back, deg.
    pub dorsal_off_deg: f64,
    /// The view that shows the belly.
    pub ventral_view: u32,
    /// The views a quarter turn before and behind the dorsal view.
    pub lateral_views: [u32; 2],
}

impl Facing {
    /// From the views' numbers and angles (rad). `None` where the shape does not determine a back, or there is no view.
    pub fn of(shape: &Shape, eyes: Option<&Eyes>, camera: &Camera, views: &[(u32, f64)]) -> Option<Self> {
        let body = shape.body.as_ref()?;
        let at = shape.solid.as_ref()?.centroid_um;
        let (back, confidence) = back(body, at, eyes)?;
        let behind: [f64; 3] = std::array::from_fn(|a| at[a] + back[a]);
        // How much nearer to the camera the back is than the middle, um.
        let towards = |omega: f64| {
            let projection = camera.projection(omega);
            projection.depth(at) - projection.depth(behind)
        };
        let roll = towards(FRAC_PI_2).atan2(towards(0.0));
        let nearest = |omega: f64| {
            let off = |x: f64| (x - omega - TAU * ((x - omega) / TAU).round()).abs();
            views.iter().map(|&(view, x)| (view, off(x))).min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let (dorsal_view, off) = nearest(roll)?;
        Some(Self {
            head: body.head.end,
            head_confidence: body.head.confidence,
            roll_deg: roll.to_degrees(),
            confidence,
            dorsal_view,
            dorsal_off_deg: off.to_degrees(),
            ventral_view: nearest(roll + PI)?.0,
            lateral_views: [nearest(roll - FRAC_PI_2)?.0, nearest(roll + FRAC_PI_2)?.0],
        })
    }
}

/// Belly shares from which on the side of the belly is meant and sure, in a median plane that the eyes confirm. Phantoms have at least 0.0099
/// there.
const BELLY_WITH_EYES: [f64; 2] = [0.004, 0.009];
/// Largest angle between the median planes of the shape and of the eyes, deg. Beyond it, what was taken for eyes may be something else.
const MOST_APART_DEG: f64 = 20.0;

/// The direction of the back, and its confidence: that of the shape, across the line from eye to eye where there are two.
fn back(body: &Body, centroid_um: [f64; 3], eyes: Option<&Eyes>) -> Option<([f64; 3], f64)> {
    let dorsal = &body.dorsal;
    let of_shape = dorsal.direction?;
    let Some([a, b]) = eyes.map(|eyes| &eyes.eyes[..]) else { return Some((of_shape, dorsal.confidence)) };
    let [a, b] = [a, b].map(|eye| Vector3::from(eye.centre_um));
    let middle = (a + b) / 2.0 - Vector3::from(centroid_um);
    let end = if middle.x < 0.0 { End::Left } else { End::Right };
    if body.head.end != Some(end) {
        return None;
    }
    let across = (b - a).try_normalize(0.0)?;
    let upright = Vector3::from(of_shape);
    let back = (upright - upright.dot(&across) * across).try_normalize(0.0)?;
    let apart_deg = back.dot(&upright).clamp(-1.0, 1.0).acos().to_degrees();
    if apart_deg > MOST_APART_DEG {
        return Some((of_shape, dorsal.confidence));
    }
    let [least, sure] = BELLY_WITH_EYES;
    let with_eyes = ((dorsal.belly_share - least) / (sure - least)).clamp(0.0, 1.0);
    Some((back.into(), dorsal.confidence.max(with_eyes)))
}
