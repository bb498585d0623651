//! `carved camera`: light and reference frames, taken with the configured camera while no daemon controls it.

pub mod average;
pub mod exposure;
mod reference;

use super::serve::{NO_DEVICES, open_axis};
use super::signals::{INTERRUPTED, Signals};
use crate::config::Config;
use anyhow::Context;
use carved_devices::RotationAxis;
use carved_devices::camera::AravisSettings;
use carved_devices::cancel::CancelToken;
use carved_devices::outputs::{OutputUse, views_on};
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Find the exposure at which the background is just under saturation; the capillary must be empty.
    Exposure(exposure::Args),
    /// Take and store a picture of the empty capillary, which frames are compared with.
    Empty(reference::Args),
    /// Take and store a picture of the light alone, without capillary. It is kept for the record and not applied.
    FlatField(reference::Args),
}

#[derive(Debug, clap::Args)]
struct Configured {
    /// The instrument's configuration (TOML). Stop its daemon first: a camera has one controller.
    #[arg(long)]
    config: PathBuf,
}

impl Configured {
    fn load(&self) -> anyhow::Result<(Config, AravisSettings)> {
        let config = Config::load(&self.config)?;
        let settings = config.camera.aravis().context(NO_DEVICES)?.clone();
        Ok((config, settings))
    }
}

/// A token that the first signal cancels, so that the command ends by its destructors, which switch the light off. The second signal ends
/// the program at once.
fn cancelled_by_signals() -> anyhow::Result<CancelToken> {
    let cancel = CancelToken::new();
    let token = cancel.clone();
    Signals::at_each(move || {
        if token.is_cancelled() {
            std::process::exit(INTERRUPTED);
        }
        token.cancel();
    })?;
    Ok(cancel)
}

/// The controller that has switched the light on, on a rig with such a light. The light goes off when it is dropped.
pub fn light(config: &Config, cancel: &CancelToken) -> anyhow::Result<Option<Box<dyn RotationAxis>>> {
    if !config.rotation.outputs().iter().any(|output| output.on == OutputUse::Views) {
        return Ok(None);
    }
    let mut axis = open_axis(config)?;
    views_on(axis.as_mut(), cancel)?;
    Ok(Some(axis))
}

pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Exposure(args) => exposure::run(args),
        Command::Empty(args) => reference::run(args, reference::Kind::Empty),
        Command::FlatField(args) => reference::run(args, reference::Kind::FlatField),
    }
}
