//! The poses of all views: camera, angles and shifts. Camera and angles are the paper's vector psi.
//!
//! ```text
//!   psi = (f, kx, ky, ux, uy, s, alpha, gamma, phi, omega_1 .. omega_N)        um, px/um, px, rad
//! ```
//! The shift `dy` of a view is not part of the vector: the paper's camera does not move.

use super::Calibration;
use crate::geometry::{Camera, Projection};

/// The poses of the views of a turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Psi {
    /// The camera that all views share.
    pub camera: Camera,
    /// Angle of the capillary in each view, rad.
    pub omega: Vec<f64>,
    /// Shift of each view down the image against the camera, px.
    pub dy_px: Vec<f64>,
}

impl Psi {
    /// Views of one camera at these angles (rad), without shifts.
    pub fn new(camera: Camera, omega: Vec<f64>) -> Self {
        let dy_px = vec![0.0; omega.len()];
        Self { camera, omega, dy_px }
    }

    /// The views that a calibration used, with what it found. `ledger` has the angles of all views given, rad.
    pub fn of(found: &Calibration, ledger: &[f64]) -> Self {
        let used = || ledger.iter().zip(&found.views).filter(|(_, state)| state.bad.is_none());
        Self {
            camera: found.camera.clone(),
            omega: used().map(|(&omega, _)| found.angle(omega)).collect(),
            dy_px: used().map(|(_, state)| state.dy_px).collect(),
        }
    }

    /// The camera of a view: its shift is added to the principal point.
    pub fn camera_of(&self, view: usize) -> Camera {
        Camera { uy: self.camera.uy + self.dy_px[view], ..self.camera }
    }

    /// The projection of a view.
    pub fn projection(&self, view: usize) -> Projection {
        self.camera_of(view).projection(self.omega[view])
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod tests {
    use super::*;

    #[test]
    fn a_shift_of_a_view_is_one_of_its_principal_point() {
        let psi = Psi { camera: Camera::published(640, 480), omega: vec![0.0, 1.0, 2.0], dy_px: vec![0.5, -0.5, 0.0] };
        assert_eq!(psi.camera_of(1), Camera { uy: 239.0, ..psi.camera.clone() });
        assert_eq!(psi.projection(1), psi.camera_of(1).projection(1.0));
    }
}
