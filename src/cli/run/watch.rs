//! `carved run watch`: prints each well when it ends and each fault when it comes, with a progress bar, until the run has ended.

use super::client::{Client, segment};
use super::{code_of, show};
use crate::api::{Fault, Mode, RunStatus};
use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeSet;
use std::process::ExitCode;

/// What has been printed already.
#[derive(Default)]
struct Told {
    wells: BTreeSet<String>,
    faults: BTreeSet<u64>,
}

impl Told {
    /// The lines for new results of the run and new faults.
    fn news(&mut self, run: &RunStatus, mode: Mode, faults: &[Fault]) -> Vec<String> {
        let mut lines = Vec::new();
        for well in &run.results {
            if well.outcome.is_some() && self.wells.insert(well.well.clone()) {
                lines.push(show::well(well, mode));
            }
        }
        for fault in faults {
            if self.faults.insert(fault.seq) {
                lines.push(show::fault(fault));
            }
        }
        lines
    }
}

/// Follows a run until it ends. Returns the exit code of its outcome.
pub fn follow(client: &Client, run: &str) -> anyhow::Result<ExitCode> {
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    let mut told = Told::default();
    let mut status = client.status()?;
    loop {
        let Some(shown) = status.run.as_ref().filter(|shown| shown.id == run) else {
            bar.finish_and_clear();
            return ended(client, run, &mut told);
        };
        let lines = told.news(shown, status.mode, &status.faults);
        // The bar makes room for the lines. They are printed even if it is not drawn.
        bar.suspend(|| printed(&lines))?;
        bar.set_length(shown.wells.total.into());
        bar.set_position(shown.wells.total.saturating_sub(shown.wells.pending).into());
        bar.set_message(status.doing.clone());
        if let Some(outcome) = shown.outcome {
            bar.finish_and_clear();
            say!("{}", show::end(shown, status.mode));
            return Ok(ExitCode::from(code_of(outcome)));
        }
        status = client.status_after(status.revision)?;
    }
}

fn printed(lines: &[String]) -> anyhow::Result<()> {
    for line in lines {
        say!("{line}");
    }
    Ok(())
}

/// The outcome of a run, in words. `None` while it is under way.
pub fn outcome(client: &Client, run: &str) -> anyhow::Result<Option<String>> {
    let shown = client.status()?.run.filter(|shown| shown.id == run);
    let outcome = match shown {
        Some(shown) => shown.outcome,
        None => stored(client, run)?.0.outcome,
    };
    Ok(outcome.map(show::word))
}

/// A run in the store.
fn stored(client: &Client, run: &str) -> anyhow::Result<(RunStatus, Mode)> {
    let stored = client.send("GET", &format!("/v1/runs/{}", segment(run)), None)?;
    let other = "the stored run is of another version of carved than this program's";
    let mode = serde_json::from_value(stored["mode"].clone()).context(other)?;
    Ok((serde_json::from_value(stored).context(other)?, mode))
}

/// The end of a run that is no longer in the status, read from the store.
fn ended(client: &Client, run: &str, told: &mut Told) -> anyhow::Result<ExitCode> {
    let (stored, mode) = stored(client, run)?;
    printed(&told.news(&stored, mode, &[]))?;
    let Some(outcome) = stored.outcome else { bail!("run {run} has no outcome, and the instrument does not work on it: ask again") };
    say!("{}", show::end(&stored, mode));
    Ok(ExitCode::from(code_of(outcome)))
}
