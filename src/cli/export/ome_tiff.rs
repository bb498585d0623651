//! `carved export ome-tiff`: the views of a specimen, or of a whole plate, as one file.

use super::model::{ends_in, facts};
use super::ome_zarr::recorded;
use super::{views, wells};
use crate::cli::folders::{has, open_recording};
use crate::export::{Place, Plate, Stack, Subject, ome_tiff};
use anyhow::{Context, ensure};
use carved_core::frame::PixelFormat;
use carved_core::geometry::Camera;
use carved_records::{LedgerEntry, RunPlan};
use carved_store::{RecordingReader, StoredRun, durable};
use std::io::{BufWriter, Write};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording (`DATA/runs/RUN/WELL`, or its pack `WELL.tar`), or a run (`DATA/runs/RUN`), whose wells become one plate.
    #[arg(value_name = "RECORDING|RUN")]
    input: PathBuf,
    /// Wells of the run [default: all with views]
    wells: Vec<String>,
    /// File for the views (`.ome.tiff` or `.ome.tif`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Add the outlines as regions, polygons at sub-pixel positions. They are found in the frames again, as `carved measure` does.
    #[arg(long)]
    outlines: bool,
    /// Add the stored profiles as an image of labels: 1 inside, 0 outside.
    #[arg(long)]
    labels: bool,
}

/// Writes the views.
///
/// # Errors
/// A recording that cannot be read or has no view, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let is_tiff = ends_in(&args.out, "tiff").or_else(|_| ends_in(&args.out, "tif")).is_ok();
    let is_ome = args.out.file_stem().is_some_and(|stem| stem.to_string_lossy().to_lowercase().ends_with(".ome"));
    ensure!(is_tiff && is_ome, "{}: the name of this file ends in .ome.tiff", args.out.display());
    let (plate, specimens) = if has(&args.input, "run.json") { of_run(args)? } else { of_recording(args)? };
    durable::write_by(&args.out, |file| -> anyhow::Result<()> {
        let mut out = BufWriter::new(file);
        ome_tiff(&mut out, &plate, |Place { subject, stack, view }| specimens[subject].picture(stack, view))?;
        out.flush().with_context(|| format!("{}: cannot be written", args.out.display()))
    })?;
    let views: usize = plate.subjects.iter().map(|subject| subject.stacks[0].views.len()).sum();
    let megabytes = args.out.metadata().map_or(0, |file| file.len()) as f64 / 1e6;
    note!("carved: {}: {} well(s), {views} view(s), {megabytes:.1} MB", args.out.display(), specimens.len());
    Ok(())
}

/// One recording on a plate of its own.
fn of_recording(args: &Args) -> anyhow::Result<(Plate, Vec<Specimen>)> {
    ensure!(args.wells.is_empty(), "{}: wells can be named of a run; this is no run", args.input.display());
    let reader = open_recording(&args.input)?;
    let recording = reader.recording();
    ensure!(recording.ledger.carved().next().is_some(), "{}: 0 views are recorded; a file needs at least 1", args.input.display());
    // A recording does not know the plate of its run, and one that was copied out of its run has no lab's columns.
    let size = views::size(None, &std::iter::once(recording.specimen.well.as_str()));
    let run = args.input.parent().filter(|folder| has(folder, "run.json")).map(StoredRun::read).transpose()?;
    let name = recording.run.clone();
    let (subject, specimen) = Specimen::new(reader, run.as_ref().map(|run| &run.record().plan), args)?;
    Ok((Plate { run: name, size, subjects: vec![subject] }, vec![specimen]))
}

/// The wells of a run.
fn of_run(args: &Args) -> anyhow::Result<(Plate, Vec<Specimen>)> {
    let run = StoredRun::read(&args.input)?;
    let plan = &run.record().plan;
    let (mut subjects, mut specimens) = (Vec::new(), Vec::new());
    for planned in wells(&run, &args.wells)? {
        if let Some(reader) = recorded(&run, planned)? {
            let (subject, specimen) = Specimen::new(reader, Some(plan), args)?;
            subjects.push(subject);
            specimens.push(specimen);
        } else {
            ensure!(args.wells.is_empty(), "{}: nothing was recorded of well {}", args.input.display(), planned.well);
        }
    }
    ensure!(!specimens.is_empty(), "{}: no well of this run has a view", args.input.display());
    let size = views::size(plan.plate_format, &plan.plate_map.iter().map(|planned| planned.well.as_str()));
    Ok((Plate { run: run.record().id.clone(), size, subjects }, specimens))
}

