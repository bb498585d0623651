//! The commands, one file each.

#![warn(clippy::print_stdout, clippy::print_stderr)] // `output` prints instead, because println! panics if its reader is gone

#[macro_use]
mod output;

mod archive;
mod calibrate;
mod camera;
mod check;
mod daemon;
mod doctor;
#[cfg(feature = "simulate")]
pub mod emulated;
mod export;
mod folders;
mod halt;
mod import;
mod index;
pub mod log;
mod manual;
mod measure;
mod notify;
#[cfg(feature = "testing")]
pub mod parsers;
mod plate;
mod reconstruct;
mod reference;
mod replay;
mod report;
mod run;
mod schema;
mod segment;
mod serve;
mod setup;
mod signals;
#[cfg(feature = "simulate")]
mod simulate;
mod stored;
mod switch;
mod systemd;
#[cfg(test)]
mod toy_controller;

use carved_store::Software;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use output::{PIPE_CLOSED, PipeClosed};
use std::process::ExitCode;

#[derive(Debug, Parser)]
#[command(name = "carved", version = BUILD, about, long_about = None, after_help = LOG)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve an instrument.
    Serve(serve::Args),
    /// Start the emulated rig and the daemon on it, and run a demo plate.
    #[cfg(feature = "simulate")]
    Simulate(simulate::Args),
    /// Measure recordings again from their frames.
    Measure(measure::Args),
    /// Compute a stored run again and compare it with the stored result bit for bit; or use another method.
    Replay(replay::Args),
    /// Make a recording of a lab's own frames of one turn, or a run of the pictures of a plate.
    Import(Box<import::Args>),
    /// Carve silhouettes of any origin and measure the result.
    Reconstruct(reconstruct::Args),
    /// Work with the reference larvae that specimens are compared with.
    #[command(subcommand)]
    Reference(reference::Command),
    /// Set up the camera's light and take its reference frames.
    #[command(subcommand)]
    Camera(camera::Command),
    /// Find the geometry of the views and the scale of the rig.
    #[command(subcommand)]
    Calibrate(calibrate::Command),
    /// Find the specimen's outline in single pictures.
    Segment(segment::Args),
    /// Write stored runs as tables and in the formats of other programs.
    #[command(subcommand)]
    Export(export::Command),
    /// Write a report of stored runs: one HTML file with plates, groups, pictures and methods, to read and to print.
    Report(report::Args),
    /// Copy runs elsewhere, verify every hash of the copy and write a receipt.
    Archive(archive::ArchiveArgs),
    /// Remove raw frames, or whole runs, whose archived copy is intact; without --yes only say what would be removed.
    Prune(archive::PruneArgs),
    /// Work with the index over the run folders.
    #[command(subcommand)]
    Index(index::Command),
    /// Show which devices are connected, which of them answer and what to configure; nothing is moved.
    Doctor(doctor::Args),
    /// Set up a rig step by step: asks, measures with a bead, and writes its configuration.
    Setup(setup::Args),
    /// Switch a digital output of the controller by hand, such as a light or a valve.
    Output(switch::Args),
    /// Stop the motors and switch the outputs off, without a daemon.
    Halt(halt::Args),
    /// Write the man pages and the shell completions.
    #[command(hide = true)]
    Manual(manual::Args),
    /// Start, follow and control runs on a daemon that serves.
    #[command(subcommand, after_help = run::EXIT_CODES)]
    Run(run::Command),
    /// Work with the notices to people who are not at the instrument.
    #[command(subcommand)]
    Notify(notify::Command),
    /// Work with plate maps.
    #[command(subcommand)]
    Plate(plate::Command),
    /// Work with configurations.
    #[command(subcommand)]
    Config(ConfigCommand),
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    /// Check a configuration and report everything that is wrong with it.
    Check(check::Args),
    /// Print the JSON schema of a configuration: every key with its unit, default, range, level and meaning.
    Schema(schema::Args),
}

/// The version with the commit of the sources.
const BUILD: &str = concat!(env!("CARGO_PKG_VERSION"), " ", env!("CARVED_BUILD_COMMIT"));

const LOG: &str = "Environment:
  CARVED_LOG  what the log on standard error holds: error, warn, info (the default), debug, trace or off; or by part of the program,
              as in CARVED_LOG=info,carved_devices=debug. Any other value is named in a warning, and info is used";

/// The error and its causes, each once: many errors already contain the text of their cause.
pub fn with_causes(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
        "" => cause,
        known if known.contains(&cause) => text,
        _ => format!("{text}: {cause}"),
    })
}

/// Accepts `-0.1` as a value everywhere, so that the option can report what it expects.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command
        .mut_args(|arg| if arg.get_action().takes_values() { arg.allow_negative_numbers(true) } else { arg })
        .mut_subcommands(with_negative_numbers)
}

/// All commands with their options, as the program reads them from its command line.
#[must_use]
pub fn command() -> clap::Command {
    with_negative_numbers(Cli::command())
}

/// Runs the named command and reports its error.
pub fn main() -> ExitCode {
    Software::built_from(env!("CARVED_BUILD_COMMIT"), env!("CARVED_BUILD_DIRTY").parse().ok());
    match run() {
        Ok(code) => code,
        Err(error) if error.is::<PipeClosed>() => ExitCode::from(PIPE_CLOSED),
        Err(error) => {
            note!("carved: {}", with_causes(&error));
            ExitCode::FAILURE
        }
    }
}

fn run() -> anyhow::Result<ExitCode> {
    let matches = command().get_matches();
    match Cli::from_arg_matches(&matches).unwrap_or_else(|e| e.exit()).command {
        Command::Serve(args) => return serve::run(&args),
        #[cfg(feature = "simulate")]
        Command::Simulate(args) => simulate::run(args),
        Command::Measure(args) => return measure::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Import(args) => return import::run(&args),
        Command::Reference(command) => reference::run(&command),
        Command::Camera(command) => camera::run(&command),
        Command::Calibrate(command) => calibrate::run(&command),
        // A refusal is a regular answer: it is printed, and has its own exit code.
        Command::Reconstruct(args) => return Ok(reconstruct::run(&args)),
        Command::Segment(args) => segment::run(&args),
        Command::Export(command) => return export::run(&command),
        Command::Report(args) => return report::run(&args),
        Command::Archive(args) => archive::archive(&args),
        Command::Prune(args) => archive::prune(&args),
        Command::Index(command) => index::run(&command),
        Command::Doctor(args) => doctor::run(&args),
        Command::Setup(args) => setup::run(&args),
        Command::Output(args) => switch::run(&args),
        Command::Halt(args) => halt::run(&args),
        Command::Manual(args) => manual::run(&args),
        Command::Run(command) => return run::run(&command),
        Command::Notify(command) => notify::run(&command),
        Command::Plate(command) => return plate::run(&command),
        Command::Config(ConfigCommand::Check(args)) => check::run(&args),
        Command::Config(ConfigCommand::Schema(args)) => schema::run(&args),
    }?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_below_0_is_a_value_in_every_command() {
        let command = command();
        command.clone().debug_assert();
        for line in [
            "reconstruct --views v --cameras c --epsilon -0.1 --box -1,1,-1,1,-1,1",
            "calibrate specimen --views v --cameras c --voxel -1",
            "simulate --time-scale -2",
            "import --even --sense -1 frames",
        ] {
            let read = command.clone().try_get_matches_from(std::iter::once("carved").chain(line.split(' ')));
            assert!(read.is_ok(), "{line}: {}", read.unwrap_err());
        }
    }
}
