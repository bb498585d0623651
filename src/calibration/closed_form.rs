//! The image of the axis in one pass: per column the middle between the edges goes around it once a turn.
//!
//! ```text
//!   middle_i(u) = axis(u) + b(u) cos omega_i + c(u) sin omega_i + what is odd in the slice's shape
//!   axis(u) = uy + (ky / kx) tan gamma (u - ux)
//! ```

use crate::geometry::Camera;
use crate::profile::Columns;
use crate::statistics::fit_robust;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Columns between two that are looked at.
const STRIDE: usize = 4;
/// Fits, each with weights of the one before: a further one changes nothing beyond a thousandth of a px.
const ROUNDS: usize = 4;

/// `uy` and `gamma` of the camera for these profiles, everything else as given; nothing where no three columns show the turn.
pub fn axis(camera: &Camera, views: &[(&Columns, f64)]) -> Option<Camera> {
    let width = views.first()?.0.width();
    let points: Vec<[f64; 2]> = (0..width).step_by(STRIDE).filter_map(|u| Some([u as f64, centre(views, u)?])).collect();
    let (at, tilt) = line(&points, camera.ux)?;
    Some(Camera { uy: at, gamma: (tilt * camera.kx / camera.ky).atan(), ..camera.clone() })
}

/// Where the axis is seen in column `u`.
fn centre(views: &[(&Columns, f64)], u: usize) -> Option<f64> {
    let middles: Vec<(f64, f64)> =
        views.iter().filter_map(|(columns, omega)| columns.get(u).map(|e| (*omega, f64::midpoint(e.upper, e.lower)))).collect();
    // Near the ends only some views see the specimen, and their mean is none over a turn.
    if middles.len() < 4.max(3 * views.len() / 4) {
        return None;
    }
    let rows: Vec<_> = middles.iter().map(|(omega, middle)| (Vector3::new(1.0, omega.cos(), omega.sin()), *middle)).collect();
    Some(fit_robust(&rows, Matrix3::zeros(), ROUNDS, 0.05)?[0])
}

/// Value at `u0` and slope of the line nearest to the points.
fn line(points: &[[f64; 2]], u0: f64) -> Option<(f64, f64)> {
    if points.len() < 3 {
        return None;
    }
    let rows: Vec<_> = points.iter().map(|[u, v]| (Vector2::new(1.0, u - u0), *v)).collect();
    fit_robust(&rows, Matrix2::zeros(), ROUNDS, 0.01).map(|found| (found[0], found[1]))
}