/// What the pictures of a stack are.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Camera,
    SecondCamera,
    Profile,
}

/// A recording with the views of each of its stacks.
struct Specimen {
    reader: RecordingReader,
    stacks: Vec<(Kind, Vec<LedgerEntry>)>,
}

impl Specimen {
    fn new(reader: RecordingReader, plan: Option<&RunPlan>, args: &Args) -> anyhow::Result<(Subject, Self)> {
        let recording = reader.recording();
        let rig = &recording.rig;
        let entries = views::by_number(&reader);
        let mut described = vec![stack("bright field", &rig.camera, rig.pixel_format, &entries)];
        if args.outlines {
            let mut found = views::outlines(&reader)?;
            described[0].outlines = entries.iter().map(|entry| found.remove(&entry.view).unwrap_or_default()).collect();
        }
        let mut stacks = vec![(Kind::Camera, entries.clone())];
        let of_second: Vec<&LedgerEntry> = entries.iter().copied().filter(|entry| entry.second.is_some()).collect();
        if let Some(second) = rig.second.as_ref().filter(|_| !of_second.is_empty()) {
            described.push(stack("second camera", &second.optics.camera, PixelFormat::Mono8, &of_second));
            stacks.push((Kind::SecondCamera, of_second));
        }
        if args.labels {
            let with_profile: Vec<&LedgerEntry> =
                entries.iter().copied().filter(|entry| reader.files().has(&views::profile_name(entry.view as usize))).collect();
            ensure!(!with_profile.is_empty(), "{}: no profile is stored", reader.folder().display());
            described.push(stack("profile", &rig.camera, PixelFormat::Mono8, &with_profile));
            stacks.push((Kind::Profile, with_profile));
        }
        let stacks = stacks.into_iter().map(|(kind, views)| (kind, views.into_iter().cloned().collect())).collect();
        let subject = Subject {
            well: recording.specimen.well.clone(),
            place: views::place(&recording.specimen.well)?,
            started: recording.started.parse().ok(),
            facts: all_facts(&reader, plan)?,
            stacks: described,
        };
        Ok((subject, Self { reader, stacks }))
    }

    /// The interleaved pixels of a view, by the numbers in the lists.
    fn picture(&self, stack: usize, view: usize) -> anyhow::Result<Vec<u8>> {
        let (kind, views) = &self.stacks[stack];
        let entry = &views[view];
        Ok(match kind {
            Kind::Camera => views::interleaved(&self.reader.frame(entry)?),
            Kind::SecondCamera => views::interleaved(&views::second(&self.reader, entry)?),
            Kind::Profile => views::profile(&self.reader, entry.view as usize)?
                .with_context(|| format!("{}: the profile of view {} is gone", self.reader.folder().display(), entry.view))?,
        })
    }
}

fn stack(channel: &str, camera: &Camera, format: PixelFormat, entries: &[&LedgerEntry]) -> Stack {
    Stack {
        channel: channel.into(),
        size: [camera.width, camera.height],
        samples: views::samples(format),
        pixel_um: [1.0 / camera.kx, 1.0 / camera.ky],
        views: entries.iter().map(|entry| (entry.view, entry.omega.to_degrees())).collect(),
        outlines: Vec::new(),
    }
}

/// The facts of a recording, its main numbers, and all that the plate map says about the well.
fn all_facts(reader: &RecordingReader, plan: Option<&RunPlan>) -> anyhow::Result<Vec<(String, String)>> {
    let recording = reader.recording();
    let mut facts = facts(recording);
    if recording.rig.pixel_format.first_red().is_some() {
        facts.push(("colours", "interpolated from the camera's Bayer mosaic".into()));
    }
    let mut facts: Vec<(String, String)> = facts.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    facts.extend(views::measured_facts(reader)?);
    facts.extend(views::plate_map_facts(&recording.specimen, plan)?);
    Ok(facts)
}
