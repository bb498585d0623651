//! Ellipsoids by least squares from their edges in all views.

use super::ellipsoid::{Ellipse, Ellipsoid, Linear};
use crate::parallel::prelude::*;
use crate::statistics::median;
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use std::f64::consts::PI;

/// Edges that an ellipsoid needs.
const LEAST_EDGES: usize = 60;

const UNKNOWNS: usize = 9;
type Unknowns = SVector<f64, UNKNOWNS>;

/// An edge of an organ in one view.
#[derive(Clone, Copy)]
pub(super) struct Edge {
    pub view: usize,
    pub at: Vector2<f64>,
}

/// Standard deviation of the place of all edges together, px.
pub(super) const EDGE_SD_PX: f64 = 0.35;
/// Standard deviation of the volume by the form, in volumes per residual over radius. A body that is no ellipsoid leaves a residual.
pub(super) const FORM: f64 = 0.2;

/// An ellipsoid with what it was fitted to.
pub(super) struct Fit {
    pub body: Ellipsoid,
    pub linear: Vec<Linear>,
    pub edges: Vec<Edge>,
    /// Root mean square distance of the edges from its outlines, px.
    pub residual_px: f64,
}

impl Fit {
    pub fn px_per_um(&self) -> f64 {
        self.linear.iter().map(Linear::scale).sum::<f64>() / self.linear.len() as f64
    }

    /// By the views alone, with each left out once: standard deviations of the volume, um^3, and of the centre in any direction, um.
    fn jackknife(&self) -> [f64; 2] {
        let n = self.linear.len();
        let without: Vec<Ellipsoid> = (0..n)
            .into_par_iter()
            .map(|view| solve(&self.linear, &self.edges, self.body, Some(view), 1).map_or(self.body, |(body, _)| body))
            .collect();
        let factor = (n as f64 - 1.0) / n as f64;
        let of = |off: &dyn Fn(&Ellipsoid) -> f64| (factor * without.iter().map(|body| off(body).powi(2)).sum::<f64>()).sqrt();
        [of(&|body| body.volume_um3() - self.body.volume_um3()), of(&|body| (body.centre - self.body.centre).norm())]
    }

    /// Standard deviation of the centre in one direction, um: by the views, by the form, and by the edges on one side.
    pub fn centre_sd_um(&self) -> f64 {
        let [_, views] = self.jackknife();
        let px = [FORM * self.residual_px, EDGE_SD_PX].map(|px| px / self.px_per_um());
        root_of_squares([views / 3f64.sqrt(), px[0], px[1]].into_iter())
    }

    /// Standard deviation of the volume, um^3: by the views, by the place of all edges together, and by the form.
    pub fn volume_sd_um3(&self) -> f64 {
        let volume = self.body.volume_um3();
        let radius_px = (volume * 0.75 / PI).cbrt() * self.px_per_um();
        let [views, _] = self.jackknife();
        // Half axes that are longer by d make a volume that is larger by the sum of d / a.
        let edge = self.body.half_axes_um().iter().map(|a| EDGE_SD_PX / self.px_per_um() / a).sum::<f64>() * volume;
        let form = 3.0 * FORM * self.residual_px / radius_px * volume;
        root_of_squares([views, edge, form].into_iter())
    }
}

pub(super) fn root_of_squares(parts: impl Iterator<Item = f64>) -> f64 {
    parts.map(|p| p * p).sum::<f64>().sqrt()
}

/// The unknowns are the centre and the lower triangle of the spread's root.
fn ellipsoid(x: &Unknowns) -> Ellipsoid {
    let l = Matrix3::new(x[3], 0.0, 0.0, x[4], x[5], 0.0, x[6], x[7], x[8]);
    Ellipsoid { centre: Vector3::new(x[0], x[1], x[2]), spread: l * l.transpose() }
}

fn unknowns(of: &Ellipsoid) -> Option<Unknowns> {
    let (c, l) = (of.centre, of.spread.cholesky()?.l());
    Some(Unknowns::from([c.x, c.y, c.z, l[(0, 0)], l[(1, 0)], l[(1, 1)], l[(2, 0)], l[(2, 1)], l[(2, 2)]]))
}

/// Least squares of the edges' distances from the outlines, with Tukey's weights. `without` leaves a view out. Returns the ellipsoid and the root
/// mean square distance, px.
pub(super) fn solve(linear: &[Linear], edges: &[Edge], from: Ellipsoid, without: Option<usize>, steps: usize) -> Option<(Ellipsoid, f64)> {
    /// Step of the derivatives, um.
    const STEP_UM: f64 = 0.1;
    /// A residual of so many standard deviations has no weight.
    const CUT: f64 = 4.0;
    /// Least standard deviation of an edge, px.
    const LEAST_SD_PX: f64 = 0.15;
    let edges: Vec<&Edge> = edges.iter().filter(|edge| without != Some(edge.view)).collect();
    if edges.len() < LEAST_EDGES {
        return None;
    }
    let residuals = |x: &Unknowns| -> Vec<f64> {
        let body = ellipsoid(x);
        let seen: Vec<Ellipse> = linear.iter().map(|linear| body.seen(linear)).collect();
        edges.iter().map(|edge| seen[edge.view].beyond(edge.at)).collect()
    };
    let mut x = unknowns(&from)?;
    let mut rms = 0.0;
    for _ in 0..steps {
        let r = residuals(&x);
        let scale = CUT * (1.4826 * median(r.iter().map(|r| r.abs()).collect())?).max(LEAST_SD_PX);
        let weights: Vec<f64> = r.iter().map(|r| (1.0 - (r / scale).powi(2)).max(0.0).powi(2)).collect();
        rms = (r.iter().zip(&weights).map(|(r, w)| w * r * r).sum::<f64>() / weights.iter().sum::<f64>()).sqrt();
        let columns: Vec<Vec<f64>> = (0..UNKNOWNS).map(|k| residuals(&(x + STEP_UM * Unknowns::ith(k, 1.0)))).collect();
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::identity() * 1e-9;
        let mut right = Unknowns::zeros();
        for i in 0..r.len() {
            let row = Unknowns::from_fn(|k, _| (columns[k][i] - r[i]) / STEP_UM);
            normal += weights[i] * row * row.transpose();
            right += weights[i] * r[i] * row;
        }
        x -= normal.cholesky()?.solve(&right);
    }
    let body = ellipsoid(&x);
    (body.volume_um3().is_finite() && body.volume_um3() > 0.0).then_some((body, rms))
}
