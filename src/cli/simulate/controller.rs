//! The controller that turns the emulated capillary, configured as in the shipped file of such an instrument.

use crate::config::Config;
use anyhow::Context;
use carved_core::units::Sense;
use carved_devices::cancel::CancelToken;
use carved_devices::forward_sampler;
use carved_devices::rotation::{AxisLetter, Entry, Example, RotationDriver, TranslationSettings, entry};
use carved_devices::sampler::{Expected, Loaded, Sampler};
use carved_devices::{DeviceError, RotationAxis};
use hardware_sim::{Controller, Rig, SlideSettings, bridge, grbl, relay, tmcl, zaber};
use std::path::Path;

/// Unit of the emulated controller's second axis, um: three decimals must resolve a single step.
const UM_PER_UNIT: u32 = 10;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Make {
    Grbl,
    Tmcl,
    Zaber,
    /// A stock VAST behind its trigger bridge.
    VastBridge,
    /// A stock VAST behind a relay.
    Relay,
    /// A stock VAST whose own program stores pictures in a folder.
    Folder,
}

impl Make {
    /// The driver. `None` where another program turns the capillary.
    fn entry(self) -> Option<&'static Entry> {
        entry(match self {
            Self::Grbl => "grbl",
            Self::Tmcl => "tmcl",
            Self::Zaber => "zaber",
            Self::VastBridge => "vast_bridge",
            Self::Relay => "relay",
            Self::Folder => return None,
        })
    }

    /// The shipped configuration of such an instrument.
    ///
    /// # Errors
    /// It has no controller.
    pub fn shipped(self) -> anyhow::Result<Config> {
        let entry = self.entry().context(
            "another program turns the capillary and takes the pictures: there is no controller to set up; docs/vast-folder.md describes its configuration",
        )?;
        let Example { file, text } = &entry.example;
        Ok(Config::parse(text, &Path::new("config").join(file))?)
    }

    /// Replaces the configured controller and motor steps by its own.
    pub fn configure(self, config: &mut Config, time_scale: f64) -> anyhow::Result<()> {
        // The built-in configuration has the controller Grbl already.
        if matches!(self, Self::Grbl | Self::Folder) {
            return Ok(());
        }
        let shipped = self.shipped()?;
        config.rotation = shipped.rotation;
        config.translation = shipped.translation;
        config.steps_per_revolution = shipped.steps_per_revolution;
        config.backlash_steps = shipped.backlash_steps;
        match &mut config.rotation {
            RotationDriver::VastBridge(settings) => {
                settings.list = config.store.data_dir.join("external.txt");
                settings.speed_deg_per_s = bridge::Settings::reading(settings.list.clone()).speed_deg_per_s * time_scale;
            }
            RotationDriver::Relay(settings) => settings.speed_deg_per_s = relay::Settings::default().speed_deg_per_s * time_scale,
            rotation => hasten(rotation, time_scale),
        }
        Ok(())
    }
}

/// Permits what a driver must permit at this speed-up: both motors of a pair start one after the other, and the same delay gives a larger
/// skew.
pub fn hasten(rotation: &mut RotationDriver, time_scale: f64) {
    if let RotationDriver::Tmcl(settings) = rotation {
        settings.max_skew_steps = (f64::from(settings.max_skew_steps) * time_scale.max(1.0)).ceil() as u32;
    }
}

/// The firmware for the configured driver.
pub fn emulated(config: &Config) -> anyhow::Result<Controller> {
    Ok(match &config.rotation {
        RotationDriver::Tmcl(_) => Controller::Tmcl(tmcl::Settings::default()),
        RotationDriver::Zaber(_) => Controller::Zaber(zaber::Settings::default()),
        RotationDriver::VastBridge(settings) => {
            let machine = bridge::Settings::reading(settings.list.clone());
            machine.knobs.load_list_for_every_specimen();
            Controller::Bridge(machine)
        }
        _ if config.translation.is_some() => Controller::Grbl(with_second_axis(grbl::Settings::default())?),
        _ => Controller::Grbl(grbl::Settings::default()),
    })
}

/// Adds a translation of the capillary, on the second axis of the emulated Grbl controller.
pub fn with_translation(config: &mut Config) -> anyhow::Result<()> {
    anyhow::ensure!(
        matches!(config.rotation, RotationDriver::Grbl(_)),
        "--translation needs --controller grbl: of the emulated controllers only that one has a second axis"
    );
    config.translation = Some(TranslationSettings {
        axis: AxisLetter::Y,
        steps_per_um: SlideSettings::default().steps_per_um.into(),
        um_per_unit: UM_PER_UNIT,
        max_rate_units_per_min: 60_000.0,
        acceleration_units_per_s2: 5000.0,
        limits_um: [-19_000.0, 0.0],
        position_um: SlideSettings::default().in_view_um,
        sense: Sense::Positive,
    });
    Ok(())
}

/// The firmware settings for the translation: steps, speed, acceleration and travel, and a search that takes seconds.
fn with_second_axis(mut settings: grbl::Settings) -> anyhow::Result<grbl::Settings> {
    let (steps, um) = SlideSettings::default().steps_per_um;
    let per_unit = f64::from(steps * UM_PER_UNIT) / f64::from(um);
    let travel = SlideSettings::default().travel_um / f64::from(UM_PER_UNIT);
    for (number, value) in [(25, 6000.0), (101, per_unit), (111, 60_000.0), (121, 5000.0), (131, travel)] {
        settings.set(number, value as f32).map_err(|error| anyhow::anyhow!("the emulated controller refuses ${number}: error:{error}"))?;
    }
    Ok(settings)
}

/// Fills in the port or the address of the emulated controller.
pub fn connect(rotation: &mut RotationDriver, rig: &Rig) -> anyhow::Result<()> {
    rotation.connect_to(match rotation {
        RotationDriver::Relay(_) => rig.relay_address().context("the emulated rig has no relay")?.to_string(),
        _ => rig.serial_path().to_string_lossy().into_owned(),
    });
    Ok(())
}

/// The relay of the configured driver. `None` for other drivers.
pub fn relay(rotation: &RotationDriver) -> Option<relay::Settings> {
    matches!(rotation, RotationDriver::Relay(_)).then(relay::Settings::default)
}

/// A stock VAST takes up a loaded specimen by itself.
pub fn taken_up_by(controller: &Controller, sampler: Box<dyn Sampler>) -> Box<dyn Sampler> {
    match controller {
        Controller::Bridge(machine) => Box::new(TakenUp { sampler, machine: machine.knobs.clone() }),
        _ => sampler,
    }
}

struct TakenUp {
    sampler: Box<dyn Sampler>,
    machine: bridge::Knobs,
}

impl Sampler for TakenUp {
    // The specimen that is inside is taken up already.
    forward_sampler!(sampler: waits_for_loader, brings_again, begin_run, look, has_sensor, sees_specimen, next_well, wash, go_on, eject);

    fn load(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let loaded = self.sampler.load(axis, expected, cancel)?;
        if loaded.is_some() {
            self.machine.take_up_specimen();
        }
        Ok(loaded)
    }
}
