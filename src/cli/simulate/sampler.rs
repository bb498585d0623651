//! The sampler of the emulated capillary: the simulation itself, the plate-loader, or an emulated sampler with its own wire.
//!
//! ```text
//!   built-in   load ──► scene
//!   loader     load ── PUT .../wells/{well} ──► scene
//!   trigger    load ── the emulated sampler gets the specimen ── loads it: scene, wire ──► seen through the firmware
//! ```

use super::scenery::Scenery;
use crate::config::{Config, SamplerDriver};
use carved_devices::cancel::CancelToken;
use carved_devices::forward_sampler;
use carved_devices::sampler::{Expected, Loaded, Sampler, TriggerSettings};
use carved_devices::{DeviceError, RotationAxis};
use hardware_sim::sampler::Next;
use hardware_sim::scene::Contents;
use hardware_sim::{SamplerSettings, VendorSampler};
use std::sync::Arc;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Who {
    /// The simulation fills the capillary at once.
    BuiltIn,
    /// The plate-loader reports that it has loaded the specimen, and the simulation follows.
    Loader,
    /// An emulated external sampler, on wires of the emulated Grbl controller.
    Trigger,
}

impl Who {
    /// Configures how the daemon learns of a specimen. Only `Trigger` changes the configuration.
    pub fn configure(self, config: &mut Config, time_scale: f64) {
        if self == Self::Trigger {
            let usual = TriggerSettings::default();
            let debounce_ms = (f64::from(usual.debounce_ms) / time_scale).ceil() as u32;
            config.sampler = SamplerDriver::Trigger(TriggerSettings { debounce_ms, done_output: true, ..usual });
        }
    }

    pub fn emulated(self, time_scale: f64) -> Option<SamplerSettings> {
        let usual = SamplerSettings::default();
        // At any speed-up the empty capillary must be visible for some time.
        let load_s = usual.load_s.max(0.2 * time_scale);
        (self == Self::Trigger).then_some(SamplerSettings { load_s, ..usual })
    }
}

/// An external machine or person fills the capillary, and the scene follows.
pub struct Outside {
    pub daemons: Box<dyn Sampler>,
    pub scenery: Scenery,
    /// The emulated sampler. `None` if the plate-loader brings the specimens.
    pub machine: Option<Arc<VendorSampler>>,
}

impl Sampler for Outside {
    forward_sampler!(daemons: waits_for_loader, brings_again, begin_run, look, has_sensor, sees_specimen, next_well, wash);

    fn load(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let (contents, truth) = self.scenery.contents(expected)?;
        if let Some(machine) = &self.machine {
            let (brought, taken) = (self.scenery.scene().clone(), self.scenery.scene().clone());
            let well = expected.well.to_owned();
            let bring =
                move || brought.load(contents).unwrap_or_else(|error| tracing::error!(%error, well, "the scene refuses a specimen"));
            let take_away =
                move || taken.load(Contents::default()).unwrap_or_else(|error| tracing::error!(%error, "the scene stays as it is"));
            machine.give(Next { bring: Box::new(bring), take_away: Box::new(take_away) });
            return Ok(self.daemons.load(axis, expected, cancel)?.map(|_| truth));
        }
        let loaded = self.daemons.load(axis, expected, cancel)?;
        if loaded.is_some() {
            self.scenery.fill(expected.well, contents)?;
        }
        Ok(loaded.map(|_| truth))
    }

    fn go_on(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let (contents, truth) = self.scenery.contents(expected)?;
        let there = self.daemons.go_on(axis, expected, cancel)?;
        if there.is_some() && self.machine.is_none() {
            self.scenery.fill(expected.well, contents)?;
        }
        Ok(there.map(|_| truth))
    }

    fn eject(&mut self, axis: &mut dyn RotationAxis, well: &str, cancel: &CancelToken) -> Result<(), DeviceError> {
        self.daemons.eject(axis, well, cancel)?;
        if self.machine.is_some() { Ok(()) } else { self.scenery.fill(well, Contents::default()) }
    }
}
