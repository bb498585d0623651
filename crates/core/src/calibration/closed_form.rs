//! The image of the axis, in one pass. In each column the middle between the two edges goes around the axis once per turn.
//!
//! ```text
//!   middle_i(u) = axis(u) + b(u) cos omega_i + c(u) sin omega_i + what is odd in the slice's shape
//!   axis(u) = uy + (ky / kx) tan gamma (u - ux)
//! ```

use crate::geometry::Camera;
use crate::profile::Columns;
use crate::statistics::fit_robust;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Every so many columns one is read.
const STRIDE: usize = 4;
/// Number of fits. Each uses the weights of the one before; a further fit changes nothing beyond a thousandth of a px.
const ROUNDS: usize = 4;

/// Least number of columns. A line through two points does not say how well it fits.
const COLUMNS_LEAST: usize = 3;

/// Angles that span less than this, rad, count as one angle: rounding would decide the result.
const SPAN_LEAST: f64 = 1e-3;

/// Why the profiles do not give the image of the axis.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AxisError {
    /// Too few columns are covered by most views.
    #[error(
        "{found} of the columns looked at (every fourth of the image) show the specimen in three quarters of the views; {COLUMNS_LEAST} are needed to find the axis. The \
         profiles lie in different columns or are too short: look whether the specimen slid along the capillary or left the view"
    )]
    FewColumns {
        /// Columns that three quarters of the views cover, of those that were read.
        found: usize,
    },
    /// All angles are alike.
    #[error(
        "the angles of the views span {span_deg:.2} deg and tell no axis; check that the angles are those of a turn, and in rad where rad are expected"
    )]
    Angles {
        /// Largest angle less the smallest, deg.
        span_deg: f64,
    },
}

/// Estimates `uy` (px) and `gamma` (rad) of the camera from the profiles of one turn. Each view is a profile with its angle
/// (rad). All other values of the camera are returned as given.
///
/// # Errors
/// [`AxisError`] when fewer than three columns are covered by most views, or when the angles are all alike.
pub fn axis(camera: &Camera, views: &[(&Columns, f64)]) -> Result<Camera, AxisError> {
    let width = views.first().map_or(0, |(columns, _)| columns.width());
    let columns: Vec<(usize, Middles)> = (0..width).step_by(STRIDE).filter_map(|u| Some((u, middles(views, u)?))).collect();
    if columns.len() < COLUMNS_LEAST {
        return Err(AxisError::FewColumns { found: columns.len() });
    }
    let (low, high) = views.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (_, w)| (low.min(*w), high.max(*w)));
    let still = AxisError::Angles { span_deg: (high - low).to_degrees() };
    if high - low < SPAN_LEAST {
        return Err(still);
    }
    let points: Vec<[f64; 2]> = columns.iter().filter_map(|(u, middles)| Some([*u as f64, centre(middles)?])).collect();
    let (at, tilt) = line(&points, camera.ux).ok_or(still)?;
    Ok(Camera { uy: at, gamma: (tilt * camera.kx / camera.ky).atan(), ..camera.clone() })
}

/// Of one column: the angle of each view (rad) and the middle between its edges (px).
type Middles = Vec<(f64, f64)>;

/// `None` where fewer than three quarters of the views show the specimen.
fn middles(views: &[(&Columns, f64)], u: usize) -> Option<Middles> {
    let middles: Middles =
        views.iter().filter_map(|(columns, omega)| columns.get(u).map(|e| (*omega, f64::midpoint(e.upper, e.lower)))).collect();
    // Near the ends only some views show the specimen, and a mean over them is not a mean over a turn.
    (middles.len() >= 4.max(3 * views.len() / 4)).then_some(middles)
}

/// Row in which the axis is seen. `None` where the angles are all alike.
fn centre(middles: &[(f64, f64)]) -> Option<f64> {
    let rows: Vec<_> = middles.iter().map(|(omega, middle)| (Vector3::new(1.0, omega.cos(), omega.sin()), *middle)).collect();
    Some(fit_robust(&rows, Matrix3::zeros(), ROUNDS, 0.05)?[0])
}

/// Value at `u0` and slope of the straight line nearest to the points.
fn line(points: &[[f64; 2]], u0: f64) -> Option<(f64, f64)> {
    if points.len() < COLUMNS_LEAST {
        return None;
    }
    let rows: Vec<_> = points.iter().map(|[u, v]| (Vector2::new(1.0, u - u0), *v)).collect();
    fit_robust(&rows, Matrix2::zeros(), ROUNDS, 0.01).map(|found| (found[0], found[1]))
}
