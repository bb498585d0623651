//! A second camera on the same capillary.

use super::{Camera, Projection};
use serde::{Deserialize, Serialize};

/// The optics of the second camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SecondOptics {
    /// Its camera, in the frame of the capillary.
    pub camera: Camera,
    /// Angle about the axis from the first camera to this one, rad. It is added to the angle of a view.
    pub around: f64,
}

impl SecondOptics {
    /// The projection of the view that the first camera has at `omega` (rad).
    pub fn projection(&self, omega: f64) -> Projection {
        self.camera.projection(omega + self.around)
    }
}
