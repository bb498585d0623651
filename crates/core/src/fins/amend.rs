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
    pub fn amended(&self, view: &FinView, projection: &Projection) -> Columns {
        let width = view.turn.columns.width();
        let mut fins = vec![Outermost::default(); width];
        for fin in &self.fins {
            let seen: Vec<[f64; 3]> = fin
                .points_um
                .iter()
                .filter_map(|&[x, y, z]| {
                    let [centre_y, centre_z] = centre(&self.slice(x)?.body);
                    let ((u, v), (_, middle)) = (projection.project([x, y, z])?, projection.project([x, centre_y, centre_z])?);
                    Some([u, v, middle])
                })
                .collect();
            for pair in seen.windows(2) {
                let ([u0, v0, m0], [u1, v1, m1]) = (pair[0], pair[1]);
                let (from, to) = (u0.ceil().max(0.0), u1.floor().min(width as f64 - 1.0));
                let mut u = from;
                while u <= to {
                    let part = if u1 > u0 { (u - u0) / (u1 - u0) } else { 0.0 };
                    let (v, middle) = (v0 + part * (v1 - v0), m0 + part * (m1 - m0));
                    let here = &mut fins[u as usize];
                    if v < middle {
                        here.upper = Some(here.upper.map_or(v, |w: f64| w.min(v)));
                    } else {
                        here.lower = Some(here.lower.map_or(v, |w: f64| w.max(v)));
                    }
                    u += 1.0;
                }
            }
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
            ColumnEdges { upper, lower, gap: own.gap }
        })
    }
}
