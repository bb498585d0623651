//! `carved setup --simulate`: an emulated rig to try the set-up on. The answers bring its bead into the capillary and take it out again.

use super::bench::Listed;
use super::state::State;
use crate::cli::simulate::controller::{Make, emulated, relay};
use anyhow::Context;
use hardware_sim::scene::{Camera, Contents, Placement, Scene, SceneSettings, Specimen};
use hardware_sim::{Rig, RigSettings, ShaftSettings};
use std::sync::Arc;

/// Diameter of the bead, um.
const BEAD_UM: f64 = 500.0;
/// Distance of the bead from the middle of the capillary, across it, um: it rests on the glass.
const BEAD_ASIDE_UM: f64 = 40.0;
/// Scale, row and roll of the camera. They are not those of the shipped configurations, so that a set-up has something to find.
const UM_PER_PX: f64 = 5.2;
const AXIS_ROW_PX: f64 = 498.0;
const ROLL_RAD: f64 = 0.006;

/// The emulated rig.
pub struct EmulatedRig {
    rig: Rig,
    scene: Arc<Scene>,
    steps: f64,
}

impl EmulatedRig {
    /// Starts it. `time_scale`: speed-up over real time.
    ///
    /// # Errors
    /// An emulated device that cannot be started, and a speed-up that cannot be simulated.
    pub fn start(make: Make, time_scale: f64) -> anyhow::Result<Self> {
        anyhow::ensure!((0.1..=1000.0).contains(&time_scale), "--time-scale is {time_scale}; from 0.1 to 1000 can be simulated");
        let k = 1.0 / UM_PER_PX;
        let camera = Camera { kx_px_per_um: k, ky_px_per_um: k, uy_px: AXIS_ROW_PX, gamma_rad: ROLL_RAD, ..Camera::default() };
        let scene = Arc::new(Scene::new(SceneSettings { camera, ..SceneSettings::default() }));
        let config = make.shipped()?;
        if let Some(Err(why)) = config.rotation.entry().map(|entry| entry.setup.as_ref()) {
            anyhow::bail!("this controller cannot be set up: {why}");
        }
        let [steps, turns] = config.steps_per_revolution.into();
        let settings = RigSettings {
            shaft: ShaftSettings { steps_per_revolution: (steps, turns), ..ShaftSettings::default() },
            time_scale,
            controller: emulated(&config)?,
            relay: relay(&config.rotation),
            ..RigSettings::default()
        };
        let rig = Rig::start(settings, scene.clone()).context("the emulated rig did not start")?;
        Ok(Self { rig, scene, steps: f64::from(steps) / f64::from(turns) })
    }

    /// What the person has to know, as it would be read from labels and certificates.
    pub fn facts(&self) -> String {
        format!(
            "This rig is emulated. Its capillary has an inner diameter of {:.0} um, its bead {BEAD_UM} um, and its motors make {} steps per turn.",
            self.scene.settings().capillary.bore_diameter_um,
            self.steps
        )
    }

    /// The port of its controller.
    pub fn port(&self) -> Listed {
        let serial = || self.rig.serial_path().to_string_lossy().into_owned();
        let name = self.rig.relay_address().map_or_else(serial, |address| address.to_string());
        Listed { label: format!("{name} (emulated)"), name }
    }

    /// Its camera.
    pub fn camera(&self) -> Listed {
        let name = self.rig.camera_address().to_string();
        Listed { label: format!("{name} (emulated)"), name }
    }

    /// Brings the bead where the person says that it is loaded, and flushes the capillary where it is to be empty.
    ///
    /// # Errors
    /// A bead that does not fit into the capillary.
    pub fn follow(&self, state: &State) -> anyhow::Result<()> {
        let is_loaded = !self.scene.contents().specimens.is_empty();
        if state.is_loaded() != is_loaded {
            let contents = if is_loaded {
                Contents::default()
            } else {
                let placement = Placement { y_um: BEAD_ASIDE_UM, ..Placement::default() };
                Specimen::bead(BEAD_UM)?.placed(placement).into()
            };
            self.scene.load(contents)?;
        }
        Ok(())
    }
}
