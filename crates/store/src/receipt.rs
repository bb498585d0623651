//! The receipts of the copies of a run: which files a copy has, and where it is.

use super::objects::is_address;
use super::pack::{self, Pack};
use super::{Software, StoreError, schema};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub(super) const SCHEMA: &str = "carved.archive/1";

/// Folder of the receipts in the run's folder. The copy contains one receipt, [`RECEIPT`].
pub(super) const RECEIPTS: &str = "archives";
pub(super) const RECEIPT: &str = "archive.json";

/// The record of a copy: its files and its place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Receipt {
    pub schema: String,
    pub software: Software,
    pub run: String,
    /// RFC 3339, UTC.
    pub archived: String,
    /// The copy's folder, or its address in an object store.
    pub destination: PathBuf,
    pub bytes: u64,
    /// SHA-256 of each file, by its name in the run's folder.
    pub files: BTreeMap<PathBuf, String>,
    /// The recordings of which the copy has one file, `A01.tar` for the folder `A01`.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub packed: BTreeSet<String>,
}

impl Receipt {
    /// The address of a copy in an object store.
    pub(super) fn address(&self) -> Option<&str> {
        self.destination.to_str().filter(|destination| is_address(destination))
    }

    /// Whether the copy of this file is in a pack.
    pub(super) fn is_packed(&self, name: &Path) -> bool {
        pack::recording_of(name).is_some_and(|recording| self.packed.contains(recording))
    }
}

/// The receipts of a run, newest first.
pub(super) fn receipts(folder: &Path) -> Result<Vec<Receipt>, StoreError> {
    let of = folder.join(RECEIPTS);
    let Ok(entries) = std::fs::read_dir(&of) else { return Ok(Vec::new()) };
    // Other names, such as folders, are ignored.
    let files = entries.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "json"));
    let mut found = Vec::new();
    for path in files {
        let receipt: Receipt = schema::read(&path, SCHEMA)?;
        if let Some(name) = receipt.files.keys().find(|name| !pack::is_below(name)) {
            let found = name.display().to_string();
            return Err(StoreError::Format { path, expected: "names of files in the run's folder", found });
        }
        found.push(receipt);
    }
    found.sort_by(|a, b| b.archived.cmp(&a.archived));
    Ok(found)
}

/// The error for a missing raw frame. `name` is its name in the recording's folder. Says where the copy is, if a receipt of the run lists
/// the frame.
pub(super) fn gone(recording: &Path, name: &str) -> StoreError {
    let path = recording.join(name);
    let copied = || {
        let whole = recording.canonicalize().ok()?;
        let well = Path::new(whole.file_name()?);
        // Unreadable receipts count as none.
        let receipt = receipts(whole.parent()?).ok()?.into_iter().find(|receipt| receipt.files.contains_key(&well.join(name)))?;
        let folder = receipt.destination.join(well);
        if receipt.address().is_some() {
            return Some(StoreError::ArchivedFrame { path: path.clone(), is_there: None, copy: folder, archived: receipt.archived });
        }
        let (copy, is_there) = if receipt.is_packed(&well.join(name)) {
            let copy = pack::pack_of(&folder);
            let is_there = Pack::open(&copy).is_ok_and(|pack| pack.names().any(|found| found == Path::new(name)));
            (copy, is_there)
        } else {
            let is_there = folder.join(name).is_file();
            (folder, is_there)
        };
        Some(StoreError::ArchivedFrame { path: path.clone(), is_there: Some(is_there), copy, archived: receipt.archived })
    };
    copied().unwrap_or(StoreError::MissingFrame { path })
}
