//! Disturbances of the image that do not come from the contents of the capillary. All are off by default, and depend on the seed only.
//!
//! ```text
//!   lamp  x off-centre light  x marks on the window  x marks on the glass  x specimen -> blur -> motion -> x drift -> hot pixels
//!          \_______ fixed in the picture ________/    turn with the shaft                               by exposure    fixed
//!                                x dust                x dust on the glass
//!                                                      x dust in the water
//! ```
//! Vignetting, defocus and noise belong to [`super::Optics`]. A tilted capillary is `gamma_rad` of the camera, a narrow one its bore. No
//! nuisance changes the ground truth.

mod dust;
mod lamp;
mod marks;
mod motion;
mod sensor;

pub use dust::Dust;
pub(super) use dust::Turned;
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
    /// Dust on the window. It does not move in the image.
    pub window_dust: Dust,
    /// Dust on the outside of the capillary. It turns with it.
    pub glass_dust: Dust,
    /// Dust in the water of the bore. It turns with the capillary.
    pub water_dust: Dust,
    pub motion: Motion,
    pub drift: Drift,
    pub hot_pixels: HotPixels,
}

/// The parts of the dust on the window, on the glass and in the water. Real frames show their sum only.
const SHARES: [f64; 3] = [0.2, 0.5, 0.3];

impl Nuisances {
    /// Distributes the dust over the window, the glass and the water.
    #[must_use]
    pub fn with_dust(self, all: Dust) -> Self {
        let [window_dust, glass_dust, water_dust] = SHARES.map(|share| all.times(share));
        Self { window_dust, glass_dust, water_dust, ..self }
    }

    /// Applies what does not depend on the exposure to the sharp image of the empty capillary.
    pub(super) fn shade_field(&self, light: &mut [[f32; 3]], camera: &Camera, capillary: &Capillary, blur_px: f64) {
        self.light_centre.shade(light, camera);
        self.window.shade_fixed(light, camera, self.seed);
        self.window_dust.shade_fixed(light, camera, capillary, blur_px, self.seed);
    }

    /// Whether there are marks or dust that turn with the shaft.
    pub(super) fn turn_with_the_glass(&self) -> bool {
        !(self.glass.none() && self.glass_dust.none() && self.water_dust.none())
    }

    /// The sharp image of the empty capillary with the marks and the dust that turn with the shaft. `None` if there are none.
    pub(super) fn marked(&self, light: &[[f32; 3]], seen: &Turned<'_>) -> Option<Vec<[f32; 3]>> {
        self.turn_with_the_glass().then(|| {
            let mut light = light.to_vec();
            self.glass.shade_turning(&mut light, seen.camera, seen.capillary, seen.angle_rad, self.seed);
            self.glass_dust.shade_on_glass(&mut light, seen, self.seed);
            self.water_dust.shade_in_water(&mut light, seen, self.seed);
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
