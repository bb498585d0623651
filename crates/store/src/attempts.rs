//! A specimen that is done again: the earlier attempt's folder is kept beside, the newest has the well's plain name.
//!
//! ```text
//! runs/RUN/A01              the newest
//! runs/RUN/A01.attempt-1    the first, when it was done again
//! runs/RUN/A01.attempt-2    the second, when that was too
//! ```

use super::{StoreError, durable, sums};
use std::path::Path;

const MARK: &str = ".attempt-";

/// Name of a well's folder; 0 is the newest attempt.
pub(super) fn folder_name(well: &str, attempt: u32) -> String {
    if attempt == 0 { well.to_owned() } else { format!("{well}{MARK}{attempt}") }
}

/// Numbers of the earlier attempts at a well, the first first.
pub(super) fn earlier(run: &Path, well: &str) -> Vec<u32> {
    let entries = std::fs::read_dir(run).into_iter().flatten().flatten();
    let number = |name: String| name.strip_prefix(well)?.strip_prefix(MARK)?.parse().ok().filter(|n| *n > 0);
    let mut found: Vec<u32> = entries.filter_map(|e| number(e.file_name().into_string().ok()?)).collect();
    found.sort_unstable();
    found
}

/// Moves what is there of a well of this run aside, durably and with its sums; gives the number of the attempt that was kept. Nothing where the well
/// has no folder.
///
/// # Errors
/// A folder that cannot be moved; then nothing was.
pub fn set_aside(run: &Path, well: &str) -> Result<Option<u32>, StoreError> {
    let newest = run.join(well);
    if !newest.is_dir() {
        return Ok(None);
    }
    // A writer that a crash ended has left none; what cannot be hashed is kept all the same.
    if let Err(error) = sums::seal(&newest) {
        tracing::warn!(%error, well, "an attempt is kept without its SHA256SUMS");
    }
    let number = earlier(run, well).last().map_or(1, |n| n + 1);
    durable::rename(&newest, &run.join(folder_name(well, number)))?;
    Ok(Some(number))
}
