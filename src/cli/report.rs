//! `carved report`: one HTML file on any number of runs, to read and to print.

use super::export::statistics::Which;
use super::export::{left_out, read, write};
use crate::report::html::report;
use anyhow::ensure;
use carved_store::gates::GateFile;
use carved_store::{StoreReader, StoredRun};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folders of runs (`DATA/runs/RUN`).
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// File for the report (`.html`). It needs no other file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    which: Which,
    /// Folder with the bead gates of the instrument [default: `calibrations` in the data folder of the runs]
    #[arg(long, value_name = "DIR")]
    calibrations: Option<PathBuf>,
}

/// Writes the report.
///
/// # Errors
/// A run that cannot be read, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let is_html = args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("html") || e.eq_ignore_ascii_case("htm"));
    ensure!(is_html, "{}: the name of a report ends in .html", args.out.display());
    let runs = read(&args.runs)?;
    let flagged = args.which.flagged();
    let text = report(&runs, &gates(&runs, args.calibrations.as_deref())?, flagged)?;
    write(&args.out, text.as_bytes())?;
    note!("carved: {}: {} run(s), {:.1} MB", args.out.display(), runs.len(), text.len() as f64 / 1e6);
    Ok(left_out(&runs))
}

/// The bead gates in these calibrations, or in the data folders of the runs. A copy of a run has none.
fn gates(runs: &[StoredRun], calibrations: Option<&Path>) -> anyhow::Result<Vec<GateFile>> {
    if let Some(folder) = calibrations {
        return Ok(StoreReader::new(folder).with_calibrations(folder).gates()?);
    }
    let data = |run: &StoredRun| Some(run.folder().canonicalize().ok()?.parent()?.parent()?.to_owned());
    let mut gates = Vec::new();
    for folder in runs.iter().filter_map(data).collect::<BTreeSet<_>>() {
        gates.extend(StoreReader::new(&folder).gates()?);
    }
    Ok(gates)
}
