//! `carved run watch`: each well as it ends, each fault as it comes, and a bar between them, until the run has ended.

use super::client::Client;
use super::{code_of, show};
use crate::session::Status;
use anyhow::bail;
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeSet;
use std::process::ExitCode;

/// What has been told already.
#[derive(Default)]
struct Told {
    wells: BTreeSet<String>,
    faults: BTreeSet<u64>,
}

impl Told {
    /// Lines for what is new in a status.
    fn news(&mut self, status: &Status) -> Vec<String> {
        let mut lines = Vec::new();
        for well in status.run.iter().flat_map(|run| &run.results) {
            if well.outcome.is_some() && self.wells.insert(well.well.clone()) {
                lines.push(show::well(well));
            }
        }
        for fault in &status.faults {
            if self.faults.insert(fault.seq) {
                lines.push(show::fault(fault));
            }
        }
        lines
    }
}

/// Follows a run to its end; the code is that of its outcome.
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
            match &status.run {
                Some(other) => bail!("the status has run {} now, not {run}: look at GET /v1/runs/{run}", other.id),
                None => bail!("the instrument knows of no run {run}"),
            }
        };
        let lines = told.news(&status);
        // The bar makes room for lines; where it is not drawn they are printed all the same.
        bar.suspend(|| lines.iter().for_each(|line| println!("{line}")));
        bar.set_length(shown.wells.total.into());
        bar.set_position((shown.wells.total - shown.wells.pending).into());
        bar.set_message(status.doing.clone());
        if let Some(outcome) = shown.outcome {
            bar.finish_and_clear();
            println!("{}", show::end(shown));
            return Ok(ExitCode::from(code_of(outcome)));
        }
        status = client.status_after(status.revision)?;
    }
}
