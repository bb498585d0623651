//! `carved import --plate`: makes a run of the pictures of a plate.
//!
//! ```text
//!  FRAMES ── tree ── names ── sort ── wells, views ──┐
//!  --angles, --even, --cameras ── angle per view ────┼─ --dry-run: printed
//!  --plate-map ── plan ──────────────────────────────┴─ per well: look, write, measure ── run.json ── in place, indexed
//! ```
//! A well whose pictures cannot be used or measured is `failed` in the run with the reason; the others go on. The run is made beside its
//! place (`part`) and renamed when it is complete. After an interruption the same command goes on with the wells that are not done.

mod dry;
mod part;
mod plan;
pub(in crate::cli) mod sort;
mod tree;
mod well;

use super::rig;
use crate::cli::run::code_of;
use anyhow::{Context, bail, ensure};
use carved_core::frame::RawFrame;
use carved_core::quality::RecentOpacities;
use carved_records::picture_name::{self, Pattern};
use carved_records::{Method, Mode, PicturesOfWells, RunOutcome, SamePictures, SpecimenOutcome, WellStatus, is_plain_name};
use carved_store::{MeasurementFile, RecordingReader, RunRecord, durable};
use part::{DoneWell, Part};
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
    /// The fish of each well that is imported, where wells have several; `all` makes a run of each: RUN-fish1, RUN-fish2, ..
    #[arg(long, requires = "plate", value_name = "NUMBER|all", value_parser = Fish::read)]
    pub fish: Option<Fish>,
    /// Pictures per turn, the repeat at 360 deg included [default: those of most wells]
    #[arg(long, requires = "plate", value_parser = clap::value_parser!(u32).range(3..=10_000))]
    pub views: Option<u32>,
    /// Plate map (CSV or JSON) with age, compound and more of the wells, as in a run
    #[arg(long, requires = "plate", value_name = "FILE")]
    pub plate_map: Option<PathBuf>,
    /// What each column of the plate map is: the corrected output of `carved plate columns` [default: by the headings]
    #[arg(long, requires = "plate_map", value_name = "JSON")]
    pub columns: Option<PathBuf>,
    /// Wells of the plate: 6, 12, 24, 48, 96, 384 or 1536 [default: as the plate map says]
    #[arg(long, requires = "plate", value_name = "WELLS")]
    pub plate_format: Option<u32>,
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

/// Which fish of each well are imported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fish {
    One(u32),
    All,
}

impl Fish {
    fn read(text: &str) -> Result<Self, String> {
        let number = || text.parse().map(Self::One).map_err(|_| format!("found {text:?}, expected the number of a fish, or all"));
        if text == "all" { Ok(Self::All) } else { number() }
    }
}

/// Imports the plate, or says what it would import. Every fish may become a run of its own.
///
/// # Errors
/// Names, options or files that do not make a plate, an existing run, or a disk that does not take the run. No run is left then. Wells
/// that were finished are kept for the next time.
pub(super) fn run(args: &super::Args, barcode: &str) -> anyhow::Result<ExitCode> {
    let id = args.of_plate.run.as_deref().unwrap_or(barcode);
    let fish = match args.of_plate.fish {
        Some(Fish::All) => sort::all_fish(&tree::read(&args.frames, args.of_plate.pattern.as_ref())?.labelled),
        Some(Fish::One(fish)) => return Ok(one_run(args, barcode, id, Some(fish))?.into()),
        None => return Ok(one_run(args, barcode, id, None)?.into()),
    };
    let mut codes: Vec<u8> = Vec::new();
    for fish in &fish {
        let id = format!("{id}-fish{fish}");
        let sources = rig::load(args, &mut |_| ())?;
        // The command may be repeated after an interruption.
        if folder_of(args, &sources, &id)?.symlink_metadata().is_ok() {
            note!("carved: the run {id} is there already; it is left as it is");
        } else {
            codes.push(one_run(args, barcode, &id, Some(*fish)).with_context(|| format!("fish {fish}"))?);
        }
    }
    ensure!(
        !codes.is_empty(),
        "the runs of all {} fish are there already; nothing is overwritten. Give another name with --run",
        fish.len()
    );
    let (partial, failed) = (code_of(RunOutcome::Partial), code_of(RunOutcome::Failed));
    let all = |code| codes.iter().all(|found| *found == code);
    Ok(ExitCode::from(if all(0) {
        0
    } else if all(failed) {
        failed
    } else {
        partial
    }))
}

