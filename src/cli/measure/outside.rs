//! Keeps the results of `carved measure --out` out of the stored recordings.
//!
//! A result has the file names of a recording (`measurement.json`, `SHA256SUMS`): in the folder of a recording it would replace them.

use crate::cli::folders::has;
use anyhow::{Context, bail};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Checks that the results of these recordings, by their names `RUN/WELL`, can be written to `out`.
///
/// # Errors
/// `out`, or a folder `out/RUN` that is there, is, holds or lies inside a recording, a run or a data folder; or it cannot be examined.
pub fn check(out: &Path, named: &BTreeMap<String, PathBuf>) -> anyhow::Result<()> {
    let runs: BTreeSet<&str> = named.keys().filter_map(|name| Some(name.split_once('/')?.0)).collect();
    // Below `out` a symbolic link may lead into a run.
    for folder in std::iter::once(out.to_owned()).chain(runs.into_iter().map(|run| out.join(run))) {
        let whole = resolve(&folder).with_context(|| format!("{}: cannot be examined", folder.display()))?;
        if let Some((relation, stored)) = conflict(&whole, named) {
            bail!(
                "{} {relation} {}, which belongs to stored runs: the results could replace their files. Nothing was written. \
                 Choose a folder outside the data folder",
                folder.display(),
                stored.display()
            );
        }
    }
    Ok(())
}

/// How a folder stands to what is stored, and where that is.
fn conflict(folder: &Path, named: &BTreeMap<String, PathBuf>) -> Option<(&'static str, PathBuf)> {
    // A data folder that no daemon has used has no mark: its `runs` is known by the named recordings.
    let is_of_named =
        |at: &Path| named.values().any(|recording| recording == at || (at.ends_with("runs") && recording.ancestors().nth(2) == Some(at)));
    if let Some(stored) = folder.ancestors().find(|at| is_stored(at) || is_of_named(at)) {
        return Some((if stored == folder { "is" } else { "lies inside" }, stored.to_owned()));
    }
    named.values().find(|recording| recording.starts_with(folder)).map(|recording| ("holds", recording.clone()))
}

/// Whether a folder is a recording, a run or a data folder.
fn is_stored(folder: &Path) -> bool {
    let has = |name| has(folder, name);
    has("recording.json") || has("run.json") || (has("runs") && (has("index.sqlite") || has("instrument.json")))
}

/// The path without symbolic links and `..`, whose last parts need not be there.
fn resolve(path: &Path) -> std::io::Result<PathBuf> {
    let mut whole = PathBuf::new();
    for part in std::path::absolute(path)?.components() {
        if part == Component::ParentDir {
            whole.pop();
            continue;
        }
        whole.push(part);
        match whole.canonicalize() {
            Ok(there) => whole = there,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    Ok(whole)
}
