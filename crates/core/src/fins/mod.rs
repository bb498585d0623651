//! Fins from all views at once: the free edge of a fin is one curve in space, which every view that shows it must pass through.
//!
//! ```text
//!   slice across the capillary:        body B(theta) by the edges without fins       h
//!        ___                           ( __p                                         |      found edges of a fin: h = p . n(theta)
//!       (___)--- p                     one point p per slice and fin                 |  __/\__   one cosine, wherever it stands out
//!   edges ── points per slice ── chained along the capillary ── smoothed ── Fin ── projected into every view ── amended edges
//! ```
//! A single view misses the border of a fin that only just emerges from behind the body, and invents one at a speck. The other
//! views tell both: a fin has one free edge that all views share, and a speck has none.
//!
//! ```text
//!   responses of each view (FinBorders) ── pooled at each point of a slice ── followed along the capillary ── accepted ── Fin
//! ```
//! A fin that no single view shows is found in the same way, from the responses of all views at the points where its free edge may be.
//! `faint` leads that search. It keeps the fins of the edges, and needs the responses of every view.

mod amend;
mod body;
mod chain;
mod extend;
mod faint;
mod follow;
mod points;
mod pool;
mod taper;

use crate::calibration::{Pose, Side, Support, TurnView, directions};
use crate::geometry::Projection;
use crate::parallel::prelude::*;
use crate::profile::{Columns, FinBorders};
use body::bodies;
use points::Point;
use serde::{Deserialize, Serialize};

/// The free edge of a fin as it was found by the views together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fin {
    /// Its points, um in the frame of the turn: x along the capillary, y and z across. One point per slice, from left to right.
    pub points_um: Vec<[f64; 3]>,
    /// Number of edges of single views that stand out there, in the median of the slices.
    pub edges: usize,
}

/// Every so many slices a fin has a point in a record.
const RECORDED: usize = 8;

impl Fin {
    /// The same with every eighth point and the last one, as it is stored.
    pub(crate) fn recorded(&self) -> Self {
        let last = self.points_um.len().saturating_sub(1);
        let points = self.points_um.iter().enumerate().filter(|(i, _)| i % RECORDED == 0 || *i == last);
        Self { points_um: points.map(|(_, p)| *p).collect(), edges: self.edges }
    }

    /// Its points in a view, px to a tenth.
    pub(crate) fn seen(&self, projection: &Projection) -> Vec<[f64; 2]> {
        let tenth = |px: f64| (10.0 * px).round() / 10.0;
        self.points_um.iter().filter_map(|&p| projection.project(p)).map(|(u, v)| [tenth(u), tenth(v)]).collect()
    }
}

/// A view with what its frame shows of the body alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FinView<'a> {
    /// Edges with fins, and the pose.
    pub turn: TurnView<'a>,
    /// Edges without fins. `None` where only those with fins are known.
    pub body: Option<&'a Columns>,
    /// Where borders of fins may be. `None` where only outlines are known.
    pub borders: Option<&'a FinBorders>,
    /// The calibrated projection.
    pub projection: Projection,
}

/// One edge of one view in one slice, as a tangent. Distances are from the capillary's axis, um.
#[derive(Debug, Clone, Copy)]
struct Edge {
    theta: f64,
    found_um: f64,
    /// Of the body alone. `None` where the view shows none there.
    body_um: Option<f64>,
}

/// The edges of a slice.
#[derive(Debug, Clone)]
struct Slice {
    x_um: f64,
    edges: Vec<Edge>,
}

/// Fins with the body that they stand out of.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Found {
    pub fins: Vec<Fin>,
    /// The slices, from left to right.
    slices: Vec<Standing>,
}

/// A slice: its body and the points of its fins.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Standing {
    x_um: f64,
    body: Support,
    /// y and z, um.
    points_um: Vec<[f64; 2]>,
}

impl Found {
    /// The fins in the slice at `x_um`. `None` where there are none.
    pub fn standing(&self, x_um: f64) -> Option<&Standing> {
        Some(self.slice(x_um)?).filter(|slice| !slice.points_um.is_empty())
    }

    /// The slice nearest to `x_um`.
    fn slice(&self, x_um: f64) -> Option<&Standing> {
        let after = self.slices.partition_point(|slice| slice.x_um < x_um);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| self.slices.get(at));
        near.min_by(|a, b| (a.x_um - x_um).abs().total_cmp(&(b.x_um - x_um).abs()))
    }
}

