//! The uncertainty of volume and area that the uncertainty of the pose causes.

use super::sections::{SectionsError, rough};
use crate::calibration::{Calibration, GivenView, Pose, TurnView};
use crate::geometry::Camera;
use nalgebra::Vector4;

/// Standard deviations of volume (um^3) and area (um^2) that follow from the covariance of uy, gamma, alpha and rho. `given`
/// are all views that were calibrated.
///
/// # Errors
/// [`SectionsError::NoProfile`] where no view that counts shows the specimen.
pub fn calibration_sd(calibration: &Calibration, given: &[GivenView]) -> Result<[f64; 2], SectionsError> {
    let sd_um = calibration.residual_sd_um;
    let views = calibration.turn_views(given);
    let at = |camera: &Camera, views: &[TurnView]| rough(&Pose::new(camera), views, sd_um);
    let steps = calibration.covariance.diagonal().map(f64::sqrt);
    let camera = &calibration.camera;
    let here = at(camera, &views)?;
    let turned: Vec<TurnView> = views.iter().map(|v| TurnView { omega: v.omega * (1.0 + steps[3] / calibration.rho), ..*v }).collect();
    let moved = [
        at(&Camera { uy: camera.uy + steps[0], ..camera.clone() }, &views)?,
        at(&Camera { gamma: camera.gamma + steps[1], ..camera.clone() }, &views)?,
        at(&Camera { alpha: camera.alpha + steps[2], ..camera.clone() }, &views)?,
        at(camera, &turned)?,
    ];
    Ok([0, 1].map(|number| {
        let slope = Vector4::from_fn(|i, _| (moved[i][number] - here[number]) / steps[i]);
        slope.dot(&(calibration.covariance * slope)).max(0.0).sqrt()
    }))
}
