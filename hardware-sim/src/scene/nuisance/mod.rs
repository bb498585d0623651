//! What spoils a picture besides what lies in the capillary. All of it is off by default, and the same for the same seed.
//!
//! ```text
//!   lamp  x off-centre light  x marks on the window  x marks on the glass  x specimen -> blur -> motion -> x drift -> hot pixels
//!          \_______ fixed in the picture ________/    turn with the shaft                               by exposure    fixed
//! ```
//! Weaker light to the corners, defocus and noise are the optics' own: [`super::Optics`]; a tilted capillary is the camera's
//! `gamma_rad`, a tight one its bore. No nuisance moves the truth.

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

/// Everything that may spoil a picture.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Nuisances {
    /// Places, sizes and flicker follow from it.
    pub seed: u64,
    pub light_centre: LightCentre,
    /// Scratches and dust on a window before the camera: they stay where they are in the picture.
    pub window: Marks,
    /// Scratches and dust on the outside of the capillary: they turn with it.
    pub glass: Marks,
    pub motion: Motion,
    pub drift: Drift,
    pub hot_pixels: HotPixels,
}

impl Nuisances {
    /// What does not depend on the exposure, on the sharp picture of the empty capillary.
    pub(super) fn shade_field(&self, light: &mut [[f32; 3]], camera: &Camera) {
        self.light_centre.shade(light, camera);
        self.window.shade_fixed(light, camera, self.seed);
    }

    /// The sharp picture of the empty capillary with what turns with the shaft; None where there is nothing of the kind.
    pub(super) fn marked(&self, light: &[[f32; 3]], camera: &Camera, capillary: &Capillary, angle_rad: f64) -> Option<Vec<[f32; 3]>> {
        (!self.glass.none()).then(|| {
            let mut light = light.to_vec();
            self.glass.shade_turning(&mut light, camera, capillary, angle_rad, self.seed);
            light
        })
    }

    /// What happens after the lens, on the blurred picture.
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
