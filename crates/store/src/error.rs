//! Errors of the store. Each names the file, the finding and the expectation.

use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("{}: cannot {what}: {source}", path.display())]
    Io { what: &'static str, path: PathBuf, source: std::io::Error },
    #[error("{}: expected {expected}, found: {found}", path.display())]
    Format { path: PathBuf, expected: &'static str, found: String },
    #[error("{}: its SHA-256 is {found}, the recording says {expected}: the file was altered after it was recorded", path.display())]
    Altered { path: PathBuf, expected: String, found: String },
    #[error("{}: the frame is missing; the recording lists it", path.display())]
    MissingFrame { path: PathBuf },
    #[error(
        "{}: the frame is not here any more; it was archived to {} on {archived}{}",
        path.display(), copy.display(),
        match is_there {
            Some(true) => format!(" and is there: carved measure {}", copy.display()),
            Some(false) => ", and is not there now: mount that disk or bring the copy back, and measure that".into(),
            None => ": fetch that copy, and measure it".into(),
        }
    )]
    ArchivedFrame {
        path: PathBuf,
        /// The recording's folder in the archive.
        copy: PathBuf,
        /// RFC 3339, UTC.
        archived: String,
        /// `None`: the copy is in an object store, where nobody looks now.
        is_there: Option<bool>,
    },
    #[error(
        "{}: {found} views are recorded, {expected} were planned: {}, so it cannot be measured",
        path.display(),
        if *found == 0 { "no revolution was made (an empty well, or cut short before it)" } else { "the revolution was not finished" }
    )]
    Unfinished { path: PathBuf, expected: u32, found: usize },
    #[error("{}: it was written and is gone: somebody took it out of the record while the run was going", path.display())]
    Vanished { path: PathBuf },
    #[error("{}: it was not closed within {waited_s:.0} s: the disk hangs. Check the disk. Files already written are kept", path.display())]
    Unclosed { path: PathBuf, waited_s: f64 },
    #[error(
        "{}: the uuid of the instrument cannot be read: {why}. Nothing was changed. Restore the file from a backup, or write \
         {{\"schema\": \"carved.instrument/1\", \"uuid\": \"UUID\"}} into it, with the instrument.uuid of an earlier run.json of this \
         instrument. If there is no earlier run, remove the file: the next start makes a new uuid",
        path.display()
    )]
    Identity { path: PathBuf, why: String },
    #[error("{}: another carved uses this folder; stop that one first, or name another folder (--data, or data_dir of [store])", path.display())]
    Locked { path: PathBuf },
    #[error(
        "{}: it is of format {found}, this carved ({}) reads up to {known}: a newer carved{} wrote it. Use that one; nothing was changed",
        path.display(), env!("CARGO_PKG_VERSION"), writer.as_ref().map(|v| format!(" ({v})")).unwrap_or_default()
    )]
    Newer { path: PathBuf, found: String, known: String, writer: Option<String> },
    #[error("{}: the index could not {what}: {source}", path.display())]
    Index { what: &'static str, path: PathBuf, source: rusqlite::Error },
    #[error("{}: the run has no outcome yet; wait for its end, or let the daemon end what a crash left open", path.display())]
    Unended { path: PathBuf },
    #[error("{}: nothing is removed: it was never archived (carved archive RUN --to DIR)", path.display())]
    NeverArchived { path: PathBuf },
    #[error("{}: nothing is removed: {why}", path.display())]
    NoGoodCopy { path: PathBuf, why: String },
    #[error(
        "{}: this is no copy: it leads into the run's own folder {}. Copy the run to a folder apart from the run's own (carved archive RUN --to DIR)",
        path.display(), run.display()
    )]
    NoCopy { path: PathBuf, run: PathBuf },
    #[error("{}: {by} works on this run now; nothing was changed. Wait until that has ended, and repeat the command", path.display())]
    InUse { path: PathBuf, by: &'static str },
    #[error("{}: exists already; nothing is overwritten", path.display())]
    Exists { path: PathBuf },
    #[error(
        "{}: this is the folder of a recording (it has a recording.json), so no results are written into it. Choose a folder outside the \
         data folder",
        path.display()
    )]
    IsRecording { path: PathBuf },
    /// An object store.
    #[error("{address}: {why}")]
    Remote { address: String, why: String },
}

impl StoreError {
    /// Whether the disk is full. The request itself was correct.
    pub fn is_full(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == std::io::ErrorKind::StorageFull)
    }

    /// For `map_err`: adds the failed operation and the file to an I/O error.
    pub fn io(what: &'static str, path: &std::path::Path) -> impl Fn(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { what, path: path.clone(), source }
    }
}
