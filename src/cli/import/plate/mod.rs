//! `carved import --plate`: makes a run of the pictures of a plate.
//!
//! ```text
//!  FRAMES ── tree ── names ── sort ── wells, views ──┐
//!  --angles, --even, --cameras ── angle per view ────┼─ --dry-run: told
//!  --plate-map ── plan ──────────────────────────────┴─ per well: look, write, measure ── run.json ── in place, indexed
//! ```
//! A well whose pictures cannot be used or measured is `failed` in the run with the reason; the others go on. The run is made beside its
//! place and renamed when it is complete.

mod dry;
mod plan;
mod sort;
mod tree;
mod well;

use super::{rig, write};
use crate::cli::run::code_of;
use anyhow::{Context, bail, ensure};
use carved_core::frame::RawFrame;
use carved_devices::acquisition::RevolutionPlan;
use carved_records::picture_name::{self, Pattern};
use carved_records::{Mode, RunOutcome, SpecimenOutcome, WellStatus, is_plain_name};
use carved_store::{RunRecord, durable};
use plan::Plan;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use well::Well;

/// The options of a plate.
#[derive(Debug, clap::Args)]
pub(super) struct PlateArgs {
    /// Import a plate: the pictures of its wells become one run, which is measured. BARCODE is the name of the plate
    #[arg(long, value_name = "BARCODE")]
    pub plate: Option<String>,
    /// How the pictures are named: {well}, {fish}, {view}, {age}, {date}, {plate}, and {_} for any other text, as in
    /// "{date}_{age}dpf_{_}_W_{well}_{fish}_{view}_rot.tiff" or "{well}/VAST_{fish}_{view}" [default: the names of VAST's programs]
    #[arg(long, requires = "plate", value_parser = Pattern::read)]
    pub pattern: Option<Pattern>,
    /// Only say what the names mean, what is missing and what is double; nothing is written
    #[arg(long, requires = "plate")]
    pub dry_run: bool,
    /// The fish of each well that is imported, where wells have several
    #[arg(long, requires = "plate", value_name = "NUMBER")]
    pub fish: Option<u32>,
    /// Pictures per turn, the repeat at 360 deg included [default: those of most wells]
    #[arg(long, requires = "plate", value_parser = clap::value_parser!(u32).range(3..=10_000))]
    pub views: Option<u32>,
    /// Plate map (CSV or JSON) with age, compound and more of the wells, as in a run
    #[arg(long, requires = "plate", value_name = "FILE")]
    pub plate_map: Option<PathBuf>,
    /// Name of the run [default: the barcode]
    #[arg(long, requires = "plate", value_name = "NAME")]
    pub run: Option<String>,
    /// Data folder that the run is put into [default: that of --config, else carved-data]
    #[arg(long, requires = "plate", value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Name of the operator
    #[arg(long, requires = "plate", default_value = "import")]
    pub operator: String,
}

