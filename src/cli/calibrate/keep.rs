//! Where calibrations of a rig are kept: `KIND-DAY-ID.json`, never overwritten.

use anyhow::Context;
use carved_store::{StoreError, durable};
use serde::Serialize;
use std::path::Path;

/// Writes the file of what was measured on that day, and says where it is.
pub fn keep<T: Serialize>(folder: &Path, kind: &str, measured: jiff::Timestamp, id: &str, file: &T) -> anyhow::Result<()> {
    let path = folder.join(format!("{kind}-{}-{id}.json", measured.strftime("%Y-%m-%d")));
    if path.exists() {
        return Err(StoreError::Exists { path }).context("these measurements are calibrated with already");
    }
    durable::create_folder(folder)?;
    durable::write_json(&path, file)?;
    note!("carved: {}", path.display());
    Ok(())
}
