//! The camera and method of an imported recording, from files or defaults, with their origin.
//!
//! ```text
//!  --config, --cameras, --method ── load ── Sources ── rig ── Rig: the camera for pictures of one size
//! ```

use super::Args;
use crate::cli::segment::{self, input::Kind};
use crate::config::{Config, references};
use anyhow::{Context, bail, ensure};
use carved_core::frame::RawFrame;
use carved_core::geometry::{Camera, GlassTube};
use carved_core::measure::references::References;
use carved_records::Method;
use serde::Deserialize;
use std::f64::consts::PI;
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;

/// The keys of camera.json. Unknown keys are reported, because a misspelt key would silently get its default.
const KEYS: [&str; 16] =
    ["f", "kx", "ky", "ux", "uy", "s", "alpha", "gamma", "phi", "width", "height", "glass", "omega", "views", "pixel_convention", "model"];

/// What the files and options say, whatever the size of the pictures.
pub(super) struct Sources {
    config: Option<Config>,
    psi: Option<Psi>,
    method_name: String,
    /// The method. Its `asd` is not set yet.
    method: Method,
    references: Arc<[References]>,
    /// Sense of the axis, 1 or -1. `None` if no file states it.
    pub sense: Option<f64>,
}

#[derive(Debug)]
pub(super) struct Rig {
    pub name: String,
    pub camera: Camera,
    /// Origin of the camera, in words.
    pub camera_from: String,
    pub method_name: String,
    /// The method. Its `asd` is not set yet.
    pub method: Method,
    pub empty: Option<Arc<RawFrame>>,
    pub references: Arc<[References]>,
}

#[derive(Deserialize)]
pub(in crate::cli) struct Psi {
    #[serde(flatten)]
    camera: Camera,
    omega: Option<Vec<f64>>,
}

pub(super) fn load(args: &Args, warn: &mut dyn FnMut(String)) -> anyhow::Result<Sources> {
    let config = args.config.as_deref().map(Config::load).transpose()?;
    let psi = args.cameras.as_deref().map(|file| psi(file, warn).with_context(|| format!("--cameras {}", file.display()))).transpose()?;
    let (method_name, mut method) = method(args, config.as_ref())?;
    if let Some(epsilon) = args.epsilon {
        ensure!((0.0..0.5).contains(&epsilon), "--epsilon is {epsilon}; expected 0 up to, not including, 0.5");
        method.epsilon = epsilon;
    }
    if let Some(voxel_um) = args.voxel {
        method.voxel_um = voxel_um;
    }
    if let Some(file) = &args.settings {
        method.segment = segment::read_settings(file)?;
    }
    let references = config.as_ref().map_or_else(references::embedded, |c| Ok(c.references.clone()))?;
    let sense = config.as_ref().map(|c| f64::from(i8::from(c.acquisition.sense)));
    Ok(Sources { config, psi, method_name, method, references, sense })
}

impl Sources {
    /// Angles in the file of the camera, rad.
    pub fn omega(&self) -> Option<&[f64]> {
        self.psi.as_ref()?.omega.as_deref()
    }

    /// The method and its name. Its `asd` is not set yet.
    pub fn method(&self) -> (&str, &Method) {
        (&self.method_name, &self.method)
    }

    /// The folder of the configuration's runs.
    pub fn data_dir(&self) -> Option<&Path> {
        self.config.as_ref().map(|c| c.store.data_dir.as_path())
    }

