//! Phantoms in the emulated capillary, well by well.

use super::{Args, Before, Content, Job};
use crate::cancel::CancelToken;
use crate::cli::emulated;
use crate::config::Config;
use crate::device::sampler::{Expected, Loaded, Sampler};
use crate::device::{DeviceError, RotationAxis};
use hardware_sim::scene::{Scene, SceneSettings, Specimen};
use std::collections::BTreeSet;
use std::sync::Arc;

/// A scene that is filled by the plate map.
pub fn of_phantoms(args: &Args, config: &Config) -> Before {
    let scene = Arc::new(Scene::new(scene_settings(config)));
    let scenery = Scenery { scene: scene.clone(), empty: args.empty.iter().cloned().collect() };
    Before { sight: scene, content: Content::Scene(scenery), job: if args.no_demo { Job::Serve } else { Job::Demo } }
}

/// The scene is seen by the camera that the configuration describes.
fn scene_settings(config: &Config) -> SceneSettings {
    let camera = emulated::scene_camera(&config.optics);
    SceneSettings { camera, ..SceneSettings::default() }
}

/// What lies in the wells of every plate, and where it is seen.
#[derive(Clone)]
pub struct Scenery {
    scene: Arc<Scene>,
    empty: BTreeSet<String>,
}

/// Fills the emulated capillary by the plate map.
pub struct SceneSampler(pub Scenery);

/// Diameter of the simulated beads, um.
const BEAD_UM: f64 = 500.0;

/// Larvae of a plate differ, and the same well gives the same larva each time.
fn seed_of(well: &str) -> u64 {
    well.bytes().fold(7, |seed, b| seed * 31 + u64::from(b))
}

impl Scenery {
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// What a well holds, and its truth.
    pub fn specimen(&self, expected: Expected<'_>) -> Result<(Option<Specimen>, Loaded), DeviceError> {
        let refused = |e: &dyn std::fmt::Display| DeviceError::Sampler { well: expected.well.to_owned(), why: e.to_string() };
        let specimen = if self.empty.contains(expected.well) {
            None
        } else if expected.bead {
            Some(Specimen::bead(BEAD_UM).map_err(|e| refused(&e))?)
        } else {
            // There are phantoms of 3, 4 and 5 dpf: the nearest stands for any other age.
            let dpf = expected.dpf.unwrap_or(4.0).round().clamp(3.0, 5.0) as u8;
            Some(Specimen::larva(dpf, seed_of(expected.well)).map_err(|e| refused(&e))?)
        };
        let truth = specimen.as_ref().map(|s| serde_json::to_value(s.truth())).transpose().map_err(|e| refused(&e))?;
        Ok((specimen, Loaded { truth }))
    }

    pub fn fill(&self, well: &str, specimen: Option<Specimen>) -> Result<(), DeviceError> {
        self.scene.load(specimen).map_err(|e| DeviceError::Sampler { well: well.to_owned(), why: e.to_string() })
    }
}

impl Sampler for SceneSampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    fn load(&mut self, _axis: &mut dyn RotationAxis, expected: Expected<'_>, _cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let (specimen, loaded) = self.0.specimen(expected)?;
        self.0.fill(expected.well, specimen)?;
        Ok(Some(loaded))
    }

    fn eject(&mut self, _axis: &mut dyn RotationAxis, well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        self.0.fill(well, None)
    }
}
