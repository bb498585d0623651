//! `carved export ome-tiff`: the views of a specimen as one file.

use super::model::{ends_in, facts};
use super::{views, write};
use crate::cli::folders::open_recording;
use crate::export::{Stack, Subject, ome_tiff};
use anyhow::ensure;
use carved_core::frame::PixelFormat;
use carved_core::geometry::Camera;
use carved_records::{LedgerEntry, RunPlan};
use carved_store::{RecordingReader, StoreError, StoredRun};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording (`DATA/runs/RUN/WELL`, or its pack `WELL.tar`).
    recording: PathBuf,
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
    let reader = open_recording(&args.recording)?;
    let recording = reader.recording();
    let entries = views::by_number(&reader);
    ensure!(!entries.is_empty(), "{}: 0 views are recorded; a file needs at least 1", args.recording.display());
    let mut stacks = vec![stack("bright field", &recording.rig.camera, recording.rig.pixel_format, &entries)];
    let of_second: Vec<&LedgerEntry> = entries.iter().copied().filter(|entry| entry.second.is_some()).collect();
    if let Some(second) = recording.rig.second.as_ref().filter(|_| !of_second.is_empty()) {
        stacks.push(stack("second camera", &second.optics.camera, PixelFormat::Mono8, &of_second));
    }
    let of_cameras = stacks.len();
    if args.outlines {
        let mut found = views::outlines(&reader)?;
        stacks[0].outlines = entries.iter().map(|entry| found.remove(&entry.view).unwrap_or_default()).collect();
    }
    let mut labels = Vec::new();
    if args.labels {
        let mut of_views = Vec::new();
        for entry in &entries {
            if let Some(profile) = views::profile(&reader, entry.view as usize)? {
                labels.push(profile);
                of_views.push(*entry);
            }
        }
        ensure!(!labels.is_empty(), "{}: no profile is stored", args.recording.display());
        stacks.push(stack("profile", &recording.rig.camera, PixelFormat::Mono8, &of_views));
    }
    let picture = |stack: usize, view: usize| -> Result<Vec<u8>, StoreError> {
        if stack >= of_cameras {
            return Ok(labels[view].clone());
        }
        let frame = if stack == 0 { reader.frame(entries[view]) } else { views::second(&reader, of_second[view]) };
        frame.map(|frame| views::interleaved(&frame))
    };
    // A recording that was copied out of its run has no lab's columns.
    let run = args.recording.parent().filter(|folder| folder.join("run.json").is_file()).map(StoredRun::read).transpose()?;
    let plan = run.as_ref().map(|run| &run.record().plan);
    let bytes = ome_tiff(&subject(&reader, plan)?, &stacks, picture)?;
    write(&args.out, &bytes)?;
    note!("carved: {}: {} view(s), {:.1} MB", args.out.display(), entries.len(), bytes.len() as f64 / 1e6);
    Ok(())
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

fn subject(reader: &RecordingReader, plan: Option<&RunPlan>) -> anyhow::Result<Subject> {
    let recording = reader.recording();
    let specimen = &recording.specimen;
    let place = views::place(&specimen.well)?;
    // A recording does not know the plate of its run.
    let plate = views::size(None, &std::iter::once(specimen.well.as_str()));
    let mut facts = facts(recording);
    if recording.rig.pixel_format == PixelFormat::BayerRG8 {
        facts.push(("colours", "interpolated from the camera's Bayer mosaic".into()));
    }
    let mut facts: Vec<(String, String)> = facts.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    facts.extend(views::measured_facts(reader)?);
    facts.extend(views::plate_map_facts(specimen, plan)?);
    Ok(Subject { run: recording.run.clone(), well: specimen.well.clone(), place, plate, started: seconds(&recording.started), facts })
}

/// A time to whole seconds: readers differ in how many decimals they take.
fn seconds(time: &str) -> String {
    time.parse::<jiff::Timestamp>().map_or_else(|_| time.to_owned(), |t| t.strftime("%Y-%m-%dT%H:%M:%SZ").to_string())
}
