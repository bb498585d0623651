//! `carved serve`: the daemon on an instrument.

use super::daemon::Daemon;
use super::segment::input;
use super::with_causes;
use crate::config::{CameraDriver, Config, SamplerDriver};
use crate::http;
use crate::session::{Departure, Instrument};
use anyhow::Context;
use carved_devices::rotation::RotationDriver;
use carved_devices::sampler::{LoaderInterlock, LoaderSampler, Sampler, TriggerSampler};
use carved_devices::{Camera, DeviceError, Lasting, Rig, RotationAxis, camera, rotation, views};
use carved_records::Mode;
use carved_store::Claim;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The instrument's configuration (TOML). There is no default; for a simulation use `carved simulate`.
    #[arg(long)]
    config: PathBuf,
}

/// Exit code of a daemon that wants to be started again (`EX_TEMPFAIL`): the unit names it.
const RESTART: u8 = 75;

/// What a command for devices says to a configuration without any.
pub const NO_DEVICES: &str = "The configuration has [views], which reads pictures of another program. It has no axis and no camera";

/// Serves until a signal. Returns the exit code.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config = Arc::new(Config::load(&args.config)?);
    for doubt in &config.doubts {
        tracing::warn!("{}: look again: {doubt}", args.config.display());
    }
    let listener = http::bind(&config.http)?;
    // The data folder is claimed before any device is opened, because its owner may be in the middle of a turn.
    let claim = Claim::on(&config.store.data_dir)?;
    let interlock = LoaderInterlock::default();
    let (rig, sampler) = open(&config, &interlock)?;
    let second = open_second(&config)?;
    let greeting = format!("carved serves the instrument {:?}:", config.rig_name);
    Daemon { claim, config, mode: Mode::Hardware, instrument: Instrument { rig, second, sampler }, interlock, listener, greeting }
        .run(|_| async { Ok(()) })
        .map(|departure| match departure {
            Departure::EndsRun => ExitCode::SUCCESS,
            Departure::LeavesRun => ExitCode::from(RESTART),
        })
}

/// Opens the rig and its sampler, or the folder of another program.
pub fn open(config: &Config, interlock: &LoaderInterlock) -> anyhow::Result<(Rig, Box<dyn Sampler>)> {
    match (&config.rotation, &config.camera) {
        (RotationDriver::Folder(settings), CameraDriver::Folder(kind)) => {
            let decode = |path: &Path| input::read(path, None).map(|read| read.frame).map_err(|error| with_causes(&error));
            Ok(views::open(settings.clone(), *kind, Box::new(decode))?)
        }
        _ => with_sampler(open_rig(config)?, config.sampler, interlock),
    }
}

/// Opens every device in the configuration. The error names a device that does not answer.
pub fn open_rig(config: &Config) -> anyhow::Result<Rig> {
    let camera = config.camera.aravis().context(NO_DEVICES)?;
    let axis = config.clone();
    let rotation = Box::new(Lasting::open(move || open_axis(&axis))?);
    Ok(Rig { rotation, camera: camera::open(camera.clone())? })
}

/// Opens the sampler of the configuration. A sampler on wires uses the rig's axis.
pub fn with_sampler(rig: Rig, driver: SamplerDriver, interlock: &LoaderInterlock) -> anyhow::Result<(Rig, Box<dyn Sampler>)> {
    Ok(match driver {
        SamplerDriver::Loader {} | SamplerDriver::Folder {} => (rig, Box::new(LoaderSampler::new(interlock.clone()))),
        SamplerDriver::Trigger(settings) => {
            let (sampler, rotation) = TriggerSampler::beside(rig.rotation, settings)?;
            (Rig { rotation, ..rig }, Box::new(sampler))
        }
    })
}

/// Opens the controller that turns the capillary. Nothing moves.
pub fn open_axis(config: &Config) -> Result<Box<dyn RotationAxis>, DeviceError> {
    let rotation = config.rotation.open(config.steps_per_revolution, config.translation).ok_or(DeviceError::NotBuilt {
        device: "rotation axis",
        driver: "folder",
        remedy: NO_DEVICES,
    })??;
    rotation::one_sided(rotation, config.backlash_steps)
}

/// Opens the second camera, if one is configured.
pub fn open_second(config: &Config) -> anyhow::Result<Option<Box<dyn Camera>>> {
    let Some(second) = &config.second else { return Ok(None) };
    let settings = second.camera.aravis().context(NO_DEVICES)?;
    Ok(Some(camera::open(settings.clone()).context("the second camera")?))
}