/// Imports the plate, or says what it would import.
///
/// # Errors
/// Names, options or files that do not make a plate, an existing run, or a disk that does not take the run. No run is left then.
pub(super) fn run(args: &super::Args, barcode: &str) -> anyhow::Result<ExitCode> {
    let mut warnings: Vec<String> = Vec::new();
    let mut warn = |doubt: String| {
        if !warnings.contains(&doubt) {
            note!("carved: {doubt}");
            warnings.push(doubt);
        }
    };
    let sources = rig::load(args, &mut warn)?;
    let id = args.of_plate.run.as_deref().unwrap_or(barcode);
    let out = destination(args.of_plate.data.as_deref().or(sources.data_dir()), id)?;
    let found = tree::read(&args.frames, args.of_plate.pattern.as_ref())?;
    if !found.others.is_empty() {
        warn(format!("{} pictures are not imported, their names do not say well and view: {}", found.others.len(), found.others_named()));
    }
    let example = found.labelled.first().cloned();
    let plate = sort::sort(found.labelled, args.of_plate.fish)?;
    plate.warnings.iter().cloned().for_each(&mut warn);
    let plan = Plan::of(args, barcode, &plate, &sources, &mut warn)?;
    if args.of_plate.dry_run {
        dry::tell(&out, example.as_ref(), &plate, &plan)?;
        return Ok(ExitCode::SUCCESS);
    }
    durable::create_folder(durable::folder_of(&out))?;
    let part = write::Part::beside(&out)?;
    let mut wells: Vec<WellStatus> = Vec::new();
    let mut empty: Option<Arc<RawFrame>> = None;
    for planned in &plan.run.plate_map {
        let well = Well { args, sources: &sources, plan: &plan, run: id, planned, folder: part.path().join(&planned.well) };
        let status = match plate.wells.get(&planned.well) {
            Some(pictures) => well.import(pictures, &mut empty, &mut warn)?,
            None => well.without_pictures(),
        };
        say!("{}", line(&status));
        wells.push(status);
    }
    if !wells.iter().any(|w| part.path().join(&w.well).is_dir()) {
        let why = wells.iter().find_map(|w| w.reason.as_deref()).unwrap_or("it has no well");
        bail!("none of the {} wells can be imported; no run was made. The first: {why}", wells.len());
    }
    let mut record = RunRecord::new(id, plan.run.clone(), plan.method.clone(), Mode::Imported, empty.as_deref());
    record.wells = wells;
    let outcome = RunOutcome::of_wells(&record.wells);
    record.end(outcome);
    let origin = json!({
        "schema": "carved.import-plate/1",
        "from": args.frames,
        "angles": plan.angles_from,
        "views": plan.views,
        "fish": args.of_plate.fish,
        "not_imported": found.others,
        "warnings": warnings,
    });
    durable::write_json(&part.path().join("import.json"), &origin)?;
    durable::write_json(&part.path().join("run.json"), &record)?;
    part.put(&out)?;
    followed(&out, id);
    let count = |outcome| record.wells.iter().filter(|w| w.outcome == Some(outcome)).count();
    let told = json!({
        "run": out,
        "outcome": outcome,
        "wells": record.wells.len(),
        "succeeded": count(SpecimenOutcome::Succeeded),
        "failed": count(SpecimenOutcome::Failed),
        "skipped": count(SpecimenOutcome::Skipped),
    });
    say!("{told}");
    Ok(ExitCode::from(code_of(outcome.into())))
}

/// Refuses the pictures of several wells where those of one specimen are expected.
///
/// # Errors
/// Their names say two wells or more, each with enough pictures for a turn.
pub(super) fn is_one_specimen(paths: &[PathBuf]) -> anyhow::Result<()> {
    let mut wells: BTreeMap<String, u32> = BTreeMap::new();
    for well in paths.iter().filter_map(|path| picture_name::read(Path::new(path.file_name()?), None)?.well) {
        *wells.entry(well).or_default() += 1;
    }
    let wells: Vec<&String> = wells.iter().filter(|(_, pictures)| **pictures >= RevolutionPlan::LEAST_ASD).map(|(well, _)| well).collect();
    ensure!(
        wells.len() < 2,
        "the names say {} wells, {}; expected the pictures of one specimen. To import them as a plate, give --plate BARCODE",
        wells.len(),
        sort::first_of(&wells)
    );
    Ok(())
}

/// The line of a well.
fn line(status: &WellStatus) -> serde_json::Value {
    json!({
        "well": status.well,
        "outcome": status.outcome,
        "reason": status.reason,
        "views": status.views,
        "volume_um3": status.volume_um3,
        "volume_sd_um3": status.volume_sd_um3,
        "area_um2": status.area_um2,
        "flags": status.flags,
    })
}

/// The folder of the run, which must be new.
fn destination(data: Option<&Path>, id: &str) -> anyhow::Result<PathBuf> {
    ensure!(
        is_plain_name(id),
        "--run (or --plate): found {id:?}, expected a name of 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'"
    );
    let out = data.unwrap_or(Path::new("carved-data")).join("runs").join(id);
    ensure!(
        out.symlink_metadata().is_err(),
        "{}: the run is there already; nothing is overwritten. Give another name with --run",
        out.display()
    );
    Ok(out)
}

/// Puts the run into the index of its data folder, so that a daemon that serves this folder lists it at once.
fn followed(out: &Path, id: &str) {
    let root = durable::folder_of(durable::folder_of(out));
    if let Err(error) = carved_store::follow_run(root, id).with_context(|| format!("{}: the run is complete", out.display())) {
        note!("carved: {error:#}. The next start of the daemon lists it");
    }
}
