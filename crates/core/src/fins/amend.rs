//! The edges of a view, amended by the fins that all views share.

use super::body::Known;
use super::{FinView, Found, SAME_PX, centre};
use crate::calibration::Side;
use crate::geometry::Projection;
use crate::profile::{ColumnEdges, Columns};
use std::f64::consts::PI;

/// An own edge that stands out of the view's own body by more than this is one of a fin, px.
const OWN_PX: f64 = 2.5;
/// The same where only the body by all views is known, which is a short series.
const OWN_OF_MODEL_PX: f64 = 4.0;

/// One row per column and side, px. `None` where there is none.
struct Rows([Vec<Option<f64>>; 2]);

impl Rows {
    fn new(width: usize) -> Self {
        Self([vec![None; width], vec![None; width]])
    }

    fn get(&self, u: usize, side: Side) -> Option<f64> {
        self.0[side as usize][u]
    }

    /// Adds a curve, given by its points `(u, v)` from left to right, where it lies further out than what is there.
    fn add(&mut self, points: impl Iterator<Item = (f64, f64)>, side_of: impl Fn(usize) -> Side) {
        let points: Vec<(f64, f64)> = points.collect();
        let [upper, _] = &self.0;
        let last = upper.len() as f64 - 1.0;
        for (at, pair) in points.windows(2).enumerate() {
            let ((u0, v0), (u1, v1)) = (pair[0], pair[1]);
            let side = side_of(at);
            let mut u = u0.ceil().max(0.0);
            while u <= u1.min(last) {
                let v = if u1 > u0 { v0 + (u - u0) / (u1 - u0) * (v1 - v0) } else { v0 };
                let here = &mut self.0[side as usize][u as usize];
                *here = Some(here.map_or(v, |w| if side.sign() * (v - w) > 0.0 { v } else { w }));
                u += 1.0;
            }
        }
    }
}

impl Found {
    /// The edges of a view: of the body, and of the fins where they lie further out. An edge that stands out of the body where there is no
    /// fin becomes that of the body.
    pub fn amended(&self, view: &FinView, projection: &Projection) -> Columns {
        let width = view.turn.columns.width();
        let mut fins = Rows::new(width);
        for fin in &self.fins {
            let seen = fin.points_um.iter().filter_map(|&[x, y, z]| {
                let [centre_y, centre_z] = centre(&self.slice(x)?.body);
                Some((projection.project([x, y, z])?, projection.project([x, centre_y, centre_z])?))
            });
            let (points, middles): (Vec<(f64, f64)>, Vec<(f64, f64)>) = seen.unzip();
            let side_of = |at: usize| if points[at].1 < middles[at].1 { Side::Upper } else { Side::Lower };
            fins.add(points.iter().copied(), side_of);
        }
        let bodies = self.body_of(view.turn.omega, projection, width);
        view.turn.columns.mapped(|u, own| {
            let row = |side: Side| {
                let by_all = bodies.get(u, side);
                let by_itself = view.body.and_then(|columns| columns.get(u)).map(|edges| side.of(edges));
                // What all views see is the body where the view's own one stands out of it, as at a speck.
                let is_off = |row: f64| by_all.is_some_and(|body| side.sign() * (row - body) > OWN_OF_MODEL_PX);
                let (body, least_px) = match by_itself.filter(|row| !is_off(*row)) {
                    Some(row) => (Some(row), OWN_PX),
                    None => (by_all, OWN_OF_MODEL_PX),
                };
                amended(side, side.of(own), body, fins.get(u, side), least_px)
            };
            let (upper, lower) = (row(Side::Upper), row(Side::Lower));
            if upper > lower {
                return own;
            }
            // What an edge leaves behind when it moves inwards was part of the gap.
            let inwards = (upper - own.upper).max(0.0) + (own.lower - lower).max(0.0);
            ColumnEdges { upper, lower, gap: (own.gap - inwards).max(0.0) }
        })
    }

    /// The edges of the body by all views in a view at angle `omega` (rad).
    fn body_of(&self, omega: f64, projection: &Projection, width: usize) -> Rows {
        let mut rows = Rows::new(width);
        for side in Side::BOTH {
            let theta = if side == Side::Upper { PI } else { 0.0 } - omega;
            let (sin, cos) = theta.sin_cos();
            let touch = self.slices.iter().filter(|slice| slice.known == Known::Body).filter_map(|slice| {
                let [h, slope] = slice.body.at(theta);
                projection.project([slice.x_um, h * cos - slope * sin, h * sin + slope * cos])
            });
            rows.add(touch, |_| side);
        }
        rows
    }
}

/// The edge of a view in a column. `own` is what the view shows, `body` its body, `fin` the fins of all views, as rows in px; an own
/// edge that stands out of the body by more than `least_px` is one of a fin.
fn amended(side: Side, own: f64, body: Option<f64>, fin: Option<f64>, least_px: f64) -> f64 {
    let out = |row: f64, of: f64| side.sign() * (row - of);
    // The joint edge of a fin is better known than that of a single view, be it further out or in.
    let joint = fin.filter(|&fin| out(fin, own) > 0.0 || (fin - own).abs() < SAME_PX);
    match body {
        None => joint.unwrap_or(own),
        Some(body) if out(own, body) > least_px => fin.filter(|&fin| out(fin, body) > 0.0).unwrap_or(body),
        Some(_) => fin.filter(|&fin| out(fin, own) > 0.0).unwrap_or(own),
    }
}
