//! `carved export table`: one row per specimen.

use super::{left_out, read, write};
use crate::tables::{self, Cell, NOT_MEASURED_AGAIN, Table, csv};
use anyhow::{bail, ensure};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folders of runs (`DATA/runs/RUN`).
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// File for one row per specimen. Its name says the format: `.csv`, or `.parquet` where carved was built with the feature `parquet`
    /// [default: CSV on standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Folder that `carved measure --out` has written: its numbers stand in the tables, not those that the runs hold.
    #[arg(long, value_name = "DIR")]
    measurements: Option<PathBuf>,
    /// File for one row per slice along the body of every specimen, in the same formats.
    #[arg(long, value_name = "FILE")]
    shape: Option<PathBuf>,
    /// Write the CSV for a spreadsheet: with a byte order mark, and with an apostrophe before text that it would take for a formula.
    #[arg(long)]
    spreadsheet: bool,
}

/// Writes the tables.
///
/// # Errors
/// A run that cannot be read, a file that cannot be written, or a format that there is not.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    // A name that cannot be written is refused before anything is read.
    let formats = [&args.out, &args.shape].map(|file| file.as_deref().map(Format::of).transpose());
    let [out, shape] = formats;
    let (out, shape) = (out?, shape?);
    ensure!(!args.spreadsheet || ![out, shape].contains(&Some(Format::Parquet)), "--spreadsheet is for .csv; a .parquet has types");
    let text = if args.spreadsheet { csv::for_spreadsheet } else { csv::text };
    let mut runs = read(&args.runs)?;
    if let Some(folder) = &args.measurements {
        ensure!(folder.is_dir(), "{}: no folder of measurements", folder.display());
        runs = runs.into_iter().map(|run| run.with_measurements(folder)).collect::<Result<_, _>>()?;
    }
    let specimens = tables::specimens(&runs);
    if let Some(folder) = &args.measurements {
        let (measured, missing) = (specimens.count("measurement_sha256", |_| true), specimens.count("reason", is_missing));
        if missing > 0 {
            note!("carved: {missing} of {} measured wells have no numbers in {}", measured + missing, folder.display());
        }
    }
    match (&args.out, out) {
        (Some(file), Some(format)) => {
            write(file, &format.bytes(&specimens, text)?)?;
            note!("carved: {}: {} specimen(s) of {} run(s)", file.display(), specimens.rows.len(), runs.len());
        }
        _ => say!("{}", text(&specimens).trim_end()),
    }
    if let (Some(file), Some(format)) = (&args.shape, shape) {
        let stations = tables::stations(&runs);
        write(file, &format.bytes(&stations, text)?)?;
        note!("carved: {}: {} slice(s)", file.display(), stations.rows.len());
    }
    Ok(left_out(&runs))
}

fn is_missing(reason: &Cell) -> bool {
    *reason == Cell::from(NOT_MEASURED_AGAIN)
}

/// The format of a table's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Csv,
    Parquet,
}

impl Format {
    fn of(file: &Path) -> anyhow::Result<Self> {
        match file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("parquet") if cfg!(feature = "parquet") => Ok(Self::Parquet),
            Some("parquet") => bail!(
                "{}: this carved was built without the feature parquet. Build it with cargo install --locked --path . --features parquet; or \
                 write a .csv, and convert it with DuckDB: COPY (FROM 'results.csv') TO 'results.parquet'",
                file.display()
            ),
            _ => bail!("{}: the name of a table ends in .csv or .parquet", file.display()),
        }
    }

    fn bytes(self, table: &Table, text: fn(&Table) -> String) -> anyhow::Result<Vec<u8>> {
        match self {
            Self::Csv => Ok(text(table).into_bytes()),
            #[cfg(feature = "parquet")]
            Self::Parquet => Ok(tables::parquet::bytes(table)?),
            #[cfg(not(feature = "parquet"))]
            Self::Parquet => bail!("this carved was built without the feature parquet"),
        }
    }
}
