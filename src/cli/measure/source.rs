//! Where recordings are read from: a folder or a pack on a disk, or a copy in an object store, of which one recording at a time is fetched.

use crate::cli::archive::reach;
use anyhow::Context;
use carved_store::{RecordingReader, is_address};
use std::path::{Path, PathBuf};

/// The address that a name on the command line is, if it is one of an object store.
pub(super) fn address(name: &Path) -> Option<&str> {
    name.to_str().filter(|name| is_address(name))
}

/// The recordings that the address of a copy stands for.
pub(super) fn expand(address: &str) -> anyhow::Result<Vec<PathBuf>> {
    let found = carved_store::recordings_at(reach(address)?.as_ref(), address)?;
    Ok(found.into_iter().map(PathBuf::from).collect())
}

/// An open recording.
pub(super) struct Source {
    pub reader: RecordingReader,
    /// The fetched files. They are removed with this value.
    _fetched: Option<tempfile::TempDir>,
}

impl Source {
    /// Opens a recording, which is fetched to a temporary folder (`TMPDIR`) if it is in an object store.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        let Some(address) = address(path) else {
            return Ok(Self { reader: RecordingReader::open(path)?, _fetched: None });
        };
        let folder = tempfile::Builder::new().prefix("carved-").tempdir().context("a fetched recording needs a temporary folder")?;
        let fetched = carved_store::fetch(reach(address)?.as_ref(), address, folder.path())?;
        Ok(Self { reader: RecordingReader::open(&fetched)?, _fetched: Some(folder) })
    }
}
