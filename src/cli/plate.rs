//! `carved plate check`: reads a plate map's file as the instrument does.

use anyhow::Context;
use carved_records::plate_map::{self, Format, Mistake, PlateMap};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Exit code for a plate map with mistakes, which were printed.
pub const MISTAKES: u8 = 3;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Read a plate map and report everything that is wrong with it (docs/plate-map.md).
    Check(Args),
}

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A CSV, or a JSON file (`.json`).
    file: PathBuf,
    /// Name of the plate, if a MIHCSME file has several.
    #[arg(long)]
    plate: Option<String>,
    /// Number of wells of the plate. A well that is not on it is a mistake.
    #[arg(long, value_name = "WELLS")]
    plate_format: Option<u32>,
    /// Print the wells in the format of `PUT /v1/runs/{id}`.
    #[arg(long)]
    json: bool,
}

/// The plate map in a file, or its mistakes.
pub fn read(file: &Path, plate: Option<&str>, chosen: Option<u32>) -> anyhow::Result<Result<PlateMap, Vec<Mistake>>> {
    let bytes = carved_files::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let json = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    Ok(plate_map::read(&bytes, if json { Format::Json } else { Format::Csv }, plate, chosen))
}

/// Prints one mistake per line, in the format of compilers.
pub fn print(file: &Path, mistakes: &[Mistake]) {
    for mistake in mistakes {
        note!("{}: {mistake}", file.display());
    }
    note!("{} mistake(s)", mistakes.len());
}

pub fn run(command: &Command) -> anyhow::Result<ExitCode> {
    let Command::Check(args) = command;
    let map = match read(&args.file, args.plate.as_deref(), args.plate_format)? {
        Ok(map) => map,
        Err(mistakes) => {
            print(&args.file, &mistakes);
            return Ok(ExitCode::from(MISTAKES));
        }
    };
    if args.json {
        say!("{}", serde_json::to_string_pretty(&map)?);
        return Ok(ExitCode::SUCCESS);
    }
    for note in &map.notes {
        say!("{}: {note}", args.file.display());
    }
    say!("{}: sound, {} well(s)", args.file.display(), map.plate_map.len());
    Ok(ExitCode::SUCCESS)
}
