//! Recordings of one rig with their numbers, and the id of a result.

use crate::cli::measure::expand;
use anyhow::{Context, bail, ensure};
use carved_core::geometry::Camera;
use carved_records::{Mode, SpecimenKind, sha256_hex};
use carved_store::{MeasurementFile, RecordingReader};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The numbers of a recording and the time at which it began.
pub struct Measured {
    pub path: PathBuf,
    pub started: jiff::Timestamp,
    pub file: MeasurementFile,
}

/// Recordings made by one rig with one camera.
pub struct Set {
    pub rig: String,
    pub mode: Mode,
    pub camera: Camera,
    pub recordings: Vec<Measured>,
}

impl Set {
    /// Start time of the newest recording. Fails for an empty set.
    pub fn measured(&self) -> anyhow::Result<jiff::Timestamp> {
        self.recordings.iter().map(|r| r.started).max().context("0 recordings; 1 or more is expected")
    }
}

/// Reads recordings and whole runs. With `beads_only` other specimens are skipped.
pub fn read(names: &[PathBuf], beads_only: bool) -> anyhow::Result<Set> {
    let mut set: Option<Set> = None;
    for path in expand(names)? {
        let reader = RecordingReader::open(&path)?;
        let recording = reader.recording();
        if beads_only && recording.specimen.specimen != SpecimenKind::Bead {
            continue;
        }
        let (rig, mode, camera) = (&recording.rig.name, recording.mode, &recording.rig.camera);
        let set = set.get_or_insert_with(|| Set { rig: rig.clone(), mode, camera: camera.clone(), recordings: Vec::new() });
        let started = recording.started.parse().with_context(|| format!("{}: started = {:?}", path.display(), recording.started))?;
        if let Some(first) = set.recordings.first() {
            same(&first.path, &path, "rig", &set.rig, rig)?;
            same(&first.path, &path, "mode", &set.mode, &mode)?;
            same(&first.path, &path, "kx", &set.camera.kx, &camera.kx)?;
            same(&first.path, &path, "ky", &set.camera.ky, &camera.ky)?;
            ensure!(set.recordings.iter().all(|r| r.path != path), "{}: named twice; a recording counts once", path.display());
        }
        let file = reader.measurement()?;
        set.recordings.push(Measured { path, started, file });
    }
    let kind = if beads_only { "beads" } else { "recordings" };
    let set = set.with_context(|| format!("0 {kind} among what was named; 1 or more is expected"))?;
    set.camera.check()?;
    Ok(set)
}

fn same<T: PartialEq + std::fmt::Debug>(first: &Path, other: &Path, what: &str, a: &T, b: &T) -> anyhow::Result<()> {
    if a != b {
        bail!(
            "{}: {what} is {b:?}, but that of {} is {a:?}; calibrate one rig with one camera at a time",
            other.display(),
            first.display()
        );
    }
    Ok(())
}

/// The first 12 digits of the SHA-256 of the content, so that the same content has the same id.
pub fn id<T: Serialize>(content: &T) -> anyhow::Result<String> {
    Ok(sha256_hex(&serde_json::to_vec(content)?)[..12].to_owned())
}
