//! Disturbances of the image that do not come from the contents of the capillary. All are off by default, and depend on the seed only.
//!
//! ```text
//!   lamp  x off-centre light  x marks on the window  x marks on the glass  x specimen -> blur -> motion -> x drift -> hot pixels
//!          \_______ fixed in the picture ________/    turn with the shaft                               by exposure    fixed
//! ```
//! Vignetting, defocus and noise belong to [`super::Optics`]. A tilted capillary is `gamma_rad` of the camera, a narrow one its bore. No
//! nuisance changes the ground truth.

mod lamp;
mod marks;
mod motion;
mod sensor;

pub use lamp::{Drift, LightCentre};
pub use marks::Marks;
pub use motion::Motion;
pub use sensor::HotPixels;

use super::Camera;
use super::capillary::Capillary;
use serde::{Deserialize, Serialize};

/// All disturbances of the image.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Nuisances {
    /// Seed of positions, sizes and flicker.
    pub seed: u64,
    pub light_centre: LightCentre,
    /// Scratches and dust on a window before the camera. They do not move in the image.
    pub window: Marks,
    /// Scratches and dust on the outside of the capillary. They turn with it.
    pub glass: Marks,
    pub motion: Motion,
    pub drift: Drift,
    pub hot_pixels: HotPixels,
}

impl Nuisances {
    /// Applies what does not depend on the exposure to the sharp image of the empty capillary.
    pub(super) fn shade_field(&self, light: &mut [[f32; 3]], camera: &Camera) {
        self.light_centre.shade(light, camera);
        self.window.shade_fixed(light, camera, self.seed);
    }

    /// The sharp image of the empty capillary with the marks that turn with the shaft. `None` if there are no such marks.
    pub(super) fn marked(&self, light: &[[f32; 3]], camera: &Camera, capillary: &Capillary, angle_rad: f64) -> Option<Vec<[f32; 3]>> {
        (!self.glass.none()).then(|| {
            let mut light = light.to_vec();
            self.glass.shade_turning(&mut light, camera, capillary, angle_rad, self.seed);
            light
        })
    }

    /// Applies what happens after the lens to the blurred image.
    pub(super) fn disturb(&self, mut light: Vec<[f32; 3]>, width: usize, number: u64) -> Vec<[f32; 3]> {
        if !self.motion.is_still() {
            light = self.motion.blurred(&light, width);
        }
        self.drift.apply(&mut light, number, self.seed);
        self.hot_pixels.add(&mut light, self.seed);
        light
    }
}

#[cfg(test)]
mod tests;
