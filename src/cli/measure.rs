//! `carved measure`: computes the numbers of recordings again from their frames.
//!
//! ```text
//!  RECORDING ── ledger ── all views, or an even subset (--asd) ── the live run's pipeline ── one JSON line
//! ```
//! A recording that fails does not stop the others; its line gives the reason. With `--out` the numbers go into a folder instead, by
//! several jobs and perhaps on several machines: see [`bulk`].

mod bulk;
mod outside;
mod source;

use super::folders;
use super::stored::{self, Stored};
use super::with_causes;
use anyhow::{Context, ensure};
use carved_core::pipeline::SegmentedFrame;
use carved_core::surface::Mesh;
use carved_offline::recording::{self, Computed, NumbersError};
use carved_records::LedgerEntry;
use carved_records::Method;
use carved_store::{MEASUREMENT, MeasurementFile, RecordingFiles, RecordingReader, RunRecord, StoreError};
use indicatif::{ProgressBar, ProgressStyle};
use source::Source;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`, packed `A01.tar`) or whole runs (`runs/RUN`), of which every finished recording is measured. Copies
    /// in an object store (`s3://BUCKET/PREFIX/RUN`) where carved was built with the feature s3; one recording at a time is fetched.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Measure with this number of the captured views, evenly spread: of 84 with 4, 7, 12, 14, 21, 28, 42 or any other divisor. The
    /// tolerance is that for this number of views. The result is not compared with the stored one.
    #[arg(long, value_name = "VIEWS", conflicts_with = "method")]
    asd: Option<u32>,
    /// Write the numbers of each recording to DIR/RUN/WELL/measurement.json, and leave out what is there and intact. A second call with the
    /// same options goes on where the first was interrupted. `carved export table --measurements DIR` makes one table of all.
    #[arg(long, value_name = "DIR", conflicts_with = "asd")]
    out: Option<PathBuf>,
    #[command(flatten)]
    bulk: bulk::Options,
}

/// One line of output.
#[derive(serde::Serialize)]
struct Measured<'a> {
    recording: &'a Path,
    well: &'a str,
    /// `identical`; `same` if all stored values are equal and there are new fields, as beside the numbers of an earlier build; `differs`;
    /// `none` if the recording has no stored measurement; or `not_compared` if fewer views were measured than it has.
    stored: &'static str,
    /// For `same`: the fields that are not stored, as JSON pointers in which `-` is any element of a list.
    #[serde(skip_serializing_if = "Option::is_none")]
    new_fields: Option<&'a BTreeSet<String>>,
    /// Number of views that were measured, and number of views that were captured.
    asd: u32,
    captured: u32,
    truth: Option<&'a serde_json::Value>,
    #[serde(flatten)]
    file: MeasurementFile,
}

/// The line of a recording that could not be measured.
#[derive(serde::Serialize)]
struct Failed<'a> {
    recording: &'a Path,
    error: String,
}

/// Measures every recording that can be measured.
///
/// # Errors
/// At the end, every recording that could not be measured, whose numbers differ from the stored ones, or that is no turn of one specimen.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.out {
        Some(out) => bulk::run(&args.recordings, out, &args.bulk),
        None => lines(args).map(|()| ExitCode::SUCCESS),
    }
}

fn lines(args: &Args) -> anyhow::Result<()> {
    let (mut failures, mut differ, mut no_turns) = (Vec::new(), Vec::new(), Vec::new());
    for (path, found) in each(&args.recordings) {
        let line = match found.and_then(|()| line(&path, args.asd)) {
            Ok(Line { json, differs, finding }) => {
                differ.extend(differs.map(|at| format!("{} (at {at})", path.display())));
                no_turns.extend(finding.map(|finding| format!("{}: {finding}", path.display())));
                json
            }
            Err(e) => {
                let error = with_causes(&e);
                // Many errors name their file already.
                let name = path.display().to_string();
                failures.push(if error.contains(&name) { error.clone() } else { format!("{name}: {error}") });
                serde_json::to_string(&Failed { recording: &path, error })?
            }
        };
        say!("{line}");
    }
    let mut wrong = Vec::new();
    if !failures.is_empty() {
        wrong.push(format!("{} recording(s) could not be measured:\n{}", failures.len(), failures.join("\n")));
    }
    if !differ.is_empty() {
        wrong.push(format!("{} recording(s) gave other numbers than are stored beside their frames: {}", differ.len(), differ.join(", ")));
    }
    if !no_turns.is_empty() {
        wrong.push(format!(
            "{} recording(s) are no turn of one specimen, so their volumes do not count:\n{}",
            no_turns.len(),
            no_turns.join("\n")
        ));
    }
    ensure!(wrong.is_empty(), "{}", wrong.join("\n"));
    Ok(())
}

/// What is said of a recording that could be measured.
struct Line {
    json: String,
    /// Where the stored numbers differ.
    differs: Option<String>,
    /// Why the views do not show one specimen that turns.
    finding: Option<String>,
}

