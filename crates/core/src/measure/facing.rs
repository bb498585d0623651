//! Which side of a larva the views of its turn show.
//!
//! ```text
//!        camera                         roll_deg: how far the capillary must be turned from omega = 0
//!          |                            for the back to face the camera
//!    back  v
//!      \ .--.                           dorsal view: the view nearest to that; ventral: half a turn on;
//!       \|  |                           lateral: a quarter turn to either side
//!        '--'
//! ```
//! It rests on the shape alone: the back is where [`Dorsal`](super::shape::Dorsal) puts it, away from the belly's bulge in the
//! direction in which the slices are longest, with that confidence. Where the shape does not tell a back there is no such view.

use super::shape::{End, Shape};
use crate::geometry::Camera;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Facing {
    /// The head's end in the picture; `null` where both are alike.
    pub head: Option<End>,
    pub head_confidence: f64,
    /// By how much the capillary must be turned from omega = 0 for the back to face the camera, -180 to 180 deg.
    pub roll_deg: f64,
    /// 0 to 1, the shape's own.
    pub confidence: f64,
    /// The view that shows the back, and how far it is from showing it straight.
    pub dorsal_view: u32,
    pub dorsal_off_deg: f64,
    pub ventral_view: u32,
    /// A quarter turn before and behind the dorsal view.
    pub lateral_views: [u32; 2],
}

impl Facing {
    /// Of views by number and angle (rad); nothing where the shape tells no back, or there is no view.
    pub fn of(shape: &Shape, camera: &Camera, views: &[(u32, f64)]) -> Option<Self> {
        let body = shape.body.as_ref()?;
        let back = body.dorsal.direction?;
        let at = shape.solid.as_ref()?.centroid_um;
        let behind: [f64; 3] = std::array::from_fn(|a| at[a] + back[a]);
        // How much nearer to the camera the back is than the middle.
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
            confidence: body.dorsal.confidence,
            dorsal_view,
            dorsal_off_deg: off.to_degrees(),
            ventral_view: nearest(roll + PI)?.0,
            lateral_views: [nearest(roll - FRAC_PI_2)?.0, nearest(roll + FRAC_PI_2)?.0],
        })
    }
}
