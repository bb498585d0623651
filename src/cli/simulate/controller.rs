//! Which controller turns the emulated capillary: configured as the shipped file of such an instrument has it.

use crate::config::{Config, RotationDriver};
use crate::device::rotation::Port;
use hardware_sim::{Controller, grbl, tmcl};
use std::path::Path;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Make {
    Grbl,
    Tmcl,
}

impl Make {
    fn shipped(self) -> Option<(&'static str, &'static str)> {
        match self {
            // The built-in configuration has it already.
            Self::Grbl => None,
            Self::Tmcl => Some(("config/vast-tmcl.toml (built in)", include_str!("../../../config/vast-tmcl.toml"))),
        }
    }

    /// Puts this controller, and the motor steps of its rig, in the place of the configured ones.
    pub fn configure(self, config: &mut Config, time_scale: f64) -> anyhow::Result<()> {
        let Some((name, text)) = self.shipped() else { return Ok(()) };
        let shipped = Config::parse(text, Path::new(name))?;
        config.rotation = shipped.rotation;
        config.translation = shipped.translation;
        config.steps_per_revolution = shipped.steps_per_revolution;
        config.backlash_steps = shipped.backlash_steps;
        if let RotationDriver::Tmcl(settings) = &mut config.rotation {
            // Both motors are told one after the other: in the time that this takes they are so many times as far apart.
            settings.max_skew_steps = (f64::from(settings.max_skew_steps) * time_scale.max(1.0)).ceil() as u32;
        }
        Ok(())
    }
}

/// The firmware that the configured driver speaks to.
pub fn emulated(rotation: &RotationDriver) -> Controller {
    match rotation {
        RotationDriver::Tmcl(_) => Controller::Tmcl(tmcl::Settings::default()),
        _ => Controller::Grbl(grbl::Settings::default()),
    }
}

/// Fills in where the emulated controller is.
pub fn connect(rotation: &mut RotationDriver, port: &Path) -> anyhow::Result<()> {
    let port = Port::Path(port.to_string_lossy().into_owned());
    match rotation {
        RotationDriver::Grbl(settings) => settings.port = port,
        RotationDriver::Tmcl(settings) => settings.port = port,
        RotationDriver::VastBridge(_) | RotationDriver::Relay(_) => anyhow::bail!("the emulated rig has no VAST in it"),
    }
    Ok(())
}
