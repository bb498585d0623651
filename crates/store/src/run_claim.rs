//! Who may change a run that has ended.
//!
//! ```text
//!  replay, archive ── share it: they add files
//!  prune ──────────── has it alone, from the first look at the files until they are removed
//! ```
//! The lock is on the run's folder itself, so it needs no file, and stays with the folder when that is renamed.

use super::StoreError;
use std::fs::{File, TryLockError};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// A claim of a run. It ends when it is dropped.
#[derive(Debug)]
pub struct RunClaim {
    folder: File,
}

impl RunClaim {
    /// Keeps the run of this folder from being pruned.
    ///
    /// # Errors
    /// It is being pruned, or is not there any more.
    pub fn shared(folder: &Path) -> Result<Self, StoreError> {
        let claim = Self { folder: File::open(folder).map_err(StoreError::io("open", folder))? };
        match claim.folder.try_lock_shared() {
            Ok(()) => claim.still(folder),
            Err(TryLockError::WouldBlock) => Err(StoreError::InUse { path: folder.to_owned(), by: "carved prune" }),
            // A copy may be on a disk that has no locks. Nobody prunes a copy.
            Err(TryLockError::Error(error)) => {
                tracing::debug!(%error, folder = %folder.display(), "the folder cannot be locked");
                Ok(claim)
            }
        }
    }

    /// Keeps others from adding files to the run of this folder.
    pub(super) fn alone(folder: &Path) -> Result<Self, StoreError> {
        let claim = Self { folder: File::open(folder).map_err(StoreError::io("open", folder))? };
        match claim.folder.try_lock() {
            Ok(()) => claim.still(folder),
            Err(TryLockError::WouldBlock) => {
                Err(StoreError::InUse { path: folder.to_owned(), by: "a replay, an archive or another prune" })
            }
            Err(TryLockError::Error(error)) => Err(StoreError::io("lock", folder)(error)),
        }
    }

    /// The folder may have been renamed before it was locked.
    fn still(self, folder: &Path) -> Result<Self, StoreError> {
        let at = StoreError::io("look at", folder);
        let (locked, there) = (self.folder.metadata().map_err(&at)?, folder.metadata().map_err(&at)?);
        let same = (locked.dev(), locked.ino()) == (there.dev(), there.ino());
        if same { Ok(self) } else { Err(StoreError::Vanished { path: folder.to_owned() }) }
    }
}

/// As for the data folder: closing the file is not enough while a child process has it open.
impl Drop for RunClaim {
    fn drop(&mut self) {
        if let Err(error) = self.folder.unlock() {
            tracing::debug!(%error, "the run's lock ends with its file");
        }
    }
}
