//! `carved plate check`: a plate map's file, read as the instrument would read it.

use anyhow::Context;
use carved_records::plate_map::{self, Format, Mistake, PlateMap};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The plate map holds mistakes, which were printed.
pub const MISTAKES: u8 = 3;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Read a plate map and say everything that is wrong with it (docs/plate-map.md).
    Check(Args),
}

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A CSV, or a JSON file (`.json`).
    file: PathBuf,
    /// One of several plates of a MIHCSME file.
    #[arg(long)]
    plate: Option<String>,
    /// Print the wells as `PUT /v1/runs/{id}` takes them.
    #[arg(long)]
    json: bool,
}

/// The plate map of a file, or its mistakes.
pub fn read(file: &Path, plate: Option<&str>) -> anyhow::Result<Result<PlateMap, Vec<Mistake>>> {
    let bytes = carved_files::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let json = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    Ok(plate_map::read(&bytes, if json { Format::Json } else { Format::Csv }, plate))
}

/// Prints mistakes, one a line, as compilers do.
pub fn print(file: &Path, mistakes: &[Mistake]) {
    for mistake in mistakes {
        note!("{}: {mistake}", file.display());
    }
    note!("{} mistake(s)", mistakes.len());
}

pub fn run(command: &Command) -> anyhow::Result<ExitCode> {
    let Command::Check(args) = command;
    let map = match read(&args.file, args.plate.as_deref())? {
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
