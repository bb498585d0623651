//! `carved setup`: sets a rig up by asking and measuring, and writes its configuration.
//!
//! ```text
//! terminal, answers ─┐                     ┌─ bench: what is asked of the instrument
//!                    ├─ machine ── stages ─┤    └─ rig: the real devices
//! page ──────────────┘                     └─ draft: the text of the configuration
//! ```

mod bench;
mod draft;
mod machine;
mod period;
mod question;
mod rig;
mod terminal;

use anyhow::Context;
use rig::Stopper;
use std::path::PathBuf;
use tokio::signal::unix::{SignalKind, signal};

/// Exit code of a set-up that a signal ended: 128 + 2, as a shell reports Ctrl-C.
const INTERRUPTED: i32 = 130;

#[derive(Debug, clap::Args)]
pub struct Args {
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
}

/// Sets up a rig.
///
/// # Errors
/// Files that cannot be used, and a set-up that cannot go on without a person.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let state = args.state.clone().unwrap_or_else(|| args.out.with_extension("setup.json"));
    let stopper = Stopper::default();
    stop_at_signals(stopper.clone())?;
    terminal::run(args, &state, &stopper)
}

/// Stops the motors at the first signal. The program ends once they are at rest, or at the next signal.
fn stop_at_signals(stopper: Stopper) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot start the runtime")?;
    let mut signals = runtime.block_on(async {
        [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::hangup()].map(signal).into_iter().collect::<Result<Vec<_>, _>>()
    })?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            runtime.block_on(async {
                loop {
                    let any = signals.iter_mut().map(|signal| Box::pin(signal.recv()));
                    futures::future::select_all(any).await;
                    let is_second = stopper.is_stopped();
                    stopper.stop();
                    if is_second || !stopper.may_move() {
                        std::process::exit(INTERRUPTED);
                    }
                }
            });
        })
        .context("cannot start the thread for signals")?;
    Ok(())
}