/// Measures a recording.
fn line(path: &Path, asd: Option<u32>) -> anyhow::Result<Line> {
    let source = Source::open(path)?;
    let reader = &source.reader;
    let recording = reader.recording();
    let captured = recording.method.asd;
    let asd = asd.unwrap_or(captured);
    // The same as if this number of views had been planned.
    let (_, file) = compute(reader, &Method { asd, ..recording.method.clone() })?;
    let compared = (asd == captured).then(|| stored::compare(reader.files(), &file)).transpose()?;
    let stored = compared.as_ref().map_or("not_compared", Stored::word);
    let (new_fields, differs) = match &compared {
        Some(same @ Stored::Same { new }) => {
            note!("carved: {}: {same}", path.display());
            (Some(new), None)
        }
        Some(Stored::Differs { at }) => (None, Some(at.clone())),
        _ => (None, None),
    };
    let well = &recording.specimen.well;
    let finding = file.record.turn_findings.first().map(ToString::to_string);
    let line = Measured { recording: path, well, stored, new_fields, asd, captured, truth: recording.truth.as_ref(), file };
    Ok(Line { json: serde_json::to_string(&line)?, differs, finding })
}

/// The recordings of each name. A name without a recording has an error.
fn each(names: &[PathBuf]) -> Vec<(PathBuf, anyhow::Result<()>)> {
    let found = |name: &PathBuf| match source::address(name) {
        Some(address) => source::expand(address),
        None => expand(std::slice::from_ref(name)),
    };
    let of = |name: &PathBuf| match found(name) {
        Ok(paths) => paths.into_iter().map(|path| (path, Ok(()))).collect(),
        Err(e) => vec![(name.clone(), Err(e))],
    };
    names.iter().flat_map(of).collect()
}

/// A run stands for its finished recordings. A named recording is measured or refused.
pub(super) fn expand(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if path.join("run.json").symlink_metadata().is_ok() {
            // The run's record is only checked for its version: a newer carved may give its recordings another meaning.
            if let Err(error @ (StoreError::Newer { .. } | StoreError::Io { .. })) = RunRecord::of_folder(path) {
                return Err(error.into());
            }
            let mut wells: Vec<_> = std::fs::read_dir(path)
                .with_context(|| format!("{}: cannot list the run", path.display()))?
                .filter_map(|e| e.ok().map(|e| e.path()))
                .filter(|p| if p.extension().is_some_and(|e| e == "tar") { was_measured(p) } else { p.join(MEASUREMENT).is_file() })
                .collect();
            wells.sort();
            ensure!(!wells.is_empty(), "{}: no recording of this run was measured", path.display());
            found.extend(wells);
        } else {
            folders::refuse_folder_of_runs(path)?;
            found.push(path.clone());
        }
    }
    Ok(found)
}

/// Whether a pack has numbers. One that cannot be read counts, so that it is not left out in silence.
fn was_measured(pack: &Path) -> bool {
    RecordingFiles::of(pack).map_or(true, |files| files.has(MEASUREMENT))
}

/// Surface and numbers by a method, with the code of a live run: from all captured views, or from an even subset if the method asks for
/// fewer.
pub(super) fn compute(reader: &RecordingReader, method: &Method) -> anyhow::Result<(Mesh, MeasurementFile)> {
    compute_with_hull(reader, method).map(|found| (found.mesh, found.file))
}

/// As [`compute`], with the voxels that were counted.
pub(super) fn compute_with_hull(reader: &RecordingReader, method: &Method) -> anyhow::Result<Computed> {
    let bar = ProgressBar::no_length()
        .with_style(ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} views")?)
        .with_message(reader.folder().display().to_string());
    compute_with(reader, method, &bar)
}

/// As [`compute_with_hull`]; `seen` is called with each view and its segmented frame, from several threads.
pub(super) fn compute_and_see(
    reader: &RecordingReader,
    method: &Method,
    seen: impl Fn(&LedgerEntry, &SegmentedFrame) + Sync,
) -> anyhow::Result<Computed> {
    let entries = recording::views(reader, method).map_err(|error| of_recording(reader, error))?;
    let all_seen = |entry: &LedgerEntry, frame: &SegmentedFrame| {
        seen(entry, frame);
        Ok(())
    };
    recording::compute(reader, method, &entries, all_seen).map_err(|error| of_recording(reader, error))
}

/// As [`compute_with_hull`], with a bar that counts the views.
fn compute_with(reader: &RecordingReader, method: &Method, bar: &ProgressBar) -> anyhow::Result<Computed> {
    let entries = recording::views(reader, method).map_err(|error| of_recording(reader, error))?;
    bar.set_length(entries.len() as u64);
    let seen = |_: &LedgerEntry, _: &SegmentedFrame| {
        bar.inc(1);
        Ok(())
    };
    let found = recording::compute(reader, method, &entries, seen);
    bar.finish_and_clear();
    found.map_err(|error| of_recording(reader, error))
}

/// The error with what it is about, if it does not say so itself.
fn of_recording(reader: &RecordingReader, error: NumbersError) -> anyhow::Error {
    match error {
        NumbersError::Pipeline(_) => anyhow::Error::new(error).context(reader.folder().display().to_string()),
        error => error.into(),
    }
}
