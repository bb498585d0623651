//! Phantoms in the emulated capillary, well by well.

use super::{Args, Before, Job};
use crate::cancel::CancelToken;
use crate::cli::emulated;
use crate::config::Config;
use crate::device::DeviceError;
use crate::device::sampler::{Expected, Loaded, Sampler};
use hardware_sim::scene::{Scene, SceneSettings, Specimen};
use std::collections::BTreeSet;
use std::sync::Arc;

/// A scene that is filled by the plate map.
pub fn of_phantoms(args: &Args, config: &Config) -> Before {
    let scene = Arc::new(Scene::new(scene_settings(config)));
    let sampler = SceneSampler { scene: scene.clone(), empty: args.empty.iter().cloned().collect() };
    Before { sight: scene, sampler: Box::new(sampler), job: if args.no_demo { Job::Serve } else { Job::Demo } }
}

/// The scene is seen by the camera that the configuration describes.
fn scene_settings(config: &Config) -> SceneSettings {
    let camera = emulated::scene_camera(&config.optics);
    SceneSettings { camera, ..SceneSettings::default() }
}

/// Fills the emulated capillary by the plate map.
struct SceneSampler {
    scene: Arc<Scene>,
    empty: BTreeSet<String>,
}

/// Diameter of the simulated beads, um.
const BEAD_UM: f64 = 500.0;

/// Larvae of a plate differ, and the same well gives the same larva each time.
fn seed_of(well: &str) -> u64 {
    well.bytes().fold(7, |seed, b| seed * 31 + u64::from(b))
}

impl Sampler for SceneSampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    fn load(&mut self, expected: Expected<'_>, _cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
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
        self.scene.load(specimen).map_err(|e| refused(&e))?;
        Ok(Some(Loaded { truth }))
    }

    fn eject(&mut self, well: &str) -> Result<(), DeviceError> {
        self.scene.load(None).map_err(|e| DeviceError::Sampler { well: well.to_owned(), why: e.to_string() })
    }
}
