//! What can go wrong with files: which file, what was found, what was expected.

use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("{}: cannot {what}: {source}", path.display())]
    Io { what: &'static str, path: PathBuf, source: std::io::Error },
    #[error("{}: expected {expected}, found: {found}", path.display())]
    Format { path: PathBuf, expected: &'static str, found: String },
    #[error("{}: its SHA-256 is {found}, the recording says {expected}: the file was altered after it was recorded", path.display())]
    Altered { path: PathBuf, expected: String, found: String },
    #[error("{}: the frame of view {view} is missing; the recording lists it", path.display())]
    MissingFrame { path: PathBuf, view: u32 },
    #[error("{}: {found} views are recorded, {expected} were planned: the revolution was not finished, so it cannot be measured", path.display())]
    Unfinished { path: PathBuf, expected: u32, found: usize },
    #[error("{}: another carved uses this folder; stop it or give another --data", path.display())]
    Locked { path: PathBuf },
    #[error("{}: exists already; nothing is overwritten", path.display())]
    Exists { path: PathBuf },
}

impl StoreError {
    /// For `map_err`: names what was tried on which file.
    pub(crate) fn io(what: &'static str, path: &std::path::Path) -> impl Fn(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { what, path: path.clone(), source }
    }
}
