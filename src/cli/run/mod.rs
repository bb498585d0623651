//! `carved run`: controls runs from the command line, as an ordinary client of a daemon's API.
//!
//! ```text
//! plate map ── start ──> PUT /v1/runs/{id} ──┐
//!              hold, unhold, stop, abort ────┼─> daemon
//!              acknowledge ──────────────────┤
//!              status, watch <── /v1/status ─┘
//! ```

pub(super) mod client;
pub(super) mod show;
mod start;
mod watch;

use crate::api::{RunOutcome, Status};

use client::{Client, Failure};
use std::process::ExitCode;

/// The exit codes, as the help text lists them.
pub const EXIT_CODES: &str = "Exit codes: 0 done (watch: the run succeeded), 1 refused or nobody answers, 2 the command line is wrong, \
    3 mistakes in the plate map or the plan, 4 the run ended partial, 5 failed or interrupted, 6 aborted.";

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Start a run on a plate map (docs/plate-map.md).
    #[command(after_help = EXIT_CODES)]
    Start(start::Args),
    /// Show what the instrument is doing.
    Status(StatusArgs),
    /// Hold a run after the current specimen.
    Hold(SteerArgs),
    /// Continue a run that is held.
    Unhold(SteerArgs),
    /// End a run after the current specimen.
    Stop(SteerArgs),
    /// End a run at once; the motors stop first.
    Abort(SteerArgs),
    /// Acknowledge a fault: somebody has looked at its cause.
    Acknowledge(AcknowledgeArgs),
    /// Follow a run until it ends.
    #[command(after_help = EXIT_CODES)]
    Watch(WatchArgs),
}

#[derive(Debug, clap::Args)]
pub struct StatusArgs {
    #[command(flatten)]
    daemon: client::Daemon,
    /// Print the whole status as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
pub struct SteerArgs {
    #[command(flatten)]
    daemon: client::Daemon,
    /// The run [default: the current run]
    run: Option<String>,
}

#[derive(Debug, clap::Args)]
pub struct AcknowledgeArgs {
    #[command(flatten)]
    daemon: client::Daemon,
    /// The number of the fault, as `carved run status` shows it
    fault: u64,
}

#[derive(Debug, clap::Args)]
pub struct WatchArgs {
    #[command(flatten)]
    daemon: client::Daemon,
    /// The run [default: the newest run]
    run: Option<String>,
}

/// The exit code for the outcome of a run.
pub fn code_of(outcome: RunOutcome) -> u8 {
    match outcome {
        RunOutcome::Succeeded => 0,
        RunOutcome::Partial => 4,
        RunOutcome::Failed | RunOutcome::Interrupted => 5,
        RunOutcome::Aborted => 6,
    }
}

fn newest(status: &Status) -> anyhow::Result<String> {
    let run = status.run.as_ref().map(|run| run.id.clone());
    run.ok_or_else(|| anyhow::anyhow!("there is no run yet; start one with `carved run start`"))
}

fn steer(args: &SteerArgs, verb: &str) -> anyhow::Result<()> {
    let client = Client::new(&args.daemon)?;
    let run = match &args.run {
        Some(run) => run.clone(),
        None => newest(&client.status()?)?,
    };
    let before = client.status()?.revision;
    client.send("POST", &format!("/v1/runs/{}/{verb}", client::segment(&run)), None)?;
    let status = client.status()?;
    let taken = if status.revision == before { "changes nothing" } else { "is accepted" };
    say!("{verb} of run {run} {taken}. {}", status.doing);
    Ok(())
}

fn carry_out(command: &Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Start(args) => return start::run(args),
        Command::Status(args) => {
            let client = Client::new(&args.daemon)?;
            if args.json {
                say!("{}", serde_json::to_string_pretty(&client.send("GET", "/v1/status", None)?)?);
            } else {
                say!("{}", show::status(&client.status()?).trim_end());
            }
        }
        Command::Hold(args) => steer(args, "hold")?,
        Command::Unhold(args) => steer(args, "unhold")?,
        Command::Stop(args) => steer(args, "stop")?,
        Command::Abort(args) => steer(args, "abort")?,
        Command::Acknowledge(args) => {
            let client = Client::new(&args.daemon)?;
            client.send("POST", &format!("/v1/faults/{}/acknowledge", args.fault), None)?;
            say!("fault {} is acknowledged. {}", args.fault, client.status()?.doing);
        }
        Command::Watch(args) => {
            let client = Client::new(&args.daemon)?;
            let run = match &args.run {
                Some(run) => run.clone(),
                None => newest(&client.status()?)?,
            };
            return watch::follow(&client, &run);
        }
    }
    Ok(ExitCode::SUCCESS)
}

pub fn run(command: &Command) -> anyhow::Result<ExitCode> {
    match carry_out(command) {
        // A plan with mistakes is a regular answer: each mistake is printed, and the exit code is its own.
        Err(error) => match error.downcast_ref::<Failure>() {
            Some(Failure::Refused(problem)) if !problem.errors.is_empty() => {
                problem.errors.iter().for_each(|mistake| note!("{mistake}"));
                note!("{} mistake(s); nothing was started", problem.errors.len());
                Ok(ExitCode::from(super::plate::MISTAKES))
            }
            _ => Err(error),
        },
        done => done,
    }
}
