//! Files with secrets, which only the daemon's user may read.

use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// Why a file with a secret cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PrivateFileError {
    #[error("cannot read {}: {why}", path.display())]
    Read { path: PathBuf, why: io::Error },
    #[error("{} has mode {mode:04o}, so others on this machine can read it. Run `chmod 600 {}`", path.display(), path.display())]
    Exposed { path: PathBuf, mode: u32 },
}

/// The text of a file that no other user can read, without white space at its ends.
pub(super) fn read(path: &Path) -> Result<String, PrivateFileError> {
    let read = || -> io::Result<(u32, String)> {
        let mode = std::fs::metadata(path)?.permissions().mode() & 0o7777;
        Ok((mode, carved_files::read_to_string(path)?))
    };
    match read() {
        Ok((mode, _)) if mode & 0o077 != 0 => Err(PrivateFileError::Exposed { path: path.to_owned(), mode }),
        Ok((_, text)) => Ok(text.trim().to_owned()),
        Err(why) => Err(PrivateFileError::Read { path: path.to_owned(), why }),
    }
}
