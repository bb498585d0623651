//! `carved export mihcsme`.

use super::{left_out, read, write};
use crate::tables::mihcsme::metadata;
use anyhow::{Context, ensure};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of a run (`DATA/runs/RUN`).
    run: PathBuf,
    /// File for the JSON [default: standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Writes the metadata of a run with its results.
///
/// # Errors
/// A run that cannot be read, a plate whose wells MIHCSME cannot name, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runs = read(std::slice::from_ref(&args.run))?;
    let run = runs.first().context("one run is named")?;
    let wells = &run.record().plan.plate_map;
    // Row letters of 1536 wells go to AF.
    if let Some(beyond) = wells.iter().find(|planned| !matches!(planned.well.as_bytes(), [b'A'..=b'P', b'0'..=b'9', b'0'..=b'9'])) {
        let well = &beyond.well;
        ensure!(false, "{}: the well {well} has no name in MIHCSME, which ends at P48; use carved export table", args.run.display());
    }
    let text = serde_json::to_vec_pretty(&metadata(run)).context("the metadata cannot be written as JSON")?;
    if let Some(file) = &args.out {
        write(file, &text)?;
        note!("carved: {}: {} well(s)", file.display(), wells.len());
        return Ok(left_out(&runs));
    }
    say!("{}", String::from_utf8_lossy(&text));
    Ok(left_out(&runs))
}
