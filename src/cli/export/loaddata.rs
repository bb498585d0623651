//! `carved export loaddata`: the frames of runs as a list for the module `LoadData` of `CellProfiler`.

use super::{ome_zarr::recorded, read, views, write};
use anyhow::{Context, ensure};
use carved_records::RunPlan;
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
    let runs = read(&args.runs)?;
    let own = own_columns(runs.iter().map(|run| &run.record().plan));
    table.write_record(COLUMNS.into_iter().chain(own.iter().map(|(key, _)| key.as_str())))?;
    let (mut rows, mut left_out) = (0, 0);
    for run in runs {
        let record = run.record();
        for planned in &record.plan.plate_map {
            let Some(reader) = recorded(&run, planned)? else { continue };
            let facts = views::plate_map_facts(&reader.recording().specimen, Some(&record.plan))?;
            let fact = |name: &str| facts.iter().find(|(key, _)| key == name).map_or("", |(_, value)| value.as_str());
            let of_map: Vec<&str> = PLATE_MAP.into_iter().chain(own.iter().map(|(_, name)| name.as_str())).map(fact).collect();
            for entry in views::by_number(&reader) {
                let [frame, in_folder] = place(&reader.frame_path(entry))?.with_context(|| {
                    format!(
                        "{}: it is no single file, and CellProfiler reads single files. Unpack the recording with tar -xf, or name the copy that \
                         has its frames",
                        reader.frame_path(entry).display()
                    )
                })?;
                let profile = reader.files().path(&views::profile_name(entry.view as usize));
                // LoadData stops at a row without the file of an image.
                let Some([profile, of_profile]) = place(&profile)? else {
                    left_out += 1;
                    continue;
                };
                let (view, angle) = (entry.view.to_string(), entry.omega.to_degrees().to_string());
                let facts = [&record.plan.plate_barcode, &record.id, &planned.well, &view, &angle].map(String::as_str);
                table.write_record(
                    [&frame, &in_folder, &profile, &of_profile].map(String::as_str).into_iter().chain(facts).chain(of_map.iter().copied()),
                )?;
                rows += 1;
            }
        }
    }
    ensure!(rows > 0, "no well of these runs has a view with a profile");
    write(&args.out, &table.into_inner()?)?;
    note!("carved: {}: {rows} view(s)", args.out.display());
    if left_out > 0 {
        note!("carved: {left_out} view(s) without a profile are not in the list: LoadData cannot read a row without the file of an image");
    }
    Ok(())
}

/// The lab's own columns of all runs: their names in the list, of letters, digits and `_`, and in the plate maps. Two columns that would have
/// one name are numbered.
fn own_columns<'p>(plans: impl Iterator<Item = &'p RunPlan>) -> Vec<(String, String)> {
    let mut found = Vec::<(String, String)>::new();
    for name in plans.filter_map(|plan| plan.metadata.get("columns")?.as_object()).flat_map(|columns| columns.keys()) {
        if found.iter().any(|(_, known)| known == name) {
            continue;
        }
        let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let is_taken = |key: &String| {
            let same = |other: &str| other.eq_ignore_ascii_case(key);
            COLUMNS.iter().any(|other| same(other)) || found.iter().any(|(other, _)| same(other))
        };
        let numbered = (2..).map(|n| format!("Metadata_{plain}_{n}"));
        let key = std::iter::once(format!("Metadata_{plain}")).chain(numbered).find(|key| !is_taken(key));
        found.extend(key.map(|key| (key, name.clone())));
    }
    found
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
