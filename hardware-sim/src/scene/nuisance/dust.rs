//! Dust as VAST frames show it: many small faint specks on the window, on the glass and in the water.
//!
//! ```text
//!       *      .                              window: fixed in the image
//!   ------.----------*-------  outside        glass:  turns with the capillary, at its outer surface
//!    .        *        .                      water:  turns with the capillary, inside the bore
//!   --*-----------.----------  outside
//! ```
//! Each layer is described by the number of specks that the image of the bore contains, so that layers can be compared with counts on
//! real frames. A speck multiplies the light, in front of the contents or behind them.

use super::marks::{Mark, shade};
use crate::scene::camera::Camera;
use crate::scene::capillary::Capillary;
use crate::scene::seeded::{Seeded, mixed};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// The number of specks of a layer per 1000 px of length in the image of the bore.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Dust {
    /// Specks that absorb at least 2 % of the light.
    pub specks_per_1000px: f64,
    /// Specks that absorb 0.4 to 2.4 % of the light. The noise of a single frame nearly hides them.
    pub faint_per_1000px: f64,
}

/// Depth of a visible speck in the image: median and standard deviation of the logarithm, measured on lossless VAST frames, with limits.
const DEPTH_MEDIAN: f64 = 0.045;
const DEPTH_SIGMA: f64 = 0.75;
const DEPTH_LIMITS: [f64; 2] = [0.02, 0.5];
/// Depth of a faint speck.
const FAINT_DEPTH: [f64; 2] = [0.004, 0.024];
/// Distance from the middle of a speck to its border before blur, px: most specks are small. The full width at half maximum is 1.08 of
/// it. The blur adds to it.
const SMALLEST_PX: f64 = 1.5;
const LARGER_PX: f64 = 3.4;
/// Standard deviation of a Gaussian of the same width, in radii.
const SPREAD: f64 = 0.46;
/// A speck absorbs at most this part of the light before blur.
const DARKEST: f64 = 0.95;

/// A speck without its position. The depth is that in the image before blur.
struct Speck {
    radius_px: f64,
    depth: f64,
}

/// How a turning layer is seen.
#[derive(Debug, Clone, Copy)]
pub struct Turned<'a> {
    pub camera: &'a Camera,
    pub capillary: &'a Capillary,
    pub blur_px: f64,
    pub angle_rad: f64,
}

impl Dust {
    /// The density of all layers together that VAST frames have. 76 to 82 visible specks are counted per 1000 px: some overlap, and
    /// noise hides some of the shallowest.
    pub const USUAL: Self = Self { specks_per_1000px: 92.0, faint_per_1000px: 230.0 };

    pub fn none(self) -> bool {
        self.specks_per_1000px <= 0.0 && self.faint_per_1000px <= 0.0
    }

    /// Both densities times `factor`.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { specks_per_1000px: factor * self.specks_per_1000px, faint_per_1000px: factor * self.faint_per_1000px }
    }

    /// Specks of a layer of which the image of the bore shows the part `1 / spread`, over a length of `length_px`.
    fn specks(self, length_px: f64, spread: f64, blur_px: f64, draw: &mut Seeded) -> Vec<Speck> {
        let count = |per_1000px: f64| (per_1000px * spread * length_px / 1000.0).round().max(0.0) as usize;
        let mut specks = Vec::new();
        for _ in 0..count(self.specks_per_1000px) {
            let depth = (DEPTH_MEDIAN * draw.normal(DEPTH_SIGMA).exp()).clamp(DEPTH_LIMITS[0], DEPTH_LIMITS[1]);
            specks.push(Speck::seen(depth, blur_px, draw));
        }
        for _ in 0..count(self.faint_per_1000px) {
            let depth = draw.between(FAINT_DEPTH[0], FAINT_DEPTH[1]);
            specks.push(Speck::seen(depth, blur_px, draw));
        }
        specks
    }

    /// Dust on the window. It covers the whole image.
    pub fn shade_fixed(self, light: &mut [[f32; 3]], camera: &Camera, capillary: &Capillary, blur_px: f64, seed: u64) {
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let mut draw = Seeded::new(mixed(seed ^ 0xD057_0001));
        for speck in self.specks(width, height / bore_px(camera, capillary), blur_px, &mut draw) {
            let at = [draw.between(0.0, width), draw.between(0.0, height)];
            speck.shade(at, light, camera);
        }
    }

    /// Dust on the outside of the glass, over the length that the camera sees.
    pub fn shade_on_glass(self, light: &mut [[f32; 3]], view: &Turned<'_>, seed: u64) {
        let Turned { camera, capillary, blur_px, angle_rad } = *view;
        let outer_um = capillary.outer_radius_um();
        // The bore hides behind four arcs of this length, two of the near side and two of the far side.
        let arc = (capillary.bore_radius_um() / outer_um).asin();
        let mut draw = Seeded::new(mixed(seed ^ 0xD057_0002));
        let view = camera.view(angle_rad);
        for speck in self.specks(f64::from(camera.width), TAU / (4.0 * arc), blur_px, &mut draw) {
            let x = seen_x(camera, &mut draw);
            let (sin, cos) = draw.between(0.0, TAU).sin_cos();
            let p = view.project([x, outer_um * cos, outer_um * sin]);
            speck.shade([p.u_px, p.v_px], light, camera);
        }
    }

    /// Dust in the water of the bore, over the length that the camera sees.
    pub fn shade_in_water(self, light: &mut [[f32; 3]], view: &Turned<'_>, seed: u64) {
        let Turned { camera, capillary, blur_px, angle_rad } = *view;
        let mut draw = Seeded::new(mixed(seed ^ 0xD057_0003));
        let view = camera.view(angle_rad);
        for speck in self.specks(f64::from(camera.width), 1.0, blur_px, &mut draw) {
            let x = seen_x(camera, &mut draw);
            // Uniform over the section of the bore.
            let from_axis = capillary.bore_radius_um() * draw.between(0.0, 1.0).sqrt();
            let (sin, cos) = draw.between(0.0, TAU).sin_cos();
            let p = view.project([x, from_axis * cos, from_axis * sin]);
            speck.shade([p.u_px, p.v_px], light, camera);
        }
    }
}

impl Speck {
    /// A speck that has this depth in the image after blur.
    fn seen(depth: f64, blur_px: f64, draw: &mut Seeded) -> Self {
        let radius_px = SMALLEST_PX + LARGER_PX * draw.between(0.0, 1.0).powi(2);
        let own = (SPREAD * radius_px).powi(2);
        Self { radius_px, depth: (depth * (1.0 + blur_px * blur_px / own)).min(DARKEST) }
    }

    fn shade(&self, at_px: [f64; 2], light: &mut [[f32; 3]], camera: &Camera) {
        let mark = Mark { points_px: vec![at_px], radius_px: self.radius_px, depth: self.depth };
        shade(&mark, light, camera.width as usize);
    }
}

/// Diameter of the bore in the image.
fn bore_px(camera: &Camera, capillary: &Capillary) -> f64 {
    (capillary.bore_diameter_um * camera.ky_px_per_um).max(1.0)
}

/// A random position along the capillary within the image.
fn seen_x(camera: &Camera, draw: &mut Seeded) -> f64 {
    (draw.between(0.0, f64::from(camera.width)) - camera.ux_px) / camera.kx_px_per_um
}