impl Standing {
    /// How far the fins stand out of the body in direction `theta`, um: what they add to its support function.
    pub fn at(&self, theta: f64) -> f64 {
        let (sin, cos) = theta.sin_cos();
        let reach = self.points_um.iter().map(|[y, z]| y * cos + z * sin).fold(f64::NEG_INFINITY, f64::max);
        (reach - self.body.at(theta)[0]).max(0.0)
    }
}

impl Standing {
    /// The same with the points of the fins further from the body's centre.
    pub fn further_out(&self, by_um: f64) -> Self {
        let [y, z] = centre(&self.body);
        let moved = |p: &[f64; 2]| {
            let (dy, dz) = (p[0] - y, p[1] - z);
            let part = by_um / dy.hypot(dz).max(by_um);
            [p[0] + part * dy, p[1] + part * dz]
        };
        Self { points_um: self.points_um.iter().map(moved).collect(), ..self.clone() }
    }
}

/// Centre of an outline: y and z, um.
fn centre(outline: &Support) -> [f64; 2] {
    [outline.coefficients[1], outline.coefficients[2]]
}

/// An edge within this distance of a fin is that fin's, px.
const SAME_PX: f64 = 2.5;
/// Where the edges of the body are not known apart, those of fins are taken out of them this many times.
const ROUNDS: usize = 4;

/// Finds the fins that these views agree on.
pub(crate) fn find(pose: &Pose, views: &[FinView]) -> Found {
    let extents: Vec<(usize, usize)> = views.iter().filter_map(|v| v.turn.columns.extent()).collect();
    let Some((first, last)) = extents.iter().map(|e| e.0).min().zip(extents.iter().map(|e| e.1).max()) else { return Found::default() };
    let px_um = 1.0 / pose.camera().ky;
    let widest = points::widest_gap(directions(&views.iter().map(|v| v.turn.omega).collect::<Vec<_>>()));
    let mut slices: Vec<Slice> = (first..=last).into_par_iter().map(|u| Slice::of(pose.slice(u as f64), pose, views)).collect();
    let (mut round, rounds) = (0, if views.iter().all(|view| view.body.is_some()) { 0 } else { ROUNDS });
    let (bodies, points) = loop {
        let Some(bodies) = bodies(&slices, 2 * views.len(), px_um) else { return Found::default() };
        let points: Vec<_> = slices.par_iter().zip(&bodies).map(|(slice, body)| points::of(slice, body, widest, px_um)).collect();
        round += 1;
        if round > rounds {
            break (bodies, points);
        }
        slices.par_iter_mut().zip(&points).for_each(|(slice, points)| slice.without(points, px_um));
    };
    let fins = chain::chained(&slices, &points, px_um);
    let mut slices: Vec<Standing> =
        slices.iter().zip(bodies).map(|(&Slice { x_um, .. }, body)| Standing { x_um, body, points_um: Vec::new() }).collect();
    let fins = faint::find(views, &slices, fins, px_um);
    for slice in &mut slices {
        let near = |fin: &Fin| fin.points_um.iter().find(|p| (p[0] - slice.x_um).abs() < 1e-6).map(|p| [p[1], p[2]]);
        slice.points_um = fins.iter().filter_map(near).collect();
    }
    Found { fins, slices }
}

impl Slice {
    /// Takes edges that are those of fins out of the body's.
    fn without(&mut self, fins: &[Point], px_um: f64) {
        for edge in &mut self.edges {
            let (sin, cos) = edge.theta.sin_cos();
            let is_of = |fin: &Point| (fin.at_um[0] * cos + fin.at_um[1] * sin - edge.found_um).abs() < SAME_PX * px_um;
            edge.body_um = Some(edge.found_um).filter(|_| !fins.iter().any(is_of));
        }
    }

    fn of(x_um: f64, pose: &Pose, views: &[FinView]) -> Self {
        let mut edges = Vec::with_capacity(2 * views.len());
        for view in views {
            for side in Side::BOTH {
                if let Some(tangent) = pose.tangent(x_um, &view.turn, side, None) {
                    let body_um = view.body.map_or(Some(tangent.offset_um), |columns| {
                        let alone = TurnView { columns, ..view.turn };
                        pose.tangent(x_um, &alone, side, None).map(|t| t.offset_um)
                    });
                    edges.push(Edge { theta: tangent.theta, found_um: tangent.offset_um, body_um });
                }
            }
        }
        Self { x_um, edges }
    }
}
