//! Bright-field light: from lamp to sensor.
//!
//! ```text
//!   lamp -> [ background: uneven light x glass walls ] -> x transmission of the specimen -> blur -> noise -> 8 bits
//!                                                              |
//!            per part: thickness along each ray (raster) -> absorption by Beer-Lambert per colour
//!            all parts: optical path -> its slope bends the ray -> rays that miss the lens give dark rims
//! ```
//! Every number is a parameter. Noise, blur, vignetting and tilt may be 0 for exact tests.

mod background;
mod blur;
mod noise;
mod raster;
mod transmission;

pub(crate) use background::background;
pub(crate) use blur::blurred;
pub(crate) use blur::reach as blur_reach;
pub(crate) use noise::exposed;
pub(crate) use raster::{Window, covered, thickness};
pub(crate) use transmission::transmission;

use serde::{Deserialize, Serialize};

/// Light, lens and sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Optics {
    /// Level of the empty field in its middle, 8-bit units. The default is a bluish white.
    pub light_rgb: [f64; 3],
    /// Loss of light in the corners, 0 to 1.
    pub vignetting: f64,
    /// Slow unevenness of the field, 0 to 1.
    pub unevenness: f64,
    /// Slope of a ray at which half of its light misses the lens, rad.
    pub aperture_rad: f64,
    /// Scattered light that still arrives where all rays miss the lens, 0 to 1.
    pub stray_light: f64,
    /// Light that lens and glass scatter over the whole image and that a specimen cannot absorb, 0 to 1.
    pub veil: f64,
    /// Angle by which the lamp shines from above. Rims are then darker below than above.
    pub lamp_tilt_rad: f64,
    /// Growth of a pigment spot per um out of the focal plane, which contains the axis of the capillary.
    pub defocus_rad: f64,
    /// Standard deviation of the blur of the whole image.
    pub blur_px: f64,
    /// Electrons at level 255, which set the photon noise. 0 switches it off.
    pub full_well_electrons: f64,
    /// Standard deviation of the read noise, 8-bit units.
    pub read_noise: f64,
    pub noise_seed: u64,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            light_rgb: [234.0, 246.0, 250.0],
            vignetting: 0.08,
            unevenness: 0.035,
            aperture_rad: 0.085,
            stray_light: 0.06,
            veil: 0.02,
            lamp_tilt_rad: 0.008,
            defocus_rad: 0.022,
            blur_px: 0.7,
            full_well_electrons: 18_000.0,
            read_noise: 1.0,
            noise_seed: 1,
        }
    }
}

impl Optics {
    /// No noise, no blur, even light: for tests against formulas.
    #[must_use]
    pub fn exact() -> Self {
        Self {
            vignetting: 0.0,
            unevenness: 0.0,
            veil: 0.0,
            lamp_tilt_rad: 0.0,
            defocus_rad: 0.0,
            blur_px: 0.0,
            full_well_electrons: 0.0,
            read_noise: 0.0,
            ..Self::default()
        }
    }

    /// All noise `factor` times as strong. Photon noise is proportional to the inverse square root of the electrons.
    #[must_use]
    pub fn with_noise(self, factor: f64) -> Self {
        let full_well_electrons = self.full_well_electrons / (factor * factor).max(1e-12);
        Self { full_well_electrons, read_noise: self.read_noise * factor, ..self }
    }
}
