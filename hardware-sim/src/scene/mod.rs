//! What the emulated camera looks at: a specimen in a glass capillary, in bright field, with exact truth.
//!
//! ```text
//!   SceneSettings -> Scene --load(specimen)--> [ capillary + specimen ] <--angle-- the emulated axis
//!                      |                               |
//!                      |   render(angle, number)       v
//!                      +--> phantom parts -> raster -> transmission -> blur -> noise -> Rgb -> Bayer or grey
//!                      +--> truth_mask(angle): coverage        specimen.truth(): volume, area, hull
//! ```
//! One scene is shared by all emulated devices: what the camera shows follows what the axis did.

pub mod camera;
pub mod capillary;
pub mod image;
pub mod optics;
pub mod phantom;
mod seeded;

pub use camera::Camera;
pub use capillary::Capillary;
pub use image::{Coverage, Rgb};
pub use optics::Optics;
pub use phantom::{Larva, Mesh, Placement, PlacementError, Specimen, Truth};

use optics::{Window, background, blur_reach, blurred, covered, exposed, thickness, transmission};
use phantom::Within;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, PoisonError, RwLock};

/// Everything about a scene but its specimen.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneSettings {
    pub camera: Camera,
    pub capillary: Capillary,
    pub optics: Optics,
}

/// One picture taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Angle of the axis, true, not commanded.
    pub angle_rad: f64,
    /// Number of the exposure: the same number and angle give the same noise.
    pub number: u64,
}

/// Samples per pixel of a frame: finer across the capillary, where most edges run along it.
const FRAME_SAMPLES: (usize, usize) = (2, 4);
/// Samples per pixel of a mask: 64 levels of coverage.
const MASK_SAMPLES: (usize, usize) = (8, 8);

/// The specimen in its capillary. Loading and rendering may happen on different threads.
#[derive(Debug)]
pub struct Scene {
    settings: SceneSettings,
    /// The empty capillary before and after blur.
    sharp: Vec<[f32; 3]>,
    soft: Vec<[f32; 3]>,
    loaded: RwLock<Option<Arc<Specimen>>>,
}

impl Scene {
    /// A scene with an empty capillary.
    pub fn new(settings: SceneSettings) -> Self {
        let sharp = background(&settings.camera, &settings.capillary, &settings.optics);
        let soft = blurred(&sharp, settings.camera.width as usize, settings.optics.blur_px);
        Self { settings, sharp, soft, loaded: RwLock::new(None) }
    }

    /// Swaps what is in the capillary; `None` empties it.
    ///
    /// # Errors
    /// Refuses a specimen that leaves the bore; what was loaded then stays.
    pub fn load(&self, specimen: Option<Specimen>) -> Result<(), PlacementError> {
        let settled = specimen.map(|s| s.settled(self.settings.capillary.bore_radius_um())).transpose()?;
        *self.loaded.write().unwrap_or_else(PoisonError::into_inner) = settled.map(Arc::new);
        Ok(())
    }

    pub fn settings(&self) -> &SceneSettings {
        &self.settings
    }

