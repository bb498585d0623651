//! Single views at other angles than their own, against the slices that all other views give.
//!
//! ```text
//!   tangents of the other views ── slices (support functions) ──┐
//!   edges of one view ── turned by 0, 5, 10, .. 355 deg ────────┴── distance: least at its own angle, if it belongs there
//! ```
//! A view from the other side shows the same outline upside down. So a view that is upside down fits half a turn away.

use super::Side;
use super::screen::trimmed_rms;
use super::slices::{Fit, Slice, fit, harmonics};
use super::support::Support;
use super::tangents::{Pose, TurnView};
use crate::geometry::Camera;
use crate::parallel::prelude::*;
use crate::statistics::median;
use std::f64::consts::{PI, TAU};

/// Most slices that are compared.
const SLICES: usize = 48;
/// Least slices that tell.
const SLICES_LEAST: usize = 8;
/// Angles at which each view is tried.
const ANGLES: usize = 72;

/// A view at its own angle, and at the angle where it fits the other views best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placed {
    /// Distance of its edges from those that the other views make expected, px: root of the mean square without the largest 5 %.
    pub own_px: f64,
    /// The same at the angle at which it is least, px.
    pub best_px: f64,
    /// That angle minus its own, rad, from -pi to pi.
    pub off_rad: f64,
}

/// Places each view among the others. `counts` says of each view whether the slices may rest on it. `None` for a view that cannot be compared.
pub(crate) fn placed(camera: &Camera, views: &[TurnView], counts: &[bool]) -> Vec<Option<Placed>> {
    let pose = Pose::new(camera);
    let xs = places(&pose, views);
    (0..views.len())
        .into_par_iter()
        .map(|view| {
            let others: Vec<TurnView> = (0..views.len()).filter(|&i| i != view && counts[i]).map(|i| views[i]).collect();
            let slices = fitted(&pose, &others, &xs);
            if slices.len() < SLICES_LEAST {
                return None;
            }
            let at = |off_rad: f64| distance_px(&pose, &slices, &TurnView { omega: views[view].omega + off_rad, ..views[view] });
            let own_px = at(0.0);
            let tried = (1..ANGLES).map(|step| TAU * step as f64 / ANGLES as f64).map(|off_rad| (at(off_rad), off_rad));
            let (best_px, off_rad) = tried.fold((own_px, 0.0), |best, next| if next.0 < best.0 { next } else { best });
            own_px.is_finite().then_some(Placed { own_px, best_px, off_rad: if off_rad > PI { off_rad - TAU } else { off_rad } })
        })
        .collect()
}

/// Places of the slices, um.
fn places(pose: &Pose, views: &[TurnView]) -> Vec<f64> {
    let extents: Vec<(usize, usize)> = views.iter().filter_map(|v| v.columns.extent()).collect();
    let middle = |of: fn(&(usize, usize)) -> usize| median(extents.iter().map(|e| of(e) as f64).collect());
    let (from, to) = (middle(|e| e.0), middle(|e| e.1));
    let count = ((to - from) as usize).min(SLICES);
    (0..count).map(|i| pose.slice(from + (to - from) * (i as f64 + 0.5) / count as f64)).collect()
}

/// The slices with the support functions nearest to the views.
fn fitted(pose: &Pose, views: &[TurnView], xs: &[f64]) -> Vec<(Slice, Fit)> {
    let omegas: Vec<f64> = views.iter().map(|v| v.omega).collect();
    let series = harmonics(&omegas);
    let fitted = |x_um: f64, support: Option<&Support>| {
        let slice = Slice::of(x_um, pose, views, support).ok()?;
        let fit = fit(&slice, series, 1.0, 0).ok()?;
        Some((slice, fit))
    };
    // The second pass reads the columns in which the tangents touch.
    xs.iter().filter_map(|&x_um| fitted(x_um, Some(&fitted(x_um, None)?.1.support))).collect()
}

/// Distance of the edges of a view from the slices, px. Infinite for a view that shows less than half of their edges.
fn distance_px(pose: &Pose, slices: &[(Slice, Fit)], view: &TurnView) -> f64 {
    let residual = |(slice, fit): &(Slice, Fit), side: Side| {
        let tangent = pose.tangent(slice.x_um, view, side, Some(&fit.support))?;
        Some(tangent.offset_um - fit.support.at(tangent.theta)[0])
    };
    let residuals: Vec<f64> = slices.iter().flat_map(|slice| Side::BOTH.map(|side| residual(slice, side))).flatten().collect();
    if residuals.len() < slices.len() { f64::INFINITY } else { trimmed_rms(residuals.into_iter()) * pose.camera().ky }
}
