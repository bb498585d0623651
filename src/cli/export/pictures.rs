//! `carved export pictures`: the standard pictures of every larva of a run, also of a run whose version did not write them.

use super::{read, write};
use crate::session::standard;
use crate::tables::{Cell, Heading, Kind, Table, csv};
use anyhow::Context;
use carved_records::PlannedWell;
use carved_store::{RecordingReader, SpecimenFile, StoredRun};
use std::path::{Path, PathBuf};

/// The file that says what the pictures show.
const INDEX: &str = "pictures.csv";

const COLUMNS: [(&str, Kind); 9] = [
    ("run", Kind::Text),
    ("well", Kind::Text),
    ("picture", Kind::Text),
    ("file", Kind::Text),
    ("view", Kind::Integer),
    ("off_deg", Kind::Number),
    ("confidence", Kind::Number),
    ("um_per_px", Kind::Number),
    ("reason", Kind::Text),
];

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of a run (`DATA/runs/RUN`).
    run: PathBuf,
    /// Folder for `RUN_WELL_lateral.png`, `RUN_WELL_dorsal.png`, the same as `.tif`, and `pictures.csv`.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Writes the pictures and their index.
///
/// # Errors
/// A run that cannot be read, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let runs = read(std::slice::from_ref(&args.run))?;
    let run = runs.first().context("one run is named")?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("{}: cannot be made", args.out.display()))?;
    let mut rows = Vec::new();
    for planned in &run.record().plan.plate_map {
        match pictures(run, planned)? {
            Ok(made) => {
                for picture in made {
                    let name = |is_tiff| {
                        format!("{}_{}_{}", run.record().id, planned.well, SpecimenFile::standard_name(picture.view.aspect, is_tiff))
                    };
                    write(&args.out.join(name(false)), &picture.png)?;
                    write(&args.out.join(name(true)), &picture.tiff)?;
                    rows.push(vec![
                        Cell::from(run.record().id.as_str()),
                        Cell::from(planned.well.as_str()),
                        Cell::from(picture.view.aspect.name()),
                        Cell::from(name(false).as_str()),
                        Cell::from(picture.view.view),
                        Cell::from(picture.view.off_deg),
                        Cell::from(picture.view.confidence),
                        Cell::from(picture.um_per_px),
                        Cell::Empty,
                    ]);
                }
            }
            Err(reason) => {
                let mut row = vec![Cell::Empty; COLUMNS.len()];
                row[0] = Cell::from(run.record().id.as_str());
                row[1] = Cell::from(planned.well.as_str());
                row[COLUMNS.len() - 1] = Cell::from(reason.as_str());
                rows.push(row);
            }
        }
    }
    let headings = COLUMNS.map(|(name, kind)| Heading { name: name.into(), kind }).to_vec();
    let table = Table { headings, rows };
    write(&args.out.join(INDEX), csv::text(&table).as_bytes())?;
    let (made, without) = (table.count("file", |_| true), table.count("reason", |_| true));
    note!("carved: {}: {made} picture(s); {without} well(s) without, {INDEX} says why", args.out.display());
    Ok(())
}

/// The pictures of a well, or why there are none. What is wrong with one well does not keep the others from their pictures.
fn pictures(run: &StoredRun, planned: &PlannedWell) -> anyhow::Result<Result<[standard::StandardPicture; 2], String>> {
    let stored = run.well(planned)?;
    if stored.recording.is_none() {
        return Ok(Err("nothing is recorded of it".into()));
    }
    if stored.measurement.is_none() {
        return Ok(Err("it has no numbers, which say where its head and its back are: carved measure computes them".into()));
    }
    let folder: &Path = &run.folder().join(&planned.well);
    let reader = RecordingReader::open(folder)?;
    let numbers = match reader.measurement() {
        Ok(numbers) => numbers,
        Err(error) => return Ok(Err(error.to_string())),
    };
    Ok(standard::of(&reader, &numbers).map_err(|why| why.to_string()))
}
