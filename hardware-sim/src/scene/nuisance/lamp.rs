//! A lamp that is not centred, and whose brightness drifts.

use crate::scene::camera::Camera;
use crate::scene::seeded::{mixed, normal_of};
use serde::{Deserialize, Serialize};

/// Light that decreases around a point beside the middle of the image.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightCentre {
    /// The brightest point, from the middle of the image.
    pub u_px: f64,
    pub v_px: f64,
    /// Loss at half the diagonal of the image from there, 0 to 1. It grows with the square of the distance.
    pub falloff: f64,
}

impl LightCentre {
    pub fn shade(&self, light: &mut [[f32; 3]], camera: &Camera) {
        if self.falloff == 0.0 {
            return;
        }
        let (width, height) = (camera.width as usize, camera.height as usize);
        let middle = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
        let corner = middle.0.hypot(middle.1).max(1.0);
        for (i, pixel) in light.iter_mut().enumerate() {
            let (du, dv) = ((i % width) as f64 - middle.0 - self.u_px, (i / width) as f64 - middle.1 - self.v_px);
            let left = (1.0 - self.falloff * (du * du + dv * dv) / (corner * corner)).max(0.0) as f32;
            *pixel = pixel.map(|p| p * left);
        }
    }
}

/// A lamp that warms up over a run. Level and colour approach an end value, and each exposure flickers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Drift {
    /// Final relative change of the level.
    pub level: f64,
    /// Final relative gain of red, and loss of blue.
    pub colour: f64,
    /// Time constant of the change, in exposures.
    pub exposures: f64,
    /// Relative standard deviation of the level of each exposure.
    pub flicker: f64,
}

impl Default for Drift {
    fn default() -> Self {
        Self { level: 0.0, colour: 0.0, exposures: 21.0, flicker: 0.0 }
    }
}

impl Drift {
    /// Factors on red, green and blue.
    fn factors(&self, number: u64, seed: u64) -> [f64; 3] {
        let done = 1.0 - (-(number as f64) / self.exposures.max(1e-9)).exp();
        let flicker = self.flicker * f64::from(normal_of(mixed(mixed(seed ^ 0xF11C) ^ number)));
        let level = (1.0 + self.level * done) * (1.0 + flicker);
        [1.0, 0.0, -1.0].map(|side| (level * (1.0 + self.colour * done * side)).max(0.0))
    }

    pub fn apply(&self, light: &mut [[f32; 3]], number: u64, seed: u64) {
        if (self.level, self.colour, self.flicker) == (0.0, 0.0, 0.0) {
            return;
        }
        let factors = self.factors(number, seed).map(|f| f as f32);
        for pixel in light {
            *pixel = std::array::from_fn(|k| pixel[k] * factors[k]);
        }
    }
}
