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

/// A pose of the camera with the views of the turn, and the standard deviation of their edges, um.
struct Posed<'a> {
    camera: &'a Camera,
    views: &'a [TurnView<'a>],
    sd_um: f64,
}

impl Posed<'_> {
    /// Volume (um^3) and area (um^2) with uy (px), gamma, alpha (rad) and the ratio of the angles changed by so much, each by itself.
    fn moved(&self, by: [f64; 4]) -> Result<[[f64; 2]; 4], SensitivityError> {
        let Camera { uy, gamma, alpha, .. } = *self.camera;
        let turned: Vec<TurnView> = self.views.iter().map(|v| TurnView { omega: v.omega * (1.0 + by[3]), ..*v }).collect();
        Ok([
            self.numbers(&Camera { uy: uy + by[0], ..self.camera.clone() }, self.views)?,
            self.numbers(&Camera { gamma: gamma + by[1], ..self.camera.clone() }, self.views)?,
            self.numbers(&Camera { alpha: alpha + by[2], ..self.camera.clone() }, self.views)?,
            self.numbers(self.camera, &turned)?,
        ])
    }

    fn numbers(&self, camera: &Camera, views: &[TurnView]) -> Result<[f64; 2], SensitivityError> {
        rough(&Pose::new(camera), views, self.sd_um).ok_or(SensitivityError::NoSlices)
    }
}

/// Standard deviations of volume (um^3) and area (um^2) that follow from the covariance of uy, gamma, alpha and rho. `given`
/// are all views that were calibrated.
///
/// # Errors
/// [`SensitivityError`], with the cause.
pub fn calibration_sd(calibration: &Calibration, given: &[GivenView]) -> Result<[f64; 2], SensitivityError> {
    let steps = calibration.covariance.diagonal().map(f64::sqrt);
    let not_stated = SensitivityError::Covariance { sd: steps.into() };
    if !steps.iter().all(|sd| sd.is_finite() && *sd > 0.0) {
        return Err(not_stated);
    }
    let posed = Posed { camera: &calibration.camera, views: &calibration.turn_views(given), sd_um: calibration.residual_sd_um };
    let here = posed.numbers(posed.camera, posed.views)?;
    let moved = posed.moved([steps[0], steps[1], steps[2], steps[3] / calibration.rho])?;
    let variances = [0, 1].map(|number| {
        let slope = Vector4::from_fn(|i, _| (moved[i][number] - here[number]) / steps[i]);
        slope.dot(&(calibration.covariance * slope))
    });
    // `max` turns a number that is none into 0.
    if variances.iter().all(|variance| variance.is_finite()) { Ok(variances.map(|v| v.max(0.0).sqrt())) } else { Err(not_stated) }
}

/// Standard deviations of volume (um^3) and area (um^2) of a turn without a calibration: what changes of uy (px), gamma, alpha (rad)
/// and the ratio of the angles by these standard deviations do. Each is applied to both sides, and the larger change counts: the
/// numbers have their extremes near the true pose, where the slope is 0.
///
/// # Errors
/// [`SensitivityError::NoSlices`].
pub(crate) fn given_sd(camera: &Camera, views: &[TurnView], sd_um: f64, sd: [f64; 4]) -> Result<[f64; 2], SensitivityError> {
    let posed = Posed { camera, views, sd_um };
    let here = posed.numbers(camera, views)?;
    let sides = [posed.moved(sd)?, posed.moved(sd.map(|sd| -sd))?];
    let change = |number: usize, i: usize| sides.iter().map(|moved| (moved[i][number] - here[number]).abs()).fold(0.0, f64::max);
    Ok([0, 1].map(|number| (0..4).map(|i| change(number, i).powi(2)).sum::<f64>().sqrt()))
}
