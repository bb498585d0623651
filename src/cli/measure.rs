//! `carved measure`: computes the numbers of recordings again from their frames.
//!
//! ```text
//!  RECORDING ── ledger ── all views, or an even subset (--asd) ── the live run's pipeline ── one JSON line
//! ```
//! A recording that fails does not stop the others; its line gives the reason. With `--out` the numbers go into a folder instead, by
//! several jobs and perhaps on several machines: see [`bulk`].

mod bulk;

use super::stored::{self, Stored};
use super::told;
use crate::session::numbers::{self, Computed, NumbersError};
use anyhow::{Context, bail, ensure};
use carved_core::surface::Mesh;
use carved_devices::acquisition::RevolutionPlan;
use carved_records::LedgerEntry;
use carved_records::Method;
use carved_store::{MEASUREMENT, MeasurementFile, RecordingFiles, RecordingReader, RunRecord, StoreError};
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`, packed `A01.tar`) or whole runs (`runs/RUN`), of which every finished recording is measured.
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
/// At the end, every recording that could not be measured or whose numbers differ from the stored ones.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.out {
        Some(out) => bulk::run(&args.recordings, out, &args.bulk),
        None => lines(args).map(|()| ExitCode::SUCCESS),
    }
}

fn lines(args: &Args) -> anyhow::Result<()> {
    let (mut failures, mut differ) = (Vec::new(), Vec::new());
    for (path, found) in each(&args.recordings) {
        let line = match found.and_then(|()| line(&path, args.asd)) {
            Ok((line, differs)) => {
                differ.extend(differs.map(|at| format!("{} (at {at})", path.display())));
                line
            }
            Err(e) => {
                let error = told(&e);
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
    ensure!(wrong.is_empty(), "{}", wrong.join("\n"));
    Ok(())
}

/// The line of a recording, and a message if the stored numbers differ.
fn line(path: &Path, asd: Option<u32>) -> anyhow::Result<(String, Option<String>)> {
    let reader = RecordingReader::open(path)?;
    let recording = reader.recording();
    let captured = recording.method.asd;
    let asd = asd.unwrap_or(captured);
    // The same as if this number of views had been planned.
    let (_, file) = compute(&reader, &Method { asd, ..recording.method.clone() })?;
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
    let line = Measured { recording: path, well, stored, new_fields, asd, captured, truth: recording.truth.as_ref(), file };
    Ok((serde_json::to_string(&line)?, differs))
}

/// The recordings of each name. A name without a recording has an error.
fn each(names: &[PathBuf]) -> Vec<(PathBuf, anyhow::Result<()>)> {
    let of = |name: &PathBuf| match expand(std::slice::from_ref(name)) {
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

/// As [`compute`], with the voxels and the cameras that the numbers come from.
pub(super) fn compute_with_hull(reader: &RecordingReader, method: &Method) -> anyhow::Result<Computed> {
    let bar = ProgressBar::no_length()
        .with_style(ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} views")?)
        .with_message(reader.folder().display().to_string());
    compute_with(reader, method, &bar)
}

/// As [`compute_with_hull`], with a bar that counts the views.
fn compute_with(reader: &RecordingReader, method: &Method, bar: &ProgressBar) -> anyhow::Result<Computed> {
    reader.require_finished()?;
    let recording = reader.recording();
    let captured = recording.method.asd;
    let counted: Vec<&LedgerEntry> = recording.ledger.counted().collect();
    let entries = if method.asd == captured {
        counted
    } else {
        subset(&counted, captured, method.asd).with_context(|| format!("{} views (asd)", method.asd))?
    };
    bar.set_length(entries.len() as u64);
    let found = numbers::with_hull(reader, method, &entries, |_, _| bar.inc(1));
    bar.finish_and_clear();
    found.map_err(|error| match error {
        NumbersError::Store(error) => error.into(),
        NumbersError::Pipeline(error) => anyhow::Error::new(error).context(reader.folder().display().to_string()),
    })
}

/// Every (captured / asd)-th view, starting at view 0, and the closure view.
fn subset<'a>(entries: &[&'a LedgerEntry], captured: u32, asd: u32) -> anyhow::Result<Vec<&'a LedgerEntry>> {
    let possible: Vec<u32> = (RevolutionPlan::LEAST_ASD..=captured).filter(|n| captured.is_multiple_of(*n)).collect();
    if !possible.contains(&asd) {
        let possible = possible.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
        bail!("{captured} views were captured, of which {asd} do not stand evenly around the turn; possible are {possible}");
    }
    let stride = captured / asd;
    let chosen: Vec<&LedgerEntry> = entries.iter().copied().filter(|e| e.closure || e.view.is_multiple_of(stride)).collect();
    let omega = |view: u32| chosen.iter().find(|e| e.view == view && !e.closure).map(|e| e.omega.to_degrees());
    let first = omega(0).context("the ledger has no view 0")?;
    let spacing = 360.0 / f64::from(captured);
    for at in 1..asd {
        let view = at * stride;
        let found = omega(view).with_context(|| format!("the ledger has no view {view}"))? - first;
        let even = 360.0 * f64::from(at) / f64::from(asd);
        // The turn may go in either direction.
        let off = [found - even, found + even].map(|x| (x - 360.0 * (x / 360.0).round()).abs()).into_iter().fold(f64::INFINITY, f64::min);
        ensure!(
            off <= spacing,
            "view {view} stands {off:.2} deg from its even place around the turn, more than the {spacing:.2} deg between captured views: this \
             turn has no even subset; measure it whole"
        );
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::units::Steps;

    fn turn(angles_deg: impl Iterator<Item = f64>, closure: bool) -> Vec<LedgerEntry> {
        let mut entries: Vec<LedgerEntry> = (0..)
            .zip(angles_deg)
            .map(|(view, deg)| LedgerEntry {
                view,
                retake: 0,
                commanded_steps: Steps(0),
                achieved_steps: Steps(0),
                epoch: 1,
                omega: deg.to_radians(),
                moved_ms: 0.0,
                settle_ms: 0.0,
                grab_ms: 0.0,
                trigger_ms: 0.0,
                light: None,
                second: None,
                frame_id: 0,
                attempts: 1,
                sha256: String::new(),
                closure: false,
            })
            .collect();
        entries.last_mut().unwrap().closure = closure;
        entries
    }

    fn views(entries: &[LedgerEntry], captured: u32, asd: u32) -> Result<Vec<u32>, String> {
        subset(&entries.iter().collect::<Vec<_>>(), captured, asd).map(|s| s.iter().map(|e| e.view).collect()).map_err(|e| format!("{e:#}"))
    }

    #[test]
    fn every_divisor_is_an_even_subset_either_way_around() {
        for sense in [1.0, -1.0] {
            // Steps of 0.72 deg, as on VAST.
            let entries = turn((0..=84).map(|i| sense * 0.72 * (f64::from(i) * 500.0 / 84.0).round()), true);
            for asd in [4, 7, 12, 14, 21, 28, 42] {
                let expected: Vec<u32> = (0..=84).step_by(84 / asd as usize).collect();
                assert_eq!(views(&entries, 84, asd).unwrap(), expected);
            }
        }
        assert_eq!(views(&turn((0..84).map(|i| f64::from(i) * 4.32), false), 84, 4).unwrap(), [0, 21, 42, 63]);
    }

    #[test]
    fn what_is_no_even_subset_is_refused_with_the_ways_out() {
        let entries = turn((0..12).map(|i| f64::from(i) * 30.0), false);
        for asd in [0, 1, 2, 5, 24] {
            assert!(views(&entries, 12, asd).unwrap_err().contains("possible are 3, 4, 6, 12"));
        }
        let half = turn((0..12).map(|i| f64::from(i) * 15.0), false);
        assert!(views(&half, 12, 4).unwrap_err().contains("no even subset"));
    }
}
