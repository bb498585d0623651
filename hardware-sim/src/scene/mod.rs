//! What the emulated camera sees: a specimen in a glass capillary, in bright field, with exact ground truth.
//!
//! ```text
//!   SceneSettings -> Scene --load(contents)--> [ capillary + specimens + clutter ] <--angle-- the emulated axis
//!                      |                               |
//!                      |   render(angle, number)       v
//!                      +--> phantom parts -> raster -> transmission -> blur -> nuisances -> noise -> Rgb -> Bayer
//!                      +--> truth_mask(angle), truth_edge(angle): of the specimens     specimen.truth(): volume, area, hull
//! ```
//! All emulated devices share one scene, so the image follows the motion of the axis.

pub mod camera;
pub mod capillary;
pub mod contents;
pub mod fluorescence;
pub mod frame_set;
pub mod image;
pub mod ink;
pub mod nuisance;
pub mod optics;
pub mod outline;
pub mod phantom;
mod real;
pub mod seeded;

pub use camera::Camera;
pub use capillary::{Capillary, Wall};
pub use contents::Contents;
pub use fluorescence::{Fluorescent, FluorescentSettings};
pub use image::{Coverage, Rgb};
pub use ink::InkDot;
pub use nuisance::{Drift, Dust, HotPixels, LightCentre, Marks, Motion, Nuisances};
pub use optics::Optics;
pub use outline::Outline;
pub use phantom::{Bladder, Condition, Larva, Look, Mesh, Narrowest, Placement, PlacementError, Specimen, Truth};
pub use real::NOISE as REAL_NOISE;

use nuisance::Turned;
use optics::{Window, background, blur_reach, blurred, covered, exposed, thickness, transmission};
use phantom::{Material, Part, Within};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, PoisonError, RwLock};

/// All parameters of a scene except its contents.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneSettings {
    pub camera: Camera,
    pub capillary: Capillary,
    pub optics: Optics,
    pub nuisances: Nuisances,
}

/// One exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// True angle of the axis, rad. It may differ from the commanded angle.
    pub angle_rad: f64,
    /// Number of the exposure. The same number and angle give the same noise.
    pub number: u64,
}

/// Samples per pixel of a frame, along and across the capillary. Most edges run along the capillary, so it is finer across.
const FRAME_SAMPLES: (usize, usize) = (2, 4);
/// Longest way of an edge between two instants of an exposure that are averaged.
const BLUR_STEP_PX: f64 = 0.1;
/// Most instants of an exposure. A faster shaft makes steps in the blur instead of a rig that stands.
const BLUR_SAMPLES: usize = 64;
/// Samples per pixel of a mask: 64 levels of coverage.
const MASK_SAMPLES: (usize, usize) = (8, 8);

/// The capillary with its contents. Different threads may load and render.
#[derive(Debug)]
pub struct Scene {
    settings: SceneSettings,
    /// The image of the empty capillary before and after blur.
    sharp: Vec<[f32; 3]>,
    soft: Vec<[f32; 3]>,
    loaded: RwLock<Loaded>,
}

/// The contents of the capillary in scene coordinates, and their shift along x.
#[derive(Debug, Default)]
struct Loaded {
    contents: Arc<Contents>,
    shift_um: f64,
}

impl Scene {
    /// A scene with an empty capillary.
    pub fn new(settings: SceneSettings) -> Self {
        let mut sharp = background(&settings.camera, &settings.capillary, &settings.optics);
        settings.nuisances.shade_field(&mut sharp, &settings.camera, &settings.capillary, settings.optics.blur_px);
        let soft = blurred(&sharp, settings.camera.width as usize, settings.optics.blur_px);
        Self { settings, sharp, soft, loaded: RwLock::default() }
    }

    /// Replaces the contents of the capillary: one specimen, several with clutter, or none (`None` empties it).
    ///
    /// # Errors
    /// A part of the contents lies outside the bore. The earlier contents then stay.
    pub fn load(&self, contents: impl Into<Contents>) -> Result<(), PlacementError> {
        let settled = contents.into().settled(self.settings.capillary.bore_radius_um())?;
        let mut loaded = self.loaded.write().unwrap_or_else(PoisonError::into_inner);
        loaded.contents = Arc::new(settled.shifted(loaded.shift_um));
        Ok(())
    }

