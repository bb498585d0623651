//! Everything that says where the views looked from, and the paper's vector of it.
//!
//! ```text
//!   psi = (f, kx, ky, ux, uy, s, alpha, gamma, phi, omega_1 .. omega_N)        um, px/um, px, rad
//! ```
//! What a view is shifted by, `dy`, stands beside the vector: the paper's camera does not move.

use super::Calibration;
use crate::geometry::{Camera, Projection};

#[derive(Debug, Clone, PartialEq)]
pub struct Psi {
    pub camera: Camera,
    /// One per view, rad.
    pub omega: Vec<f64>,
    /// Down the image against the camera's, px; one per view.
    pub dy_px: Vec<f64>,
}

impl Psi {
    pub fn new(camera: Camera, omega: Vec<f64>) -> Self {
        let dy_px = vec![0.0; omega.len()];
        Self { camera, omega, dy_px }
    }

    /// What a calibration found of the views that it used; `ledger` has the angles of all.
    pub fn of(found: &Calibration, ledger: &[f64]) -> Self {
        let used = || ledger.iter().zip(&found.views).filter(|(_, state)| state.bad.is_none());
        Self {
            camera: found.camera.clone(),
            omega: used().map(|(&omega, _)| found.angle(omega)).collect(),
            dy_px: used().map(|(_, state)| state.dy_px).collect(),
        }
    }

    /// A shift of a view is one of its principal point.
    pub fn camera_of(&self, view: usize) -> Camera {
        Camera { uy: self.camera.uy + self.dy_px[view], ..self.camera }
    }

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
