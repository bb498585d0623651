//! Writes a recording beside its destination and then renames it, so that it is complete or absent.

use super::Imported;
use anyhow::{Context, bail, ensure};
use carved_records::{LedgerEntry, sha256_hex};
use carved_store::{Recording, RecordingWriter, StoreError, durable};
use std::path::{Path, PathBuf};

/// The destination of the recording. An existing one is never changed.
pub(super) fn choose(out: Option<&Path>, named: &[PathBuf]) -> anyhow::Result<PathBuf> {
    let Some(out) = out else {
        let folder = named.first().map(|p| if p.is_dir() { p.clone() } else { durable::folder_of(p).to_owned() });
        let name = folder.and_then(|f| f.canonicalize().ok()).and_then(|f| f.file_name().map(|n| n.to_string_lossy().into_owned()));
        let name = name.unwrap_or_else(|| "frames".into());
        let free = (1..10_000)
            .map(|n| PathBuf::from(if n == 1 { format!("{name}-recording") } else { format!("{name}-recording-{n}") }))
            .find(|p| p.symlink_metadata().is_err());
        return free.with_context(|| format!("{name}-recording: 10 000 names are taken; give --out"));
    };
    ensure!(out.symlink_metadata().is_err(), "--out {}: is there already; nothing is overwritten", out.display());
    if out.file_name().is_none() {
        bail!("--out {}: expected the name of a folder to be made", out.display());
    }
    let folder = durable::folder_of(out);
    ensure!(folder.is_dir(), "--out {}: found no folder {}, expected one to write into", out.display(), folder.display());
    Ok(out.to_owned())
}

/// A temporary folder that is removed unless it was put in its place.
pub(super) struct Part(PathBuf);

impl Part {
    /// A folder beside `out`, whose name begins with a dot.
    pub fn beside(out: &Path) -> anyhow::Result<Self> {
        let name = out.file_name().unwrap_or_default().to_string_lossy();
        let path = durable::folder_of(out).join(format!(".{name}.{}.part", std::process::id()));
        std::fs::create_dir(&path).with_context(|| format!("{}: cannot be made", path.display()))?;
        Ok(Self(path))
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Renames the folder to `out`.
    pub fn put(&self, out: &Path) -> anyhow::Result<()> {
        ensure!(out.symlink_metadata().is_err(), "{}: was made by somebody else meanwhile; nothing is overwritten", out.display());
        std::fs::rename(&self.0, out).with_context(|| format!("{}: cannot be put in place", out.display()))?;
        durable::sync_folder(durable::folder_of(out))?;
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // The folder is gone if it was renamed. Otherwise the error that led here is the one to report.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Why a recording was not written.
pub(super) enum Failure {
    /// Its pictures cannot be used.
    Pictures(anyhow::Error),
    /// The disk does not take it.
    Disk(anyhow::Error),
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        Self::Disk(error.into())
    }
}

/// Writes the recording completely or not at all.
pub(super) fn write(out: &Path, recording: Recording, imported: &Imported) -> anyhow::Result<()> {
    let part = Part::beside(out)?;
    let close = |writer: RecordingWriter| writer.close().map_err(Failure::from);
    fill(part.path(), recording, imported).and_then(close).map_err(|failure| match failure {
        Failure::Pictures(error) | Failure::Disk(error) => error,
    })?;
    part.put(out)
}

/// Writes frames and ledger into a folder. The recording is not closed yet.
pub(super) fn fill(folder: &Path, recording: Recording, imported: &Imported) -> Result<RecordingWriter, Failure> {
    let (steps_per_revolution, sense) = (recording.rig.steps_per_revolution, recording.rig.sense);
    let mut writer = RecordingWriter::create(folder, recording, imported.empty.as_deref())?;
    writer.add_references(&imported.references)?;
    for ((looked, stop), number) in imported.looks.iter().zip(&imported.turn.stops).zip(1..) {
        let frame = looked.frame().map_err(Failure::Pictures)?;
        let entry = LedgerEntry {
            view: stop.view,
            retake: 0,
            commanded_steps: stop.steps,
            achieved_steps: stop.steps,
            epoch: 1,
            omega: sense.omega(stop.steps, steps_per_revolution),
            swept: None,
            moved_ms: 0.0,
            settle_ms: 0.0,
            grab_ms: 0.0,
            trigger_ms: 0.0,
            light: None,
            second: None,
            frame_id: number,
            attempts: 0,
            sha256: sha256_hex(frame.bytes()),
            closure: stop.closure,
        };
        writer.add_view(entry, &frame)?;
    }
    writer.add_json("import.json", &imported.origin())?;
    Ok(writer)
}
