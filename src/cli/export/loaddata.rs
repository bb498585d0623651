//! `carved export loaddata`: the frames of runs as a list for the module `LoadData` of `CellProfiler`.

use super::{ome_zarr::recorded, read, views, write};
use anyhow::{Context, ensure};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folders of runs (`DATA/runs/RUN`) whose frames are single files.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// File for one row per view (`.csv`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// The columns. `CellProfiler` knows those that begin with `Image_` and `Metadata_`.
const COLUMNS: [&str; 18] = [
    "Image_FileName_Frame",
    "Image_PathName_Frame",
    "Image_FileName_Profile",
    "Image_PathName_Profile",
    "Metadata_Plate",
    "Metadata_Run",
    "Metadata_Well",
    "Metadata_View",
    "Metadata_AngleDeg",
    "Metadata_Specimen",
    "Metadata_Dpf",
    "Metadata_Compound",
    "Metadata_Concentration",
    "Metadata_ConcentrationUnit",
    "Metadata_Strain",
    "Metadata_Treatment",
    "Metadata_Control",
    "Metadata_Replicate",
];

/// The fields of the plate map, in the order of their columns.
const PLATE_MAP: [&str; 9] =
    ["specimen", "dpf", "compound", "concentration", "concentration_unit", "strain", "treatment", "control", "replicate"];

/// Writes the list.
///
/// # Errors
/// A run that cannot be read, recordings in packs or without their frames, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    super::model::ends_in(&args.out, "csv")?;
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(COLUMNS)?;
    let mut rows = 0;
    for run in read(&args.runs)? {
        let record = run.record();
        for planned in &record.plan.plate_map {
            let Some(reader) = recorded(&run, planned)? else { continue };
            let facts = views::plate_map_facts(&reader.recording().specimen, None)?;
            let of_map = PLATE_MAP.map(|name| facts.iter().find(|(key, _)| key == name).map_or("", |(_, value)| value.as_str()));
            for entry in views::by_number(&reader) {
                let [frame, in_folder] = place(&reader.frame_path(entry))?.with_context(|| {
                    format!(
                        "{}: it is no single file, and CellProfiler reads single files. Unpack the recording with tar -xf, or name the copy that \
                         has its frames",
                        reader.frame_path(entry).display()
                    )
                })?;
                // A view without a profile has empty cells.
                let profile = reader.files().path(&views::profile_name(entry.view as usize));
                let [profile, of_profile] = place(&profile)?.unwrap_or_default();
                let (view, angle) = (entry.view.to_string(), entry.omega.to_degrees().to_string());
                let facts = [&record.plan.plate_barcode, &record.id, &planned.well, &view, &angle].map(String::as_str);
                table
                    .write_record([&frame, &in_folder, &profile, &of_profile].map(String::as_str).into_iter().chain(facts).chain(of_map))?;
                rows += 1;
            }
        }
    }
    ensure!(rows > 0, "no well of these runs has a view");
    write(&args.out, &table.into_inner()?)?;
    note!("carved: {}: {rows} view(s)", args.out.display());
    Ok(())
}

/// Name and folder of a file. `None` if it is not there.
fn place(path: &Path) -> anyhow::Result<Option<[String; 2]>> {
    if !path.is_file() {
        return Ok(None);
    }
    let whole = path.canonicalize().with_context(|| path.display().to_string())?;
    let text = |part: Option<&std::ffi::OsStr>| {
        part.and_then(|part| part.to_str()).map(str::to_owned).with_context(|| format!("{}: its name is not UTF-8", path.display()))
    };
    Ok(Some([text(whole.file_name())?, text(whole.parent().map(Path::as_os_str))?]))
}
