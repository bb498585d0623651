//! Everything that says where the views looked from, and the paper's vector of it.
//!
//! ```text
//!   psi = (f, kx, ky, ux, uy, s, alpha, gamma, phi, omega_1 .. omega_N)        um, px/um, px, rad
//! ```
//! What a view is shifted by, `dy`, stands beside the vector: the paper's camera does not move.

use super::Calibration;
use crate::geometry::{Camera, Projection};

/// Entries before the angles.
const CAMERA: usize = 9;

#[derive(Debug, Clone, PartialEq)]
pub struct Psi {
    pub camera: Camera,
    /// One per view, rad.
    pub omega: Vec<f64>,
    /// Down the image against the camera's, px; one per view.
    pub dy_px: Vec<f64>,
}

#[derive(Debug, thiserror::Error, PartialEq)]
#[error("psi has {found} entries; f, kx, ky, ux, uy, s, alpha, gamma, phi and the angles of {views} views are {expected}")]
pub struct PsiLength {
    found: usize,
    expected: usize,
    views: usize,
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

    pub fn vector(&self) -> Vec<f64> {
        let Camera { f, kx, ky, ux, uy, s, alpha, gamma, phi, .. } = self.camera;
        [f, kx, ky, ux, uy, s, alpha, gamma, phi].into_iter().chain(self.omega.iter().copied()).collect()
    }

    /// The same sensor and shifts with the vector's values.
    ///
    /// # Errors
    /// Refuses a vector of another number of views.
    pub fn with_vector(&self, psi: &[f64]) -> Result<Self, PsiLength> {
        let views = self.omega.len();
        match *psi {
            [f, kx, ky, ux, uy, s, alpha, gamma, phi, ref omega @ ..] if omega.len() == views => Ok(Self {
                camera: Camera { f, kx, ky, ux, uy, s, alpha, gamma, phi, ..self.camera },
                omega: omega.to_vec(),
                dy_px: self.dy_px.clone(),
            }),
            _ => Err(PsiLength { found: psi.len(), expected: CAMERA + views, views }),
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
    fn a_vector_there_and_back_is_the_same_psi() {
        let camera =
            Camera { f: 1.0, kx: 2.0, ky: 3.0, ux: 4.0, uy: 5.0, s: 6.0, alpha: 7.0, gamma: 8.0, phi: 9.0, width: 640, height: 480 };
        let psi = Psi { camera: camera.clone(), omega: vec![10.0, 11.0, 12.0], dy_px: vec![0.5, -0.5, 0.0] };
        let vector = psi.vector();
        assert_eq!(vector, (1..=12).map(f64::from).collect::<Vec<_>>(), "in the paper's order");
        let other = Psi { camera: Camera { f: 0.0, uy: 0.0, gamma: 0.0, ..camera }, omega: vec![0.0; 3], ..psi.clone() };
        assert_eq!(other.with_vector(&vector), Ok(psi.clone()));
        assert_eq!(psi.camera_of(1).uy, 4.5);
        for wrong in [11, 13, 4] {
            assert_eq!(psi.with_vector(&vec![0.0; wrong]), Err(PsiLength { found: wrong, expected: 12, views: 3 }));
        }
    }
}
