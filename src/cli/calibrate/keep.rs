//! The dated files of a rig's calibrations: `KIND-DAY-ID.json`, never overwritten.

use anyhow::Context;
use carved_store::{StoreError, durable};
use serde::Serialize;
use std::path::Path;

/// Writes the file of a measurement made on that day, and prints its path.
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
