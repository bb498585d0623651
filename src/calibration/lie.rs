//! How a view's profile lies on a model that it had no part in: the closure view against the first.
//!
//! ```text
//!   edges of the view ── distance from each slice's support function ── robust fit ── px down, px along, rad of turn, and what is left
//! ```

use super::screen::{off, row};
use super::support::Support;
use super::tangents::{Pose, Side, TurnView};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// How far a profile lies from the model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lie {
    /// To the right in the image, px.
    pub along_px: f64,
    /// Down the image, px.
    pub across_px: f64,
    /// About the capillary's axis, rad.
    pub turn_rad: f64,
    /// Distance of its edges from the model's, px; robust.
    pub rms_px: f64,
}

/// Nothing where the view shows none of the slices.
pub fn lie<'a>(pose: &Pose, view: &TurnView, slices: impl Iterator<Item = (f64, &'a Support)>) -> Option<Lie> {
    let ky = pose.camera().ky;
    let mut rows: Vec<(Vector3<f64>, f64)> = Vec::new();
    for (x_um, support) in slices {
        for side in Side::BOTH {
            let Some(tangent) = pose.tangent(x_um, view, side, Some(support)) else { continue };
            let [h_um, slope_um] = support.at(tangent.theta);
            rows.push((row(side.sign(), tangent.edge_slope, slope_um * ky), (tangent.offset_um - h_um) * ky));
        }
    }
    let found = off(&rows);
    (!rows.is_empty()).then_some(Lie { along_px: found.dx_px, across_px: found.dy_px, turn_rad: found.turn, rms_px: found.rms_px })
}
