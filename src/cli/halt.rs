//! `carved halt`: stops the motors and switches the outputs off where no daemon does it, such as after its process was killed.

use super::serve::open_axis;
use crate::config::Config;
use anyhow::Context;
use carved_devices::rotation::RotationDriver;
use carved_store::Claim;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The instrument's configuration (TOML)
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
}

/// Writes the stop to the controller, then switches each output off.
///
/// # Errors
/// A daemon that uses the instrument: it has stops of its own. A controller that does not answer or refuses.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let config = Config::load(&args.config)?;
    if matches!(config.rotation, RotationDriver::Folder(_)) {
        say!("The configuration reads pictures of another program. It has no motors: nothing was done");
        return Ok(());
    }
    let _claim = Claim::on(&config.store.data_dir)?;
    // Before any question: opening waits for a controller that moves, and refuses one with other settings.
    config.rotation.stop()?;
    let mut axis = open_axis(&config).context("the stop was written if the controller has one; its outputs may be on")?;
    // For the machines that only their open connection stops.
    axis.stop_handle().stop();
    let can_stop = axis.capabilities().can_stop;
    if let Some(outputs) = axis.outputs() {
        for output in config.rotation.outputs() {
            outputs.switch(&output.name, false)?;
        }
    }
    say!(
        "{}: {}",
        axis.identity(),
        if can_stop {
            "the motors are stopped, and the outputs are off"
        } else {
            "this machine ends its step by itself, and gets no further one"
        }
    );
    Ok(())
}