    /// What is loaded, placed in the bore.
    pub fn specimen(&self) -> Option<Arc<Specimen>> {
        self.loaded.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Truth of what is loaded.
    pub fn truth(&self) -> Option<Truth> {
        self.specimen().map(|s| s.truth())
    }

    /// The frame that the camera takes.
    pub fn render(&self, exposure: &Exposure) -> Rgb {
        let camera = &self.settings.camera;
        let width = camera.width as usize;
        let data = match self.specimen().and_then(|s| self.lit(&s, exposure.angle_rad)) {
            Some(light) => exposed(&light, width, &self.settings.optics, exposure.number),
            None => exposed(&self.soft, width, &self.settings.optics, exposure.number),
        };
        Rgb { width: camera.width, height: camera.height, data }
    }

    /// The light on the sensor with the specimen in place; None where the specimen is out of sight.
    fn lit(&self, specimen: &Specimen, angle_rad: f64) -> Option<Vec<[f32; 3]>> {
        let SceneSettings { camera, optics, .. } = &self.settings;
        let view = camera.view(angle_rad);
        let reach = blur_reach(optics.blur_px);
        // Twice the blur's reach: the inner half is what the specimen changes, the outer half feeds the blur.
        let window = self.window(specimen, angle_rad, 2 * reach as i64 + 2, FRAME_SAMPLES)?;
        let mut parts: Vec<_> =
            specimen.parts.par_iter().map(|part| (thickness(&part.mesh, &view, camera.f_um, &window), part.material)).collect();
        if let Some(((body, _), others)) = parts.split_first_mut() {
            for ((plane, _), part) in others.iter_mut().zip(&specimen.parts[1..]) {
                if part.within_body == Within::Replaced {
                    // Exact where the one's passage holds the other's, as for a plate and the body that it grows from.
                    plane.iter_mut().zip(&*body).for_each(|(own, body)| *own = (*own - body).max(0.0));
                }
            }
        }
        let mut block = transmission(&parts, &specimen.spots, camera, &view, optics, &window);
        let width = camera.width as usize;
        let start = |row: usize| (window.v0 as usize + row) * width + window.u0 as usize;
        for (row, pixels) in block.chunks_mut(window.width).enumerate() {
            for (pixel, light) in pixels.iter_mut().zip(&self.sharp[start(row)..]) {
                for k in 0..3 {
                    pixel[k] *= light[k];
                }
            }
        }
        let block = blurred(&block, window.width, optics.blur_px);
        let mut light = self.soft.clone();
        // The block's rim was blurred without its neighbours: there the empty picture stands, unless the rim is the sensor's.
        let (w, h) = (window.width, window.height);
        let rows = if window.v0 == 0 { 0 } else { reach }..if window.v0 as usize + h == camera.height as usize { h } else { h - reach };
        let columns = if window.u0 == 0 { 0 } else { reach }..if window.u0 as usize + w == width { w } else { w - reach };
        for row in rows {
            let to = start(row);
            light[to + columns.start..to + columns.end].copy_from_slice(&block[row * w + columns.start..row * w + columns.end]);
        }
        Some(light)
    }

    /// How much of each pixel the specimen covers, fins included.
    pub fn truth_mask(&self, angle_rad: f64) -> Coverage {
        let camera = &self.settings.camera;
        let width = camera.width as usize;
        let mut data = vec![0u8; width * camera.height as usize];
        if let Some(specimen) = self.specimen()
            && let Some(window) = self.window(&specimen, angle_rad, 1, MASK_SAMPLES)
        {
            let view = camera.view(angle_rad);
            let planes: Vec<_> = specimen.parts.par_iter().map(|part| thickness(&part.mesh, &view, camera.f_um, &window)).collect();
            let samples = covered(&planes);
            for v in 0..window.height {
                for u in 0..window.width {
                    let inside: usize = (0..window.fine_v)
                        .map(|i| {
                            let first = (v * window.fine_v + i) * window.columns() + u * window.fine_u;
                            samples[first..first + window.fine_u].iter().filter(|&&s| s).count()
                        })
                        .sum();
                    let all = window.fine_u * window.fine_v;
                    data[(window.v0 as usize + v) * width + window.u0 as usize + u] = ((inside * 255 + all / 2) / all) as u8;
                }
            }
        }
        Coverage { width: camera.width, height: camera.height, data }
    }

    fn window(&self, specimen: &Specimen, angle_rad: f64, margin: i64, samples: (usize, usize)) -> Option<Window> {
        let camera = &self.settings.camera;
        let view = camera.view(angle_rad);
        let seen = specimen.parts.iter().flat_map(|part| &part.mesh.vertices).map(|&v| {
            let p = view.project(v);
            [p.u_px, p.v_px]
        });
        Window::around(seen, margin, (camera.width, camera.height), samples)
    }
}

#[cfg(test)]
mod tests;