    /// Moves the capillary and its contents to `shift_um` along x. The camera stays.
    pub fn slide_to(&self, shift_um: f64) {
        let mut loaded = self.loaded.write().unwrap_or_else(PoisonError::into_inner);
        let by_um = shift_um - loaded.shift_um;
        // A rounding error is not a move.
        if by_um.abs() > 1e-6 {
            loaded.contents = Arc::new(Contents::clone(&loaded.contents).shifted(by_um));
            loaded.shift_um = shift_um;
        }
    }

    pub fn settings(&self) -> &SceneSettings {
        &self.settings
    }

    /// The contents, in scene coordinates.
    pub fn contents(&self) -> Arc<Contents> {
        Arc::clone(&self.loaded.read().unwrap_or_else(PoisonError::into_inner).contents)
    }

    /// The true values of the specimen. `None` if there is no specimen or more than one.
    pub fn truth(&self) -> Option<Truth> {
        match self.contents().specimens.as_slice() {
            [one] => Some(one.truth()),
            _ => None,
        }
    }

    /// The frame that the camera takes.
    pub fn render(&self, exposure: &Exposure) -> Rgb {
        self.developed(self.lit(&self.contents(), exposure.angle_rad), exposure.number)
    }

    /// The frame of an exposure during which the axis turns. `path_rad` is the angle at a part of the exposure, from 0 to 1. The light
    /// of so many instants is averaged that nothing moves by more than [`BLUR_STEP_PX`] between two of them.
    pub fn render_along(&self, path_rad: &dyn Fn(f64) -> f64, number: u64) -> Rgb {
        let contents = self.contents();
        let camera = &self.settings.camera;
        let turned_rad = (path_rad(0.5) - path_rad(0.0)).abs() + (path_rad(1.0) - path_rad(0.5)).abs();
        let way_px = turned_rad * self.turning_radius_um(&contents) * camera.kx_px_per_um.max(camera.ky_px_per_um);
        let samples = ((way_px / BLUR_STEP_PX).ceil() as usize).clamp(1, BLUR_SAMPLES);
        let at = |i: usize| self.lit(&contents, path_rad((i as f64 + 0.5) / samples as f64));
        let mut light = at(0);
        for i in 1..samples {
            light.iter_mut().zip(at(i)).for_each(|(sum, one)| (0..3).for_each(|k| sum[k] += one[k]));
        }
        if samples > 1 {
            light.iter_mut().flatten().for_each(|value| *value /= samples as f32);
        }
        self.developed(light, number)
    }

    /// Largest distance from the axis of anything visible that turns, um.
    fn turning_radius_um(&self, contents: &Contents) -> f64 {
        let SceneSettings { capillary, nuisances, .. } = &self.settings;
        if capillary.ink.is_some() || nuisances.turn_with_the_glass() {
            return capillary.outer_radius_um();
        }
        contents.all().flat_map(Specimen::points).map(|[_, y, z]| y.hypot(*z)).fold(0.0, f64::max)
    }

    /// The frame of this light on the sensor, with noise.
    fn developed(&self, light: Vec<[f32; 3]>, number: u64) -> Rgb {
        let SceneSettings { camera, optics, nuisances, .. } = &self.settings;
        let width = camera.width as usize;
        let light = nuisances.disturb(light, width, number);
        Rgb { width: camera.width, height: camera.height, data: exposed(&light, width, optics, number) }
    }

    /// The light on the sensor with the contents in place.
    fn lit(&self, contents: &Contents, angle_rad: f64) -> Vec<[f32; 3]> {
        let SceneSettings { camera, capillary, optics, nuisances } = &self.settings;
        let width = camera.width as usize;
        let mut marked = nuisances.marked(&self.sharp, &Turned { camera, capillary, blur_px: optics.blur_px, angle_rad });
        if let Some(ink) = &capillary.ink {
            let light = marked.get_or_insert_with(|| self.sharp.clone());
            ink.shade(light, camera, capillary.outer_radius_um(), optics, angle_rad);
        }
        match marked {
            Some(marked) => self.lit_before(&marked, blurred(&marked, width, optics.blur_px), contents, angle_rad),
            None => self.lit_before(&self.sharp, self.soft.clone(), contents, angle_rad),
        }
    }