/// Imports one fish of each well into a run. Returns the exit code.
fn one_run(args: &super::Args, barcode: &str, id: &str, fish: Option<u32>) -> anyhow::Result<u8> {
    let mut warnings: Vec<String> = Vec::new();
    let mut warn = |doubt: String| {
        if !warnings.contains(&doubt) {
            note!("carved: {doubt}");
            warnings.push(doubt);
        }
    };
    let sources = rig::load(args, &mut warn)?;
    let out = folder_of(args, &sources, id)?;
    ensure!(
        out.symlink_metadata().is_err(),
        "{}: the run is there already; nothing is overwritten. Give another name with --run",
        out.display()
    );
    let found = tree::read(&args.frames, args.of_plate.pattern.as_ref())?;
    if !found.others.is_empty() {
        warn(format!("{} pictures are not imported, their names do not say well and view: {}", found.others.len(), found.others_named()));
    }
    let example = found.labelled.iter().find(|(_, label)| fish.is_none_or(|fish| label.fish.unwrap_or(1) == fish)).cloned();
    let plate = sort::sort(found.labelled, fish)?;
    plate.warnings.iter().cloned().for_each(&mut warn);
    let plan = Plan::of(args, barcode, &plate, &sources, &mut warn)?;
    if args.of_plate.dry_run {
        dry::print(&out, example.as_ref(), &plate, &plan)?;
        return Ok(0);
    }
    durable::create_folder(durable::folder_of(&out))?;
    let part = Part::of(&out)?;
    let mut wells: Vec<WellStatus> = Vec::new();
    let mut pictures = PicturesOfWells::default();
    let mut empty: Option<Arc<RawFrame>> = None;
    let mut opacities = RecentOpacities::default();
    for planned in &plan.run.plate_map {
        let (folder, usual_opacity) = (part.path().join(&planned.well), opacities.usual());
        let well = Well { args, sources: &sources, plan: &plan, run: id, planned, folder, usual_opacity };
        let status = match plate.wells.get(&planned.well) {
            Some(pictures) => {
                let key = well.key(pictures)?;
                if let Some(done) = part.done(&well.folder, &key)? {
                    note!("carved: {}: was imported before the interruption", planned.well);
                    done.warnings.into_iter().for_each(&mut warn);
                    well.take_empty(&mut empty)?;
                    done.status
                } else {
                    let mut of_well = Vec::new();
                    let status = match part.begin(&planned.well, &key)? {
                        Some(why) => well.set_aside(&why),
                        None => well.import(pictures, &mut empty, &mut |doubt| {
                            of_well.push(doubt.clone());
                            warn(doubt);
                        })?,
                    };
                    part.keep(&planned.well, &DoneWell { key, status: status.clone(), warnings: of_well })?;
                    status
                }
            }
            None => well.without_pictures(),
        };
        say!("{}", line(&status));
        wells.push(status);
        if well.folder.is_dir() {
            let reader = RecordingReader::open(&well.folder)?;
            let numbers = reader.closed_numbers();
            if let Some(opacity) = numbers.as_ref().and_then(|file| file.record.opacity()) {
                opacities.add(opacity);
            }
            // At once, so that an import that is stopped later has not left them as measured.
            let pairs = pictures_in_common(&mut pictures, &reader, numbers.as_ref(), &planned.well);
            for failed in fail_same(&pairs, &mut wells, &mut warn) {
                // Its first line has numbers.
                say!("{}", line(failed));
            }
        }
    }
    if !wells.iter().any(|w| part.path().join(&w.well).is_dir()) {
        let why = wells.iter().find_map(|w| w.reason.as_deref()).unwrap_or("it has no well");
        part.remove();
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
        "fish": fish,
        "not_imported": found.others,
        "warnings": warnings,
    });
    durable::write_json(&part.path().join("import.json"), &origin)?;
    durable::write_json(&part.path().join("run.json"), &record)?;
    part.put(&out)?;
    followed(&out, id);
    say!("{}", report(&out, outcome, &record.wells));
    Ok(code_of(outcome))
}

