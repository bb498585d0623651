//! The edges of a view, amended by the fins that all views share.

use super::{FinView, Found, SAME_PX, centre};
use crate::geometry::Projection;
use crate::profile::{ColumnEdges, Columns};

/// An own edge that stands out of the body by more than this is one of a fin, px.
const OWN_PX: f64 = 2.5;

/// The outermost fins of a view in one column.
#[derive(Clone, Copy, Default)]
struct Outermost {
    upper: Option<f64>,
    lower: Option<f64>,
}

impl Found {
    /// The edges of a view: of the body, of the fins, and what the view shows besides. An edge of a fin that only this view shows is
    /// dropped.
    pub fn amended(&self, view: &FinView) -> Columns {
        let projection = &view.projection;
        let width = view.turn.columns.width();
        let mut fins = vec![Outermost::default(); width];
        for fin in &self.fins {
            let centre = |x: f64| self.slice(x).map_or([0.0; 2], |slice| centre(&slice.body));
            each_column(&fin.points_um, projection, width, &centre, |u, v, middle| {
                let here = &mut fins[u];
                if v < middle {
                    here.upper = Some(here.upper.map_or(v, |w: f64| w.min(v)));
                } else {
                    here.lower = Some(here.lower.map_or(v, |w: f64| w.max(v)));
                }
            });
        }
        view.turn.columns.mapped(|u, own| {
            let body = view.body.and_then(|body| body.get(u));
            let side = |own: f64, body: Option<f64>, fin: Option<f64>, sign: f64| {
                let Some(body) = body else {
                    return fin.map_or(own, |fin| if sign * (fin - own) > 0.0 || (fin - own).abs() < SAME_PX { fin } else { own });
                };
                let own_fin = sign * (own - body) > OWN_PX;
                match fin {
                    Some(fin) if own_fin && (own - fin).abs() < SAME_PX && sign * (fin - body) > 1.0 => fin,
                    Some(fin) => {
                        if sign * (fin - body) > 0.0 {
                            fin
                        } else {
                            body
                        }
                    }
                    None => {
                        if own_fin {
                            body
                        } else {
                            own
                        }
                    }
                }
            };
            let upper = side(own.upper, body.map(|b| b.upper), fins[u].upper, -1.0);
            let lower = side(own.lower, body.map(|b| b.lower), fins[u].lower, 1.0);
            // Between the body and an edge that is another now lies the fin.
            let same = (upper - own.upper).abs() < 1e-9 && (lower - own.lower).abs() < 1e-9;
            let gap = if same { own.gap } else { body.map_or(own.gap, |body| body.gap.min(own.gap)) };
            ColumnEdges { upper, lower, gap }
        })
    }
}

/// Calls `seen` with each column in which a view shows a curve, the curve's row, and that of the body's centre, which `centre_um` gives at
/// a place along the capillary.
pub(super) fn each_column(
    points_um: &[[f64; 3]],
    projection: &Projection,
    width: usize,
    centre_um: &dyn Fn(f64) -> [f64; 2],
    mut seen: impl FnMut(usize, f64, f64),
) {
    let projected = |&[x, y, z]: &[f64; 3]| {
        let [centre_y, centre_z] = centre_um(x);
        let ((u, v), (_, middle)) = (projection.project([x, y, z])?, projection.project([x, centre_y, centre_z])?);
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
