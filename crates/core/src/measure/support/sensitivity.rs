//! The uncertainty of volume and area that the uncertainty of the pose causes.

use super::sections::rough;
use crate::calibration::{Calibration, GivenView, Pose, TurnView};
use crate::geometry::Camera;
use nalgebra::Vector4;

/// Why it is not known how uncertain the calibration makes volume and area.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SensitivityError {
    /// The slices of the calibrated pose, or of a pose that differs from it by a standard deviation, have no volume.
    #[error("no slice encloses anything with the camera as calibrated or moved by its standard deviation")]
    NoSlices,
    /// The calibration states no standard deviations.
    #[error("the standard deviations of uy, gamma, alpha and rho are {sd:?}; finite numbers above 0 are needed")]
    Covariance {
        /// Of uy (px), gamma (rad), alpha (rad) and rho.
        sd: [f64; 4],
    },
}

/// Standard deviations of volume (um^3) and area (um^2) that follow from the covariance of uy, gamma, alpha and rho. `given`
/// are all views that were calibrated.
///
/// # Errors
/// [`SensitivityError`], with the cause.
pub fn calibration_sd(calibration: &Calibration, given: &[GivenView]) -> Result<[f64; 2], SensitivityError> {
    let sd_um = calibration.residual_sd_um;
    let views = calibration.turn_views(given);
    let at = |camera: &Camera, views: &[TurnView]| rough(&Pose::new(camera), views, sd_um).ok_or(SensitivityError::NoSlices);
    let steps = calibration.covariance.diagonal().map(f64::sqrt);
    let not_stated = SensitivityError::Covariance { sd: steps.into() };
    if !steps.iter().all(|sd| sd.is_finite() && *sd > 0.0) {
        return Err(not_stated);
    }
    let camera = &calibration.camera;
    let here = at(camera, &views)?;
    let turned: Vec<TurnView> = views.iter().map(|v| TurnView { omega: v.omega * (1.0 + steps[3] / calibration.rho), ..*v }).collect();
    let moved = [
        at(&Camera { uy: camera.uy + steps[0], ..camera.clone() }, &views)?,
        at(&Camera { gamma: camera.gamma + steps[1], ..camera.clone() }, &views)?,
        at(&Camera { alpha: camera.alpha + steps[2], ..camera.clone() }, &views)?,
        at(camera, &turned)?,
    ];
    let variances = [0, 1].map(|number| {
        let slope = Vector4::from_fn(|i, _| (moved[i][number] - here[number]) / steps[i]);
        slope.dot(&(calibration.covariance * slope))
    });
    // `max` turns a number that is none into 0.
    if variances.iter().all(|variance| variance.is_finite()) { Ok(variances.map(|v| v.max(0.0).sqrt())) } else { Err(not_stated) }
}