/// What is printed at the end.
fn report(out: &Path, outcome: RunOutcome, wells: &[WellStatus]) -> serde_json::Value {
    let count = |outcome| wells.iter().filter(|w| w.outcome == Some(outcome)).count();
    json!({
        "run": out,
        "outcome": outcome,
        "wells": wells.len(),
        "succeeded": count(SpecimenOutcome::Succeeded),
        "failed": count(SpecimenOutcome::Failed),
        "skipped": count(SpecimenOutcome::Skipped),
    })
}

/// Takes the pictures of a well. Returns the other wells that have some of them, as they are or in another format.
fn pictures_in_common(
    pictures: &mut PicturesOfWells,
    reader: &RecordingReader,
    numbers: Option<&MeasurementFile>,
    well: &str,
) -> Vec<SamePictures> {
    let mut pairs: Vec<SamePictures> = pictures.take_all(&reader.recording().ledger, well).into_iter().collect();
    let by_outlines = numbers.and_then(|file| pictures.take_outlines(&file.record.views, well));
    pairs.extend(by_outlines.filter(|same| !pairs.contains(same)));
    pairs
}

/// Fails both wells of each pair: nothing says which of them the pictures show. Returns the wells that have failed.
fn fail_same<'a>(pairs: &[SamePictures], wells: &'a mut [WellStatus], warn: &mut dyn FnMut(String)) -> Vec<&'a WellStatus> {
    for pair in pairs {
        let why = format!("{pair}. Import each well with its own pictures");
        wells.iter_mut().filter(|status| [&pair.well, &pair.earlier].contains(&&status.well)).for_each(|status| status.fail_measured(&why));
        warn(why);
    }
    let is_of_pair = |status: &&WellStatus| pairs.iter().any(|pair| [&pair.well, &pair.earlier].contains(&&status.well));
    wells.iter().filter(is_of_pair).collect()
}

/// Refuses the pictures of several wells or fish where those of one specimen are expected.
///
/// # Errors
/// Their names say two wells or two fish or more, each with enough pictures for a turn.
pub(super) fn check_one_specimen(paths: &[PathBuf]) -> anyhow::Result<()> {
    let mut fish: BTreeMap<u32, u32> = BTreeMap::new();
    for number in paths.iter().filter_map(|path| tree::without_well(path)) {
        *fish.entry(number).or_default() += 1;
    }
    fish.retain(|_, pictures| *pictures >= Method::LEAST_ASD);
    let numbers: Vec<u32> = fish.into_keys().collect();
    ensure!(
        numbers.len() < 2,
        "the names say {} fish, {}; expected the pictures of one specimen. Give the files of one fish, as VAST_1_*.tiff. To import all, put the \
         pictures of each well into a folder that is named after it, and give --plate BARCODE --fish all",
        numbers.len(),
        sort::first_of(&numbers)
    );
    let mut wells: BTreeMap<String, u32> = BTreeMap::new();
    for well in paths.iter().filter_map(|path| picture_name::read(Path::new(path.file_name()?), None)?.well) {
        *wells.entry(well).or_default() += 1;
    }
    let wells: Vec<&String> = wells.iter().filter(|(_, pictures)| **pictures >= Method::LEAST_ASD).map(|(well, _)| well).collect();
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

/// The folder of a run.
fn folder_of(args: &super::Args, sources: &rig::Sources, id: &str) -> anyhow::Result<PathBuf> {
    ensure!(
        is_plain_name(id),
        "--run (or --plate): found {id:?}, expected a name of 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'"
    );
    let data = args.of_plate.data.as_deref().or(sources.data_dir());
    Ok(data.unwrap_or(Path::new("carved-data")).join("runs").join(id))
}

/// Puts the run into the index of its data folder, so that a daemon that serves this folder lists it at once.
fn followed(out: &Path, id: &str) {
    let root = durable::folder_of(durable::folder_of(out));
    if let Err(error) = carved_store::follow_run(root, id).with_context(|| format!("{}: the run is complete", out.display())) {
        note!("carved: {error:#}. The next start of the daemon lists it");
    }
}
