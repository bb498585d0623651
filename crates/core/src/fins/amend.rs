//! The edges of a view, amended by the fins that all views share.

use super::body::Known;
use super::{FinView, SAME_PX, SharedFins, centre};
use crate::calibration::Side;
use crate::geometry::Lookup;
use crate::profile::{ColumnEdges, Columns};
use std::collections::BTreeSet;
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

    /// What lies between the rows of a column.
    fn between(&self, u: usize) -> Option<ColumnEdges> {
        let (upper, lower) = (self.get(u, Side::Upper)?, self.get(u, Side::Lower)?);
        Some(ColumnEdges { upper, lower, gap: 0.0 })
    }

    /// Adds a row where it lies further out than what is there.
    fn add(&mut self, u: usize, v: f64, side: Side) {
        let here = &mut self.0[side as usize][u];
        *here = Some(here.map_or(v, |w| if side.sign() * (v - w) > 0.0 { v } else { w }));
    }
}

impl SharedFins {
    /// The edges of a view: of the body, and of the fins where they lie further out. An edge that stands out of the body where there is no
    /// fin becomes that of the body. Columns beyond the ends that the view shows have edges where they lie between fins.
    pub fn amended(&self, view: &FinView) -> Columns {
        let width = view.turn.columns.width();
        let lookup = view.projection.lookup();
        let (mut fins, mut outermost, mut curves) = (Rows::new(width), Rows::new(width), vec![BTreeSet::new(); width]);
        for (number, fin) in self.fins.iter().enumerate() {
            let centre = |x: f64| self.slice(x).map_or([0.0; 2], |slice| centre(&slice.body));
            each_column(&fin.points_um, &lookup, width, &centre, |u, v, middle| {
                fins.add(u, v, if v < middle { Side::Upper } else { Side::Lower });
                outermost.add(u, v, Side::Upper);
                outermost.add(u, v, Side::Lower);
                curves[u].insert(number);
            });
        }
        let bodies = self.body_of(view, &lookup, width);
        let beyond = |u: usize| outermost.between(u).filter(|_| curves[u].len() > 1);
        view.turn.columns.mapped(beyond, |u, own| {
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
            // What an edge leaves behind when it moves inwards was part of the gap, and between the body and a fin there is none.
            let inwards = (upper - own.upper).max(0.0) + (own.lower - lower).max(0.0);
            let is_same = (upper - own.upper).abs() < 1e-9 && (lower - own.lower).abs() < 1e-9;
            let of_body = view.body.and_then(|columns| columns.get(u)).filter(|_| !is_same).map_or(own.gap, |body| body.gap);
            ColumnEdges { upper, lower, gap: (own.gap - inwards).max(0.0).min(of_body) }
        })
    }

    /// The edges of the body by all views in this view.
    fn body_of(&self, view: &FinView, lookup: &Lookup, width: usize) -> Rows {
        let mut rows = Rows::new(width);
        for side in Side::BOTH {
            let towards = if side == Side::Upper { PI } else { 0.0 } - view.turn.omega;
            let touch = self.slices.iter().filter(|slice| slice.known == Known::Body).map(|slice| {
                // The ray that touches is turned by the glass.
                let near = towards - view.projection.turn_rad(side.sign() * slice.body.at(towards)[0]);
                let theta = towards - view.projection.turn_rad(side.sign() * slice.body.at(near)[0]);
                let (sin, cos) = theta.sin_cos();
                let [h, slope] = slice.body.at(theta);
                [slice.x_um, h * cos - slope * sin, h * sin + slope * cos]
            });
            let touch: Vec<[f64; 3]> = touch.collect();
            each_column(&touch, lookup, width, &|_| [0.0; 2], |u, v, _| rows.add(u, v, side));
        }
        rows
    }
}

/// The edge of a view in a column. `own` is what the view shows, `body` its body, `fin` the fins of all views, as rows in px; an own
/// edge that stands out of the body by more than `least_px` is one of a fin.
fn amended(side: Side, own: f64, body: Option<f64>, fin: Option<f64>, least_px: f64) -> f64 {
    let out = |row: f64, of: f64| side.sign() * (row - of);
    // The joint edge of a fin is better known than that of a single view, whether it lies further out or in.
    let joint = fin.filter(|&fin| out(fin, own) > 0.0 || (fin - own).abs() < SAME_PX);
    match body {
        None => joint.unwrap_or(own),
        Some(body) if out(own, body) > least_px => fin.filter(|&fin| out(fin, body) > 0.0).unwrap_or(body),
        Some(_) => fin.filter(|&fin| out(fin, own) > 0.0).unwrap_or(own),
    }
}

/// Calls `seen` with each column in which a view shows a curve, the curve's row, and that of the body's centre, which `centre_um` gives at
/// a place along the capillary.
pub(super) fn each_column(
    points_um: &[[f64; 3]],
    lookup: &Lookup,
    width: usize,
    centre_um: &dyn Fn(f64) -> [f64; 2],
    mut seen: impl FnMut(usize, f64, f64),
) {
    let projected = |&[x, y, z]: &[f64; 3]| {
        let [centre_y, centre_z] = centre_um(x);
        let ((u, v), (_, middle)) = (lookup.project([x, y, z])?, lookup.project([x, centre_y, centre_z])?);
        Some([u, v, middle])
    };
    let mut before: Option<[f64; 3]> = None;
    for [u1, v1, m1] in points_um.iter().filter_map(projected) {
        if let Some([u0, v0, m0]) = before {
            let (from, to) = (u0.ceil().max(0.0), u1.floor().min(width as f64 - 1.0));
            let mut u = from;
            while u <= to {
                let part = if u1 > u0 { (u - u0) / (u1 - u0) } else { 0.0 };
                seen(u as usize, v0 + part * (v1 - v0), m0 + part * (m1 - m0));
                u += 1.0;
            }
        }
        before = Some([u1, v1, m1]);
    }
}