    /// The rig that took pictures of this kind.
    pub fn rig(&self, args: &Args, kind: Kind, warn: &mut dyn FnMut(String)) -> anyhow::Result<Rig> {
        let (mut camera, camera_from) = match (&self.psi, &self.config, &args.config, &args.cameras) {
            (Some(psi), _, _, Some(file)) => (psi.camera.clone(), file.display().to_string()),
            (_, Some(config), Some(file), _) => {
                let from = format!("[optics] of {}", file.display());
                match cropped(&config.optics, kind) {
                    Some(camera) => {
                        let whole = &config.optics;
                        warn(format!(
                            "{from}: the pictures have {} of the camera's {} rows; they are taken for a crop with the axis in its middle",
                            kind.height, whole.height
                        ));
                        (camera, format!("{from}, cropped to {} rows", kind.height))
                    }
                    None => (config.optics.clone(), from),
                }
            }
            _ => {
                warn(
                    "no --cameras and no --config: the camera is taken to be the published rig's, 5.5 um per px, the axis in the picture's \
                     middle; 1 % of scale is 3 % of volume"
                        .into(),
                );
                (Camera::published(kind.width, kind.height), "nominal, 5.5 um per px".into())
            }
        };
        ensure!(
            (camera.width, camera.height) == (kind.width, kind.height),
            "{camera_from}: the camera has {} x {} px, the pictures {} x {} px",
            camera.width,
            camera.height,
            kind.width,
            kind.height
        );
        // A camera's file rarely describes the glass. Pictures of larvae in a capillary are taken through it all the same.
        let otherwise = || self.config.as_ref().map_or_else(|| Some(thin_glass(&camera)), |config| config.optics.glass);
        camera.glass = camera.glass.or_else(otherwise).filter(|tube| !tube.is_clear());
        Ok(Rig {
            name: self.config.as_ref().map_or_else(|| "imported".into(), |c| c.rig_name.clone()),
            camera,
            camera_from,
            method_name: self.method_name.clone(),
            method: self.method.clone(),
            references: self.references.clone(),
            empty: self.config.as_ref().and_then(|c| c.empty_capillary.clone()),
        })
    }
}

/// The vendor's capillary with a thin wall, in water. `ky` above `kx` shows that it is in air.
fn thin_glass(camera: &Camera) -> GlassTube {
    /// `ky / kx` is 1 in water and 1.333 in air.
    const IN_AIR_FROM: f64 = 1.2;
    if camera.ky / camera.kx < IN_AIR_FROM { GlassTube::THIN } else { GlassTube { outside: 1.0, ..GlassTube::THIN } }
}

/// The camera of pictures that VAST has cut above and below the capillary, which it puts into the middle. `None` if they are not cut.
fn cropped(whole: &Camera, kind: Kind) -> Option<Camera> {
    let is_crop = kind.width == whole.width && kind.height < whole.height;
    is_crop.then(|| Camera { height: kind.height, uy: (f64::from(kind.height) - 1.0) / 2.0, ..whole.clone() })
}

fn psi(file: &Path, warn: &mut dyn FnMut(String)) -> anyhow::Result<Psi> {
    let text = carved_files::read_to_string(file).context("cannot be read as text")?;
    let (psi, unknown) = parse(&text)?;
    if !unknown.is_empty() {
        warn(format!("--cameras {}: {} is no key of a camera and was not used", file.display(), unknown.join(", ")));
    }
    Ok(psi)
}

/// A camera with its angles, and the keys of the text that are none of a camera.
pub(in crate::cli) fn parse(text: &str) -> anyhow::Result<(Psi, Vec<String>)> {
    // An editor of Windows begins a file with a byte order mark.
    let text = text.trim_start_matches('\u{feff}');
    let psi: Psi =
        serde_json::from_str(text).context("expected an object with f, kx, ky, ux, uy, width, height and the angles omega (rad)")?;
    psi.camera.check()?;
    plausible(&psi.camera)?;
    if let Some(angle) = psi.omega.iter().flatten().find(|a| !a.is_finite()) {
        bail!("omega holds {angle}, expected finite numbers of rad");
    }
    let object: serde_json::Map<String, serde_json::Value> = serde_json::from_str(text)?;
    let unknown = object.into_iter().map(|(key, _)| key).filter(|key| !KEYS.contains(&key.as_str())).collect();
    Ok((psi, unknown))
}

