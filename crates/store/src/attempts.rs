//! Folders of repeated attempts at a specimen. The newest attempt has the well's plain name, and earlier attempts are kept beside it.
//!
//! ```text
//! runs/RUN/A01              the newest attempt
//! runs/RUN/A01.attempt-1    the first attempt, if there was a second one
//! runs/RUN/A01.attempt-2    the second attempt, if there was a third one
//! ```

use super::{StoreError, durable, sums};
use carved_records::is_well;
use std::path::Path;

const MARK: &str = ".attempt-";

/// Name of the folder of an attempt. Attempt 0 is the newest one.
pub(super) fn folder_name(well: &str, attempt: u32) -> String {
    if attempt == 0 { well.to_owned() } else { format!("{well}{MARK}{attempt}") }
}

/// The well whose folder has this name, if it is one.
pub(super) fn well_of(folder: &str) -> &str {
    folder.split_once(MARK).map_or(folder, |(well, _)| well)
}

/// Numbers of the earlier attempts at a well, in ascending order.
pub(super) fn earlier(run: &Path, well: &str) -> Vec<u32> {
    let entries = std::fs::read_dir(run).into_iter().flatten().flatten();
    let number = |name: String| {
        let attempt = name.strip_prefix(well)?.strip_prefix(MARK)?;
        attempt.strip_suffix(".tar").unwrap_or(attempt).parse().ok().filter(|n| *n > 0)
    };
    let mut found: Vec<u32> = entries.filter_map(|e| number(e.file_name().into_string().ok()?)).collect();
    found.sort_unstable();
    // Results of a replay may lie in a folder beside a packed attempt.
    found.dedup();
    found
}

/// Renames the folder of a well to that of an earlier attempt, durably and with its checksums. Returns the number of this attempt. `None`
/// if the well has no folder.
///
/// # Errors
/// The folder cannot be renamed. Then nothing has changed.
pub fn set_aside(run: &Path, well: &str) -> Result<Option<u32>, StoreError> {
    let newest = run.join(well);
    if !newest.is_dir() {
        return Ok(None);
    }
    // After a crash the folder has no checksums yet. If they cannot be computed, the attempt is kept without them.
    if let Err(error) = sums::seal(&newest) {
        tracing::warn!(%error, well, "an attempt is kept without its SHA256SUMS");
    }
    let number = earlier(run, well).last().map_or(1, |n| n + 1);
    durable::rename(&newest, &run.join(folder_name(well, number)))?;
    Ok(Some(number))
}

/// Seals the folder of every well of a run, including earlier attempts.
///
/// # Errors
/// The last folder that could not be sealed. The others are sealed.
pub fn seal_run(run: &Path) -> Result<(), StoreError> {
    let mut sealed = Ok(());
    for entry in std::fs::read_dir(run).map_err(StoreError::io("list", run))?.flatten() {
        let name = entry.file_name().into_string().unwrap_or_default();
        if is_well(well_of(&name))
            && let Err(error) = sums::seal(&entry.path())
        {
            sealed = Err(error);
        }
    }
    sealed
}
