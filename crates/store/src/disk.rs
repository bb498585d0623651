//! The file operations behind durable writes. The tests hook in here: they simulate a power loss after each operation, and a failure of
//! each operation (`power_loss`).

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

#[cfg(any(test, feature = "testing"))]
use crate::testing::trace;

/// Reports an operation to the tests before it is done. Returns the error that a test injects.
macro_rules! step {
    ($op:ident, $path:expr $(, $what:expr)*) => {
        let _: &Path = $path;
        #[cfg(any(test, feature = "testing"))]
        trace::step(trace::Op::$op($path.into() $(, $what.into())*))?;
    };
}

#[cfg(any(test, feature = "testing"))]
use trace::is_traced;

#[cfg(not(any(test, feature = "testing")))]
fn is_traced() -> bool {
    false
}

/// Creates a file with these bytes. It is not synced yet.
pub(super) fn create(path: &Path, bytes: &[u8]) -> io::Result<File> {
    step!(Create, path, bytes);
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    Ok(file)
}

pub(super) fn append(file: &mut File, path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A full disk may accept a part of a line. In tests the first half is a separate operation.
    let (front, back) = bytes.split_at(if is_traced() { bytes.len() / 2 } else { 0 });
    for part in [front, back].into_iter().filter(|part| !part.is_empty()) {
        step!(Append, path, part);
        file.write_all(part)?;
    }
    Ok(())
}

/// Truncates a file to its first `bytes`.
pub(super) fn cut(file: &File, path: &Path, bytes: u64) -> io::Result<()> {
    step!(Cut, path, bytes);
    file.set_len(bytes)
}

pub(super) fn sync(file: &File, path: &Path) -> io::Result<()> {
    step!(Sync, path);
    file.sync_data()
}

pub(super) fn rename(from: &Path, to: &Path) -> io::Result<()> {
    step!(Rename, from, to);
    fs::rename(from, to)
}

pub(super) fn remove(path: &Path) -> io::Result<()> {
    step!(Remove, path);
    fs::remove_file(path)
}

pub(super) fn create_folder(folder: &Path) -> io::Result<()> {
    step!(CreateFolder, folder);
    fs::create_dir(folder)
}

/// Makes the names in a folder durable.
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    step!(SyncFolder, folder);
    File::open(folder)?.sync_all()
}
