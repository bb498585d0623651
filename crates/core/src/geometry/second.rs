//! A second camera on the same capillary.

use super::{Camera, Projection};
use serde::{Deserialize, Serialize};

/// Its psi, and how far around the axis it stands from the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SecondOptics {
    pub camera: Camera,
    /// rad, added to the angle of a view.
    pub around: f64,
}

impl SecondOptics {
    /// The projection of the view that the first camera has at `omega`, rad.
    pub fn projection(&self, omega: f64) -> Projection {
        self.camera.projection(omega + self.around)
    }
}
