//! Folders on a command line that hold recordings where a recording is expected.
//!
//! ```text
//!  DATA/runs/RUN/WELL     a data folder, a folder of runs, a run and a recording
//! ```

use anyhow::bail;
use carved_store::RecordingReader;
use std::path::{Path, PathBuf};

/// A folder of runs, or the data folder above it, where a run or a recording is expected.
#[derive(Debug, thiserror::Error)]
#[error("{} holds runs: name {}/*", folder.display(), runs.display())]
pub struct HoldsRuns {
    folder: PathBuf,
    runs: PathBuf,
}

/// Checks that this is no folder of runs and no data folder.
///
/// # Errors
/// It is one of them.
pub fn refuse_folder_of_runs(folder: &Path) -> Result<(), HoldsRuns> {
    if has(folder, "recording.json") || is_run(folder) {
        return Ok(());
    }
    for runs in [folder.to_owned(), folder.join("runs")] {
        if first(&runs, is_run).is_some() {
            return Err(HoldsRuns { folder: folder.to_owned(), runs });
        }
    }
    Ok(())
}

/// Opens a recording.
///
/// # Errors
/// One that cannot be read. The message for a run, a folder of runs or a data folder names a recording in it.
pub fn open_recording(path: &Path) -> anyhow::Result<RecordingReader> {
    let (what, run) = match refuse_folder_of_runs(path) {
        Ok(()) if is_run(path) => ("is a run", Some(path.to_owned())),
        Ok(()) => return Ok(RecordingReader::open(path)?),
        Err(HoldsRuns { runs, .. }) => ("holds runs", first(&runs, is_run)),
    };
    let example = run.and_then(|run| first(&run, is_recording)).map(|well| format!(", such as {}", well.display()));
    bail!("{} {what}. This command takes one recording, the folder of a well{}", path.display(), example.unwrap_or_default())
}

/// Whether a folder has an entry of this name, also a link that leads nowhere.
pub fn has(folder: &Path, name: &str) -> bool {
    folder.join(name).symlink_metadata().is_ok()
}

fn is_run(folder: &Path) -> bool {
    has(folder, "run.json")
}

fn is_recording(path: &Path) -> bool {
    has(path, "recording.json") || path.extension().is_some_and(|e| e == "tar")
}

/// The first entry of a folder, by name, that is of a kind.
fn first(folder: &Path, is_of_kind: fn(&Path) -> bool) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.filter(|path| is_of_kind(path)).min()
}
