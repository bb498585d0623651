//! `carved serve`: the daemon on an instrument.

use super::daemon::Daemon;
use crate::config::{CameraDriver, Config, RotationDriver, SamplerDriver};
use crate::http;
use crate::session::Instrument;
use anyhow::Context;
use carved_devices::sampler::{LoaderInterlock, LoaderSampler, Sampler, TriggerSampler};
use carved_devices::{Camera, DeviceError, Lasting, Rig, RotationAxis, camera, rotation};
use carved_records::Mode;
use carved_store::Claim;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The instrument's configuration (TOML). There is no default; for a simulation use `carved simulate`.
    #[arg(long)]
    config: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let config = Arc::new(Config::load(&args.config)?);
    for doubt in &config.doubts {
        tracing::warn!("{}: look again: {doubt}", args.config.display());
    }
    let listener = http::bind(&config.http)?;
    // The data folder is claimed before any device is opened, because its owner may be in the middle of a turn.
    let claim = Claim::on(&config.store.data_dir)?;
    let interlock = LoaderInterlock::default();
    let (rig, sampler) = with_sampler(open_rig(&config)?, config.sampler, &interlock)?;
    let second = open_second(&config)?;
    let greeting = format!("carved serves the instrument {:?}:", config.rig_name);
    Daemon { claim, config, mode: Mode::Hardware, instrument: Instrument { rig, second, sampler }, interlock, listener, greeting }
        .run(|_| async { Ok(()) })
}

/// Opens every device in the configuration. The error names a device that does not answer.
pub fn open_rig(config: &Config) -> anyhow::Result<Rig> {
    let axis = config.clone();
    let rotation = Box::new(Lasting::open(move || open_axis(&axis))?);
    let camera = match &config.camera {
        CameraDriver::Aravis(settings) => camera::open(settings.clone())?,
    };
    Ok(Rig { rotation, camera })
}

/// Opens the sampler of the configuration. A sampler on wires uses the rig's axis.
pub fn with_sampler(rig: Rig, driver: SamplerDriver, interlock: &LoaderInterlock) -> anyhow::Result<(Rig, Box<dyn Sampler>)> {
    Ok(match driver {
        SamplerDriver::Loader {} => (rig, Box::new(LoaderSampler::new(interlock.clone()))),
        SamplerDriver::Trigger(settings) => {
            let (sampler, rotation) = TriggerSampler::beside(rig.rotation, settings)?;
            (Rig { rotation, ..rig }, Box::new(sampler))
        }
    })
}

fn open_axis(config: &Config) -> Result<Box<dyn RotationAxis>, DeviceError> {
    let rotation: Box<dyn RotationAxis> = match &config.rotation {
        RotationDriver::Grbl(settings) => Box::new(rotation::Grbl::with_translation(settings.clone(), config.translation)?),
        RotationDriver::VastBridge(settings) => Box::new(rotation::VastBridge::open(settings.clone(), config.steps_per_revolution)?),
        RotationDriver::Relay(settings) => Box::new(rotation::Relay::open(settings.clone(), config.steps_per_revolution)?),
        RotationDriver::Tmcl(settings) => Box::new(rotation::Tmcl::open(settings.clone())?),
        RotationDriver::Zaber(settings) => Box::new(rotation::Zaber::open(settings.clone())?),
    };
    rotation::one_sided(rotation, config.backlash_steps)
}

/// Opens the second camera, if one is configured.
pub fn open_second(config: &Config) -> anyhow::Result<Option<Box<dyn Camera>>> {
    let Some(second) = &config.second else { return Ok(None) };
    let CameraDriver::Aravis(settings) = &second.camera;
    Ok(Some(camera::open(settings.clone()).context("the second camera")?))
}
