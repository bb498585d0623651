//! `carved setup`: sets a rig up by asking and measuring, and writes its configuration.
//!
//! ```text
//! terminal: lines, answers ─┐                          ┌─ bench: what is asked of the instrument
//!                           ├─ dialogue ── machine ────┤    └─ rig: the real devices
//! site: page ───────────────┘              the stages  └─ state: what is known
//!
//! state ──► wording    the questions
//!      ├──► judgement  what is wrong with a measurement
//!      └──► result     the configuration (draft: its text) and the summary
//! ```

pub(super) mod bench;
mod check;
mod dialogue;
mod draft;
#[cfg(feature = "simulate")]
mod emulated;
mod judgement;
pub(super) mod machine;
mod period;
mod question;
mod result;
mod rig;
mod site;
pub(super) mod state;
pub(super) mod terminal;
#[cfg(test)]
mod tests;
mod wording;

use super::signals::{INTERRUPTED, Signals};
#[cfg(feature = "simulate")]
use crate::cli::simulate::controller::{Make, hasten};
use anyhow::Context;
#[cfg(feature = "simulate")]
use carved_devices::rotation::RotationDriver;
use carved_store::durable;
use dialogue::Person;
use machine::Machine;
use rig::{RealBench, Show, Stopper, stored};
use state::State;
use std::net::SocketAddr;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Check a rig that has a configuration: whether a bead goes around, whether the turn closes, and whether the bead has its diameter
    Check(check::Args),
}

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    /// Configuration to write
    #[arg(long, value_name = "FILE", default_value = "carved.toml")]
    out: PathBuf,
    /// File of the answers so far, with which an interrupted set-up goes on. Default: the configuration's name with .setup.json
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Answers for a set-up without a person: TOML with `question = "answer"`, or a list of answers where a question is asked again. `-` reads
    /// one answer per line from standard input
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// Shows the set-up as a page at this address, such as 127.0.0.1:8421
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "answers")]
    listen: Option<SocketAddr>,
    /// File with the bearer token that the page must send; mandatory outside loopback
    #[arg(long, value_name = "FILE", requires = "listen")]
    token_file: Option<PathBuf>,
    /// A host name under which the page is opened, besides the loopback names and the address
    #[arg(long, value_name = "NAME", requires = "listen")]
    allowed_host: Vec<String>,
    #[cfg(feature = "simulate")]
    #[command(flatten)]
    emulation: Emulation,
}

/// An emulated rig to try the set-up on.
#[cfg(feature = "simulate")]
#[derive(Debug, clap::Args)]
struct Emulation {
    /// Try the set-up on an emulated rig, which is started for it
    #[arg(long)]
    simulate: bool,
    /// The controller of the emulated rig
    #[arg(long, value_enum, default_value_t = Make::Grbl, requires = "simulate")]
    controller: Make,
    /// Speed-up of the emulated rig over real time
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, requires = "simulate")]
    time_scale: f64,
}

/// What sets up: the person's way to answer aside.
struct Work {
    bench: RealBench,
    machine: Machine,
    state: PathBuf,
    stopper: Stopper,
    #[cfg(feature = "simulate")]
    emulated: Option<emulated::EmulatedRig>,
}

impl Work {
    fn begin(args: &Args, stopper: &Stopper, show: Show) -> anyhow::Result<Self> {
        let state = args.state.clone().unwrap_or_else(|| args.out.with_extension("setup.json"));
        let machine = stored::<State>(&state)?.map(Machine::resume).unwrap_or_default();
        #[cfg_attr(not(feature = "simulate"), expect(unused_mut, reason = "only an emulated rig is added"))]
        let mut bench = RealBench::new(args.out.clone(), stopper.clone(), show);
        #[cfg(feature = "simulate")]
        let emulated = {
            let Emulation { simulate, controller, time_scale } = &args.emulation;
            let started = simulate.then(|| emulated::EmulatedRig::start(*controller, *time_scale)).transpose()?;
            if let Some(started) = &started {
                let time_scale = *time_scale;
                let hasten = Box::new(move |rotation: &mut RotationDriver| hasten(rotation, time_scale));
                bench.emulate(rig::Emulated { port: started.port(), camera: started.camera(), hasten });
                started.follow(machine.state())?;
            }
            started
        };
        Ok(Self {
            bench,
            machine,
            state,
            stopper: stopper.clone(),
            #[cfg(feature = "simulate")]
            emulated,
        })
    }

    /// Leads the conversation, and gives the summary.
    fn converse(&mut self, person: &mut dyn Person) -> anyhow::Result<String> {
        #[cfg(feature = "simulate")]
        if let Some(rig) = &self.emulated {
            person.tell(&rig.facts())?;
        }
        if self.machine.state() != &State::default() {
            person.tell(&format!("Going on with the answers in {}. Remove that file to begin again.", self.state.display()))?;
        }
        let mut keep = |newest: &State| {
            #[cfg(feature = "simulate")]
            self.emulated.as_ref().map_or(Ok(()), |rig| rig.follow(newest))?;
            Ok(durable::write_json(&self.state, newest)?)
        };
        dialogue::converse(&mut self.machine, &mut self.bench, person, &|| self.stopper.is_stopped(), &mut keep)?;
        std::fs::remove_file(&self.state).with_context(|| format!("{}: cannot be removed", self.state.display()))?;
        Ok(self.machine.summary())
    }
}

/// Sets up a rig.
///
/// # Errors
/// Files that cannot be used, and a set-up that cannot go on without a person.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stopper = Stopper::default();
    stop_at_signals(stopper.clone())?;
    if let Some(Command::Check(args)) = &args.command {
        return check::run(args, &stopper);
    }
    match args.listen {
        Some(listen) => site::run(args, listen, &stopper),
        None => terminal::run(args, &stopper),
    }
}

/// Stops the motors at the first signal. The program ends once they are at rest, or at the next signal.
fn stop_at_signals(stopper: Stopper) -> anyhow::Result<()> {
    Signals::at_each(move || {
        let is_second = stopper.is_stopped();
        stopper.stop();
        if is_second || !stopper.may_move() {
            std::process::exit(if stopper.is_finished() { 0 } else { INTERRUPTED });
        }
    })
}
