//! `carved measure`: the numbers of recordings, computed again from their frames.

use crate::pipeline::{Pipeline, SpecimenRecord};
use crate::session::SpecimenKind;
use crate::store::{MEASUREMENT, MeasurementFile, RecordingReader, StoreError, durable};
use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`) or whole runs (`runs/RUN`), of which every finished recording is measured.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
}

/// One line of output.
#[derive(serde::Serialize)]
struct Measured<'a> {
    recording: &'a Path,
    well: &'a str,
    /// `identical`, `differs`, or `none` where the recording holds no measurement.
    stored: &'static str,
    truth: Option<&'a serde_json::Value>,
    #[serde(flatten)]
    file: MeasurementFile,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut differs = 0;
    for path in expand(&args.recordings)? {
        let reader = RecordingReader::open(&path)?;
        let record = measure(&reader)?;
        let recording = reader.recording();
        let file = MeasurementFile::new(recording, &reader.references()?, record);
        let stored = compare(&path, &file)?;
        differs += usize::from(stored == "differs");
        let line = Measured { recording: &path, well: &recording.specimen.well, stored, truth: recording.truth.as_ref(), file };
        println!("{}", serde_json::to_string(&line)?);
    }
    anyhow::ensure!(differs == 0, "{differs} recording(s) gave other numbers than are stored beside their frames");
    Ok(())
}

/// Runs stand for the finished recordings in them; a recording that was named is measured or refused.
pub(super) fn expand(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if path.join("run.json").is_file() {
            let mut wells: Vec<_> = std::fs::read_dir(path)
                .with_context(|| format!("{}: cannot list the run", path.display()))?
                .filter_map(|e| e.ok().map(|e| e.path()))
                .filter(|p| p.join(MEASUREMENT).is_file())
                .collect();
            wells.sort();
            anyhow::ensure!(!wells.is_empty(), "{}: no recording of this run was measured", path.display());
            found.extend(wells);
        } else {
            found.push(path.clone());
        }
    }
    Ok(found)
}

/// The same path as a live run: frames and angles in, numbers out.
pub fn measure(reader: &RecordingReader) -> anyhow::Result<SpecimenRecord> {
    reader.require_finished()?;
    let recording = reader.recording();
    let sphere = recording.specimen.specimen == SpecimenKind::Bead;
    let settings = recording.method.pipeline(&recording.rig.camera, sphere)?;
    let mut pipeline = Pipeline::new(settings.compared_with(reader.empty_capillary()?.as_ref())?)?;
    let entries: Vec<_> = recording.ledger.entries().iter().collect();
    let bar = ProgressBar::new(entries.len() as u64)
        .with_style(ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} views")?)
        .with_message(reader.folder().display().to_string());
    let seen: Vec<_> = entries
        .par_iter()
        .map(|entry| {
            let seen = pipeline.look(&reader.frame(entry)?)?;
            bar.inc(1);
            anyhow::Ok((*entry, seen))
        })
        .collect::<Result<_, _>>()?;
    for (entry, seen) in &seen {
        if entry.closure {
            pipeline.observe_closure(seen);
        } else {
            pipeline.observe(entry.view, entry.omega, seen)?;
        }
    }
    let (_, record) = pipeline.finish().with_context(|| reader.folder().display().to_string())?;
    bar.finish_and_clear();
    Ok(record)
}

fn compare(folder: &Path, file: &MeasurementFile) -> anyhow::Result<&'static str> {
    let path = folder.join(MEASUREMENT);
    let stored = match std::fs::read(&path) {
        Ok(stored) => stored,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok("none"),
        Err(source) => return Err(StoreError::Io { what: "read", path, source }.into()),
    };
    let ours = durable::json_text(&path, file)?;
    Ok(if ours == stored { "identical" } else { "differs" })
}