    /// The light with the contents. `sharp` is the image of the empty capillary before blur, `soft` the image after it.
    fn lit_before(&self, sharp: &[[f32; 3]], mut soft: Vec<[f32; 3]>, contents: &Contents, angle_rad: f64) -> Vec<[f32; 3]> {
        let SceneSettings { camera, optics, .. } = &self.settings;
        let view = camera.view(angle_rad);
        let reach = blur_reach(optics.blur_px);
        // Twice the reach of the blur. The contents change the inner half, and the blur needs the outer half.
        let window = self.window(contents.all(), angle_rad, 2 * reach as i64 + 2, FRAME_SAMPLES);
        // The contents are outside the image.
        let Some(window) = window else { return soft };
        let parts: Vec<_> = contents.all().flat_map(|specimen| passages(specimen, &view, camera.f_um, &window)).collect();
        let spots: Vec<_> = contents.all().flat_map(|specimen| specimen.spots.iter().copied()).collect();
        let mut block = transmission(&parts, &spots, camera, &view, optics, &window);
        let width = camera.width as usize;
        let start = |row: usize| (window.v0 as usize + row) * width + window.u0 as usize;
        for (row, pixels) in block.chunks_mut(window.width).enumerate() {
            for (pixel, light) in pixels.iter_mut().zip(&sharp[start(row)..]) {
                for k in 0..3 {
                    pixel[k] *= light[k];
                }
            }
        }
        let block = blurred(&block, window.width, optics.blur_px);
        // The border of the block was blurred without its neighbours. There the empty image is used, except at the border of the sensor.
        let (w, h) = (window.width, window.height);
        let rows = if window.v0 == 0 { 0 } else { reach }..if window.v0 as usize + h == camera.height as usize { h } else { h - reach };
        let columns = if window.u0 == 0 { 0 } else { reach }..if window.u0 as usize + w == width { w } else { w - reach };
        for row in rows {
            let to = start(row);
            soft[to + columns.start..to + columns.end].copy_from_slice(&block[row * w + columns.start..row * w + columns.end]);
        }
        soft
    }

    /// The part of each pixel that the specimens cover, with their fins and without clutter.
    pub fn truth_mask(&self, angle_rad: f64) -> Coverage {
        let camera = &self.settings.camera;
        let width = camera.width as usize;
        let mut data = vec![0u8; width * camera.height as usize];
        let contents = self.contents();
        if let Some(window) = self.window(contents.specimens.iter(), angle_rad, 1, MASK_SAMPLES) {
            let view = camera.view(angle_rad);
            let parts: Vec<_> = contents.specimens.iter().flat_map(|specimen| &specimen.parts).collect();
            let planes: Vec<_> = parts.par_iter().map(|part| thickness(&part.mesh, &view, camera.f_um, &window)).collect();
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

    /// The outlines of the visible specimens, px. They are exact for the meshes.
    pub fn truth_edge(&self, angle_rad: f64) -> Vec<Outline> {
        self.edge_of(angle_rad, |_| true)
    }

    /// The outlines without outgrowths, px. They are those of the body of a larva, for comparison with methods that cannot detect the
    /// faint fin fold.
    pub fn body_edge(&self, angle_rad: f64) -> Vec<Outline> {
        self.edge_of(angle_rad, |part| part.within_body == Within::Added)
    }

    fn edge_of(&self, angle_rad: f64, counts: impl Fn(&Part) -> bool) -> Vec<Outline> {
        let camera = &self.settings.camera;
        let contents = self.contents();
        let parts = contents.specimens.iter().flat_map(|specimen| &specimen.parts).filter(|part| counts(part));
        outline::outlines(parts.map(|part| &part.mesh), &camera.view(angle_rad), (camera.width, camera.height))
    }

    /// The pixels that contain any of the specimens.
    fn window<'a>(
        &self,
        specimens: impl Iterator<Item = &'a Specimen>,
        angle_rad: f64,
        margin: i64,
        samples: (usize, usize),
    ) -> Option<Window> {
        let camera = &self.settings.camera;
        let view = camera.view(angle_rad);
        let seen = specimens.flat_map(Specimen::points).map(|&v| {
            let p = view.project(v);
            [p.u_px, p.v_px]
        });
        Window::around(seen, margin, (camera.width, camera.height), samples)
    }
}

/// Thickness of each part of a specimen along the rays of the window's samples, with its material.
fn passages(specimen: &Specimen, view: &camera::View, reference_depth_um: f64, window: &Window) -> Vec<(Vec<f32>, Material)> {
    let mut parts: Vec<_> =
        specimen.parts.par_iter().map(|part| (thickness(&part.mesh, view, reference_depth_um, window), part.material)).collect();
    if let Some(((body, _), others)) = parts.split_first_mut() {
        for ((plane, _), part) in others.iter_mut().zip(&specimen.parts[1..]) {
            if part.within_body == Within::Replaced {
                // This is exact if one passage contains the other, as for a plate and the body on which it grows.
                plane.iter_mut().zip(&*body).for_each(|(own, body)| *own = (*own - body).max(0.0));
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests;
