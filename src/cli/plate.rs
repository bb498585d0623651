//! `carved plate`: reads a plate map's file as the instrument does.
//!
//! ```text
//!  columns FILE ──> what each column seems to be, as JSON ──> a person corrects it ──> --columns of check, run start and import
//! ```

use anyhow::{Context, ensure};
use carved_records::plate_map::{self, Column, Format, MappedColumn, Mistake, PlateMap};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Exit code for a plate map with mistakes, which were printed.
pub const MISTAKES: u8 = 3;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Read a plate map and report everything that is wrong with it (docs/plate-map.md).
    Check(Args),
    /// Say what the columns of a table of another program seem to be, as JSON for --columns. Correct it before you use it.
    Columns {
        /// A CSV.
        file: PathBuf,
    },
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
    /// What each column of the CSV is: the corrected output of `carved plate columns` [default: by the headings]
    #[arg(long, value_name = "JSON")]
    columns: Option<PathBuf>,
    /// Print the wells in the format of `PUT /v1/runs/{id}`.
    #[arg(long)]
    json: bool,
}

/// The plate map in a file, or its mistakes. `columns` is a file that says what each column of a CSV is.
pub fn read(
    file: &Path,
    plate: Option<&str>,
    chosen: Option<u32>,
    columns: Option<&Path>,
) -> anyhow::Result<Result<PlateMap, Vec<Mistake>>> {
    let bytes = carved_files::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let json = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    let Some(columns) = columns else {
        return Ok(plate_map::read(&bytes, if json { Format::Json } else { Format::Csv }, plate, chosen));
    };
    ensure!(!json, "--columns names the columns of a CSV, and {} is JSON; leave it out", file.display());
    let name = || format!("--columns {}: expected the corrected output of `carved plate columns`", columns.display());
    let text = carved_files::read(columns).with_context(name)?;
    let columns: Vec<MappedColumn> =
        serde_json::from_slice(text.strip_prefix("\u{feff}".as_bytes()).unwrap_or(&text)).with_context(name)?;
    Ok(plate_map::read_mapped(&bytes, chosen, &columns))
}

/// Prints what each column seems to be as JSON, and its first cells beside it for the person who corrects it.
fn columns(file: &Path) -> anyhow::Result<ExitCode> {
    let bytes = carved_files::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let found = match plate_map::propose(&bytes) {
        Ok(found) => found,
        Err(mistakes) => {
            print(file, &mistakes);
            return Ok(ExitCode::from(MISTAKES));
        }
    };
    note!("{}: the headings are in line {}, and {} line(s) follow; check what each column is:", file.display(), found.line, found.rows);
    let named: Vec<MappedColumn> = found
        .columns
        .into_iter()
        .map(|column| {
            let what = column.column.map_or("kept as it is", Column::name);
            note!("  {}: {what} (cells: {})", column.heading, column.examples.join(", "));
            MappedColumn { heading: column.heading, column: column.column, unit: column.unit }
        })
        .collect();
    say!("{}", serde_json::to_string_pretty(&named)?);
    Ok(ExitCode::SUCCESS)
}

/// Prints one mistake per line, in the format of compilers.
pub fn print(file: &Path, mistakes: &[Mistake]) {
    for mistake in mistakes {
        note!("{}: {mistake}", file.display());
    }
    note!("{} mistake(s)", mistakes.len());
}

pub fn run(command: &Command) -> anyhow::Result<ExitCode> {
    let args = match command {
        Command::Check(args) => args,
        Command::Columns { file } => return columns(file),
    };
    let map = match read(&args.file, args.plate.as_deref(), args.plate_format, args.columns.as_deref())? {
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
    for note in map.notes.iter().chain(&map.confirm) {
        say!("{}: {note}", args.file.display());
    }
    say!("{}: sound, {} well(s)", args.file.display(), map.plate_map.len());
    Ok(ExitCode::SUCCESS)
}