/// Plausible scales: from a twentieth of the resolution of VAST's cameras to a pixel of a tenth of a capillary.
const UM_PER_PX: RangeInclusive<f64> = 0.25..=100.0;
/// Plausible distances: from the nearest objective to a telecentric one.
const DISTANCE_UM: RangeInclusive<f64> = 5e3..=1e9;
/// A capillary is parallel to the picture's rows, or nearly so.
const MOST_TILT_RAD: f64 = 0.5;

/// Checks that a camera can look at a capillary. Values in another unit would also give numbers, but wrong ones.
fn plausible(camera: &Camera) -> anyhow::Result<()> {
    let Camera { f, kx, ky, ux, uy, s, alpha, gamma, phi, width, height, glass: _ } = *camera;
    let (least, most) = (UM_PER_PX.start(), UM_PER_PX.end());
    for (name, k) in [("kx", kx), ("ky", ky)] {
        let um_per_px = 1.0 / k;
        ensure!(
            UM_PER_PX.contains(&um_per_px),
            "{name} is {k} px per um, so that a pixel is {um_per_px:.3e} um; expected {least} to {most} um: is it in px per um?"
        );
    }
    ensure!((0.5..=2.0).contains(&(kx / ky)), "kx is {kx} and ky {ky} px per um; expected scales that differ by less than a factor of 2");
    ensure!(
        DISTANCE_UM.contains(&f),
        "f is {f} um between projection centre and axis; expected {} to {:e} um: is it in mm?",
        DISTANCE_UM.start(),
        DISTANCE_UM.end()
    );
    let (w, h) = (f64::from(width), f64::from(height));
    ensure!((0.0..h).contains(&uy), "uy is {uy} px; expected a row of the picture, 0 to {}: the axis is in view", h - 1.0);
    ensure!((-w..2.0 * w).contains(&ux), "ux is {ux} px; expected {} to {}, no more than a picture beside the picture", -w, 2.0 * w);
    ensure!(s.abs() <= kx, "s is {s} px per um; expected no more than kx, {kx}");
    for (name, found) in [("alpha", alpha), ("gamma", gamma)] {
        ensure!(
            found.abs() <= MOST_TILT_RAD,
            "{name} is {found} rad, {:.1} deg; expected -{MOST_TILT_RAD} to {MOST_TILT_RAD} rad: is it in degrees?",
            found.to_degrees()
        );
    }
    ensure!((0.0..=PI).contains(&phi), "phi is {phi} rad; expected 0 to {PI:.4}, nominally {:.4}: is it in degrees?", PI / 2.0);
    Ok(())
}

/// The configuration's method, or that of the emulated rig.
fn method(args: &Args, config: Option<&Config>) -> anyhow::Result<(String, Method)> {
    let Some(config) = config else {
        ensure!(args.method.is_none(), "--method names a method of a configuration; give --config too");
        let method = Method {
            version: None,
            asd: 0,
            order: carved_records::ViewOrder::Sequential,
            epsilon: 0.05,
            voxel_um: 6.93,
            box_um: carved_core::geometry::BoxUm::PAPER,
            sweep: carved_records::SweepSettings::default(),
            segment: carved_core::profile::SegmentSettings::default(),
            surface: carved_core::reconstruction::SurfaceSettings::default(),
            calibration: carved_core::reconstruction::CalibrationSettings::default(),
            policy: carved_records::Policy::default(),
            quality: carved_core::quality::QualitySettings::default(),
            early_stop: carved_core::quality::EarlyStopSettings::default(),
        };
        return Ok(("imported".into(), method));
    };
    let known = || config.methods.keys().cloned().collect::<Vec<_>>().join(", ");
    let name = match (&args.method, config.methods.len()) {
        (Some(name), _) => name.clone(),
        (None, 1) => config.methods.keys().next().cloned().unwrap_or_default(),
        (None, _) => bail!("--config has several methods ({}); say which with --method", known()),
    };
    let method = config.methods.get(&name).with_context(|| format!("--method {name}: the configuration has {}", known()))?;
    Ok((name, method.clone()))
}
