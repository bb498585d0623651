//! Phantoms in the emulated capillary, by well.

use super::holds::Surprise;
use super::{Args, Before, Content, Job};
use crate::cli::emulated;
use crate::config::Config;
use carved_devices::cancel::CancelToken;
use carved_devices::sampler::{Expected, Loaded, Sampler};
use carved_devices::{DeviceError, RotationAxis};
use carved_store::EVENTS;
use hardware_sim::scene::phantom::LarvaError;
use hardware_sim::scene::{Contents, Scene, SceneSettings, Specimen};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// How the emulated frames look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Appearance {
    /// The clean reference scene.
    Clean,
    /// Light, walls, dust and larvae as on frames of a real VAST.
    Real,
}

/// A scene that is filled according to the plate map.
pub fn of_phantoms(args: &Args, config: &Config) -> Before {
    let scenery = scenery(args, config);
    Before { sight: scenery.scene.clone(), content: Content::Scene(scenery), job: if args.no_demo { Job::Serve } else { Job::Demo } }
}

/// The scene and the contents of the wells.
pub fn scenery(args: &Args, config: &Config) -> Scenery {
    let holds = args.holds.iter().map(|h| (h.well.clone(), h.what)).collect();
    Scenery {
        scene: Arc::new(Scene::new(scene_settings(config, args.frames, journal_bytes(&config.store.data_dir)))),
        appearance: args.frames,
        empty: args.empty.iter().cloned().collect(),
        holds,
    }
}

/// Seed of light, walls and dust of a real-looking scene.
const REAL_SEED: u64 = 1;

/// Length of the journal of a data folder. It grows with each start, so a start has other noise than the one before, as a camera has. The first
/// start in a new folder always has the same noise.
fn journal_bytes(data: &Path) -> u64 {
    std::fs::metadata(data.join(EVENTS)).map_or(0, |journal| journal.len())
}

/// The settings of the scene, with the camera of the configuration. The bore is that of the reference scene. Each `noise` is another noise.
fn scene_settings(config: &Config, appearance: Appearance, noise: u64) -> SceneSettings {
    let camera = emulated::scene_camera(&config.optics);
    let mut settings = match appearance {
        Appearance::Clean => SceneSettings { camera, ..SceneSettings::default() },
        Appearance::Real => SceneSettings::real_in(&camera, REAL_SEED),
    };
    settings.optics.noise_seed = settings.optics.noise_seed.wrapping_add(noise);
    settings
}

/// The larva of a well.
fn larva(dpf: u8, seed: u64, appearance: Appearance) -> Result<Specimen, LarvaError> {
    match appearance {
        Appearance::Clean => Specimen::larva(dpf, seed),
        Appearance::Real => Specimen::as_on_a_vast(dpf, seed),
    }
}

/// The contents of the wells of every plate, and the scene in which they appear.
#[derive(Clone)]
pub struct Scenery {
    scene: Arc<Scene>,
    appearance: Appearance,
    empty: BTreeSet<String>,
    holds: BTreeMap<String, Surprise>,
}

/// Fills the emulated capillary according to the plate map.
pub struct SceneSampler(pub Scenery);

/// Diameter of the simulated beads, um.
const BEAD_UM: f64 = 500.0;

/// The larvae of a plate differ, and a well always gives the same larva.
fn seed_of(well: &str) -> u64 {
    well.bytes().fold(7, |seed, b| seed * 31 + u64::from(b))
}

impl Scenery {
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The contents of a well, with their truth.
    pub fn contents(&self, expected: Expected<'_>) -> Result<(Contents, Loaded), DeviceError> {
        let refused = |e: &dyn std::fmt::Display| DeviceError::Sampler { well: expected.well.to_owned(), why: e.to_string() };
        // There are phantoms of 3, 4 and 5 dpf. The nearest one is used for other ages.
        let dpf = expected.dpf.unwrap_or(4.0).round().clamp(3.0, 5.0) as u8;
        let seed = seed_of(expected.well);
        let contents: Contents = if self.empty.contains(expected.well) {
            Contents::default()
        } else if let Some(surprise) = self.holds.get(expected.well) {
            surprise.contents(dpf, seed).map_err(|e| refused(&e))?
        } else if expected.bead {
            Specimen::bead(BEAD_UM).map_err(|e| refused(&e))?.into()
        } else {
            larva(dpf, seed, self.appearance).map_err(|e| refused(&e))?.into()
        };
        // Only a single specimen can be compared with its truth.
        let truth = match contents.specimens.as_slice() {
            [one] => Some(serde_json::to_value(one.truth()).map_err(|e| refused(&e))?),
            _ => None,
        };
        Ok((contents, Loaded { truth }))
    }

    pub fn fill(&self, well: &str, contents: Contents) -> Result<(), DeviceError> {
        self.scene.load(contents).map_err(|e| DeviceError::Sampler { well: well.to_owned(), why: e.to_string() })
    }
}

impl Sampler for SceneSampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    fn brings_again(&self) -> bool {
        true
    }

    fn begin_run(&mut self) {}

    fn look(&mut self, _axis: &mut dyn RotationAxis) -> Result<(), DeviceError> {
        Ok(())
    }

    fn sees_specimen(&self) -> Option<bool> {
        None
    }

    fn load(&mut self, _axis: &mut dyn RotationAxis, expected: Expected<'_>, _cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let (contents, loaded) = self.0.contents(expected)?;
        self.0.fill(expected.well, contents)?;
        Ok(Some(loaded))
    }

    /// After a restart of the emulated rig the specimen is put inside again.
    fn go_on(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        self.load(axis, expected, cancel)
    }

    fn eject(&mut self, _axis: &mut dyn RotationAxis, well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        self.0.fill(well, Contents::default())
    }
    fn wash(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hardware_sim::scene::Capillary;

    #[test]
    fn every_larva_of_the_demo_fits_the_real_looking_bore() {
        let settings = scene_settings(&Config::parse(super::super::CONFIG, Path::new("simulated.toml")).unwrap(), Appearance::Real, 0);
        assert_ne!(settings.capillary, Capillary::default());
        let scene = Scene::new(settings);
        for dpf in 3..=5 {
            for well in ["A01", "A02", "A03", "A04", "B07", "H12", "P24"] {
                let larva = larva(dpf, seed_of(well), Appearance::Real).unwrap();
                scene.load(larva).unwrap_or_else(|why| panic!("{well}, {dpf} dpf: {why}"));
            }
        }
    }
}
