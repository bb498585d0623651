//! `carved export statistics`: groups, controls and responses of runs.

use super::{left_out, read, write};
use crate::tables::csv;
use crate::tables::statistics::{Flagged, Statistics, groups_table, responses_table, windows_table};
use anyhow::{Context, bail, ensure};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folders of runs (`DATA/runs/RUN`). Their wells are pooled.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// File for one row per group and per compound (`.csv`), or for all statistics as over HTTP (`.json`) [default: CSV on standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// File for one row per dose-response curve (`.csv`).
    #[arg(long, value_name = "FILE")]
    responses: Option<PathBuf>,
    /// File for Z' of every run with controls (`.csv`).
    #[arg(long, value_name = "FILE")]
    controls: Option<PathBuf>,
    /// Write the CSV for a spreadsheet: with a byte order mark, and with an apostrophe before text that it would take for a formula.
    #[arg(long)]
    spreadsheet: bool,
    #[command(flatten)]
    which: Which,
}

/// Which specimens statistics count.
#[derive(Debug, clap::Args)]
pub struct Which {
    /// Leave out all specimens with flags [default: those whose number is a bound or doubtful, see docs/quality.md]
    #[arg(long)]
    without_flagged: bool,
    /// Count all measured specimens, also those whose number is a bound or doubtful.
    #[arg(long, conflicts_with = "without_flagged")]
    with_flagged: bool,
}

impl Which {
    /// The same as statistics take it.
    pub fn flagged(&self) -> Flagged {
        match (self.without_flagged, self.with_flagged) {
            (true, _) => Flagged::Excluded,
            (false, true) => Flagged::Included,
            (false, false) => Flagged::Sound,
        }
    }
}

/// Writes the statistics.
///
/// # Errors
/// A run that cannot be read, a file that cannot be written, a format that there is not, or specimens of which none counts.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let as_json = args.out.as_deref().map(is_json).transpose()?.unwrap_or(false);
    for file in [&args.responses, &args.controls].into_iter().flatten() {
        if is_json(file)? {
            bail!("{}: this file is CSV; --out takes .json, which has all statistics", file.display());
        }
    }
    ensure!(!(args.spreadsheet && as_json), "--spreadsheet is for .csv");
    let text = if args.spreadsheet { csv::for_spreadsheet } else { csv::text };
    let runs = read(&args.runs)?;
    let flagged = args.which.flagged();
    let statistics = Statistics::of(&runs, flagged);
    for quantity in &statistics.quantities {
        if let Some(words) = quantity.left_out_words() {
            note!("carved: {}: {words}", quantity.name);
        }
    }
    ensure!(
        statistics.specimens == 0 || statistics.counts_any(),
        "0 of {} measured specimens count, so that a table would have no row; nothing was written. --with-flagged counts specimens with flags{}",
        statistics.specimens,
        if flagged == Flagged::Excluded { ", and without --without-flagged those count whose flags leave the number sound" } else { "" },
    );
    match &args.out {
        Some(file) if as_json => write(file, &serde_json::to_vec_pretty(&statistics).context("the statistics cannot be written as JSON")?)?,
        Some(file) => write(file, text(&groups_table(&statistics)).as_bytes())?,
        None => say!("{}", text(&groups_table(&statistics)).trim_end()),
    }
    if let Some(file) = &args.responses {
        write(file, text(&responses_table(&statistics)).as_bytes())?;
    }
    if let Some(file) = &args.controls {
        write(file, text(&windows_table(&statistics)).as_bytes())?;
    }
    Ok(left_out(&runs))
}

fn is_json(file: &Path) -> anyhow::Result<bool> {
    match file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("csv") => Ok(false),
        Some("json") => Ok(true),
        _ => bail!("{}: the name of a file with statistics ends in .csv or .json", file.display()),
    }
}
