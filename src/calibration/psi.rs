//! Everything that says where the views looked from: the paper's vector, and the views' shifts beside it.
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
    pub fn projection(&self, view: usize) -> Projection {
        Camera { uy: self.camera.uy + self.dy_px[view], ..self.camera }.projection(self.omega[view])
    }
}
