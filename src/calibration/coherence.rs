//! Area coherence: the mean overlap of profile and re-projected hull.
//!
//! ```text
//!   slice x ── a strip per view, between its two edges ── cut: a polygon ── its width in each view, over the strip's
//!
//!   overlap of a view = sum over slices of the polygon's width / sum of the strip's        coherence = mean over views
//! ```
//! With no miss allowed the hull seen again lies within every profile, so this is their intersection over their union. It is exact
//! for profiles without gaps up to the rays' spread within a slice (they lean by less than a hundredth); each edge is read in the
//! column that sees the slice on the axis, which for a roll of 1 deg and an edge 300 um away is off by a pixel along the edge.

use super::psi::Psi;
use super::tangents::{Pose, Side, TurnView};
use crate::profile::Columns;
use rayon::prelude::*;

/// Slices that are looked at.
const SLICES: usize = 160;
/// Half the side of the square that the strips are cut from: no capillary is wider.
const FAR_UM: f64 = 1e4;

/// A half plane: direction of its outward normal as cosine and sine, and its distance from the axis.
type Edge = ([f64; 2], f64);

/// 1 where every edge of every profile touches the hull; 0 where nothing is left.
pub fn coherence(columns: &[&Columns], psi: &Psi) -> f64 {
    let pose = Pose::new(&psi.camera);
    let views: Vec<TurnView> = columns
        .iter()
        .zip(psi.omega.iter().zip(&psi.dy_px))
        .map(|(&columns, (&omega, &dy_px))| TurnView { columns, omega, dy_px })
        .collect();
    let extents: Vec<(usize, usize)> = columns.iter().filter_map(|c| c.extent()).collect();
    let Some(from) = extents.iter().map(|e| e.0).min() else { return 0.0 };
    let to = extents.iter().map(|e| e.1).max().unwrap_or(from);
    let step = (to - from) as f64 / SLICES as f64;
    // Hull and strip per view, of every slice; summed up in order, so that the number of threads changes no bit.
    let slices: Vec<Vec<[f64; 2]>> =
        (0..SLICES).into_par_iter().map(|i| widths(&pose, &views, pose.slice(from as f64 + (i as f64 + 0.5) * step))).collect();
    let overlap = |view: usize| {
        let [hull, strip] = slices.iter().fold([0.0; 2], |sum, slice| [sum[0] + slice[view][0], sum[1] + slice[view][1]]);
        // A view that shows nothing leaves nothing of the others.
        if strip > 0.0 { hull / strip } else { 0.0 }
    };
    (0..views.len()).map(overlap).sum::<f64>() / views.len() as f64
}

/// Width of a slice's hull and of its strip in each view.
fn widths(pose: &Pose, views: &[TurnView], x_um: f64) -> Vec<[f64; 2]> {
    let strips: Vec<Option<[Edge; 2]>> = views
        .iter()
        .map(|view| {
            let edge = |side: Side| {
                let tangent = pose.tangent(x_um, view, side, None)?;
                Some(([tangent.theta.cos(), tangent.theta.sin()], tangent.offset_um))
            };
            Some([edge(Side::Upper)?, edge(Side::Lower)?])
        })
        .collect();
    let mut polygon = if strips.iter().all(Option::is_some) {
        vec![[-FAR_UM, -FAR_UM], [FAR_UM, -FAR_UM], [FAR_UM, FAR_UM], [-FAR_UM, FAR_UM]]
    } else {
        Vec::new()
    };
    let mut kept = Vec::new();
    for edge in strips.iter().flatten().flatten() {
        cut(&polygon, edge, &mut kept);
        std::mem::swap(&mut polygon, &mut kept);
    }
    let reach = |([cos, sin], _): &Edge| polygon.iter().map(|[y, z]| y * cos + z * sin).fold(f64::NEG_INFINITY, f64::max);
    strips
        .iter()
        .map(|strip| match strip {
            Some([a, b]) if !polygon.is_empty() => [reach(a) + reach(b), a.1 + b.1],
            Some([a, b]) => [0.0, a.1 + b.1],
            None => [0.0; 2],
        })
        .collect()
}

/// The part of a convex polygon on the inner side of an edge.
fn cut(polygon: &[[f64; 2]], ([cos, sin], offset): &Edge, kept: &mut Vec<[f64; 2]>) {
    kept.clear();
    let beyond = |p: &[f64; 2]| p[0] * cos + p[1] * sin - offset;
    for (i, p) in polygon.iter().enumerate() {
        let q = &polygon[(i + 1) % polygon.len()];
        let (a, b) = (beyond(p), beyond(q));
        if a <= 0.0 {
            kept.push(*p);
        }
        if (a <= 0.0) != (b <= 0.0) {
            let share = a / (a - b);
            kept.push([p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])]);
        }
    }
}
