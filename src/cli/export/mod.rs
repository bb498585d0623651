//! `carved export`: stored runs in the formats of other programs.

mod loaddata;
mod mihcsme;
mod model;
mod ome_tiff;
mod ome_zarr;
mod pictures;
mod provenance;
pub mod statistics;
mod table;
mod views;

use anyhow::{Context, ensure};
use carved_records::PlannedWell;
use carved_store::{Computation, StoredRun, durable};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Write one row per specimen of any number of runs, as CSV or Parquet.
    Table(table::Args),
    /// Print the columns of that table and what each holds.
    Columns,
    /// Write statistics of any number of runs: groups and compounds, controls, dose-response curves.
    Statistics(statistics::Args),
    /// Write how runs were measured, as a paragraph for a paper and with every parameter.
    Methods(provenance::MethodsArgs),
    /// Make a run's folder an RO-Crate: files with their hashes, and what made them.
    Rocrate(provenance::CrateArgs),
    /// Write what the `BioImage` Archive asks of a study (REMBI), as far as the runs know it, and name what is to be filled in.
    Rembi(provenance::RembiArgs),
    /// Write the plate's MIHCSME metadata with the results as conditions, as the JSON of mihcsme-py, for OMERO.
    Mihcsme(mihcsme::Args),
    /// Write the voxel model of a specimen as NRRD, for 3D Slicer, ITK and ParaView.
    Nrrd(model::NrrdArgs),
    /// Write the voxel model of a specimen as an OME-Zarr 0.5 image with labels, for napari and all that reads OME-Zarr.
    Voxels(model::VoxelsArgs),
    /// Write the outlines of a specimen's views as regions of ImageJ, for Fiji.
    Rois(model::RoisArgs),
    /// Write the surface of a specimen as binary STL, for printers.
    Stl(model::StlArgs),
    /// Write the surface of a specimen as GLB (glTF 2.0), for Blender and viewers.
    Glb(model::GlbArgs),
    /// Write the views of a specimen or of a whole run as OME-TIFF, for Fiji, CellProfiler, QuPath and OMERO.
    OmeTiff(ome_tiff::Args),
    /// Write the standard pictures of a run's larvae: the left side and the back, head to the left, at one scale, as PNG and TIFF.
    Pictures(pictures::Args),
    /// Write the frames of runs as a list for the module `LoadData` of `CellProfiler`.
    Loaddata(loaddata::Args),
    /// Write the views of a run as an OME-Zarr 0.5 plate, for napari and all that reads OME-Zarr.
    OmeZarr(ome_zarr::Args),
}

/// Runs the named export.
///
/// # Errors
/// A run that cannot be read, or a file that cannot be written.
pub fn run(command: &Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Table(args) => return table::run(args),
        Command::Statistics(args) => return statistics::run(args),
        Command::Methods(args) => return provenance::methods(args),
        Command::Mihcsme(args) => return mihcsme::run(args),
        Command::Rocrate(args) => provenance::rocrate(args),
        Command::Rembi(args) => provenance::rembi(args),
        Command::Nrrd(args) => model::nrrd(args),
        Command::Voxels(args) => model::voxels(args),
        Command::Rois(args) => model::rois(args),
        Command::Stl(args) => model::stl(args),
        Command::Glb(args) => model::glb(args),
        Command::OmeTiff(args) => ome_tiff::run(args),
        Command::Pictures(args) => pictures::run(args),
        Command::Loaddata(args) => loaddata::run(args),
        Command::OmeZarr(args) => ome_zarr::run(args),
        Command::Columns => {
            say!("{}", crate::tables::page().trim_end());
            Ok(())
        }
    }
    .map(|()| ExitCode::SUCCESS)
}

/// Reads the runs of folders.
///
/// # Errors
/// A folder without a run, a run that cannot be read, and two runs of one name, whose rows could not be told apart.
pub(super) fn read(folders: &[PathBuf]) -> anyhow::Result<Vec<StoredRun>> {
    let mut names = BTreeSet::new();
    let mut runs = Vec::new();
    for folder in folders {
        ensure!(folder.join("run.json").is_file(), "{}: no run: it has no run.json. Name folders such as DATA/runs/RUN", folder.display());
        let run = StoredRun::read(folder)?;
        let name = run.record().id.clone();
        ensure!(names.insert(name.clone()), "{}: the run {name} is named twice; a table has each run once", folder.display());
        runs.push(run);
    }
    note_copies(&runs);
    Ok(runs)
}

/// Says which wells of different runs have pictures in common: one is a copy of the other, and its numbers would count twice. Pictures of
/// one run are compared when they are taken or imported. No two pictures of a camera are equal, because of its noise.
fn note_copies(runs: &[StoredRun]) {
    if runs.len() < 2 {
        return;
    }
    let mut first: HashMap<String, usize> = HashMap::new();
    let mut wells: Vec<String> = Vec::new();
    let mut common: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for run in runs {
        let of_run = wells.len()..;
        for well in run.wells() {
            let Some(recording) = well.recording else { continue };
            let this = wells.len();
            wells.push(format!("{} {}", run.record().id, well.planned.well));
            for hash in recording["ledger"].as_array().into_iter().flatten().filter_map(|entry| entry["sha256"].as_str()) {
                let other = *first.entry(hash.to_owned()).or_insert(this);
                if !of_run.contains(&other) {
                    *common.entry((other, this)).or_default() += 1;
                }
            }
        }
    }
    for ((a, b), pictures) in common {
        note!(
            "carved: {} and {} have {pictures} picture(s) in common: one is a copy of the other, and its numbers count twice. Leave one of the \
             runs out",
            wells[a],
            wells[b]
        );
    }
}

/// Exit code where wells were left out, because a file of theirs was altered or cannot be read. All others are in what was written.
const SOME_LEFT_OUT: u8 = 3;

/// Names the wells that cannot be read. Returns the exit code.
pub(super) fn left_out(runs: &[StoredRun]) -> ExitCode {
    let mut code = ExitCode::SUCCESS;
    for run in runs {
        for well in run.wells() {
            if let Computation::Unreadable(why) = &well.computation {
                note!("carved: {} {} was left out: {why}", run.record().id, well.planned.well);
                code = ExitCode::from(SOME_LEFT_OUT);
            }
        }
    }
    code
}

/// The planned wells of a run, or those of them that are named.
///
/// # Errors
/// A name that is no well of the run.
pub(super) fn wells<'r>(run: &'r StoredRun, named: &[String]) -> anyhow::Result<Vec<&'r PlannedWell>> {
    let plan = &run.record().plan.plate_map;
    for well in named {
        ensure!(plan.iter().any(|planned| planned.well == *well), "{well:?} is no well of the run {}", run.record().id);
    }
    Ok(plan.iter().filter(|planned| named.is_empty() || named.contains(&planned.well)).collect())
}

/// Writes a file whole or not at all.
pub(super) fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    durable::write(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}
