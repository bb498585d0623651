//! Durable writes: write a temporary file, sync it, rename it, sync the folder.

use super::{StoreError, disk};
use std::fs::{self, File};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::path::{Path, PathBuf};

/// Replaces `path` by `bytes`. A reader, or a start after a crash, sees the old or the new file, never a mixture.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    write_by_way_of(".part", path, |part| disk::create(part, bytes).map_err(StoreError::io("write", path)))
}

/// As [`write`], for a file that may be too large for the memory: `fill` writes it into the new, empty file.
///
/// # Errors
/// Whatever `fill` returns, and what the disk refuses. The old file is then untouched.
pub fn write_by<E: From<StoreError>>(path: &Path, fill: impl FnOnce(&mut File) -> Result<(), E>) -> Result<(), E> {
    write_by_way_of(".part", path, |part| {
        let mut file = disk::create(part, &[]).map_err(StoreError::io("write", path))?;
        fill(&mut file)?;
        Ok(file)
    })
}

/// As [`write`], where other processes and machines may write the same file at the same time: each has a temporary file of its own, and the
/// last one wins.
pub fn write_beside_others(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    // The standard library seeds each of these hashers at random.
    let own = RandomState::new().build_hasher().finish();
    write_by_way_of(&format!(".{own:016x}.part"), path, |part| disk::create(part, bytes).map_err(StoreError::io("write", path)))
}

fn write_by_way_of<E: From<StoreError>>(suffix: &str, path: &Path, written: impl FnOnce(&Path) -> Result<File, E>) -> Result<(), E> {
    let at = |what| StoreError::io(what, path);
    let folder = folder_of(path);
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(suffix);
    let part = folder.join(name);
    let written = written(&part).and_then(|file| {
        disk::sync(&file, &part).map_err(at("sync"))?;
        Ok(disk::rename(&part, path).map_err(at("rename"))?)
    });
    if written.is_err() {
        // The partial file is useless. The error of the write is the one to report.
        let _ = disk::remove(&part);
    }
    written?;
    Ok(sync_folder(folder)?)
}

/// The folder of a file. For a bare name it is the working directory.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes the names in a folder durable.
pub fn sync_folder(folder: &Path) -> Result<(), StoreError> {
    disk::sync_folder(folder).map_err(StoreError::io("sync the folder", folder))
}

/// Renames a file or folder durably. The new name must be free.
pub fn rename(from: &Path, to: &Path) -> Result<(), StoreError> {
    if to.exists() {
        return Err(StoreError::Exists { path: to.to_owned() });
    }
    disk::rename(from, to).map_err(StoreError::io("rename", from))?;
    sync_folder(folder_of(to))
}

/// Creates a folder and its parents. Each one is made durable in its parent.
pub fn create_folder(folder: &Path) -> Result<(), StoreError> {
    if folder.is_dir() {
        return Ok(());
    }
    let parent = folder_of(folder);
    create_folder(parent)?;
    match disk::create_folder(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => Err(StoreError::io("create the folder", folder)(e)),
        _ => sync_folder(parent),
    }
}

/// The JSON files of a folder. Empty if the folder does not exist.
pub fn json_files(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let entries = match fs::read_dir(folder) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(StoreError::io("list", folder))?,
    };
    let paths: Vec<PathBuf> = entries.map(|entry| Ok(entry.map_err(StoreError::io("list", folder))?.path())).collect::<Result<_, _>>()?;
    Ok(paths.into_iter().filter(|path| path.extension().is_some_and(|e| e == "json")).collect())
}

/// A value as indented JSON. `path` is used only in errors.
pub fn json_text<T: serde::Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, StoreError> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|e| StoreError::Format {
        path: path.to_owned(),
        expected: "a value JSON can hold",
        found: e.to_string(),
    })?;
    text.push(b'\n');
    Ok(text)
}

/// Writes a value as indented JSON, durably.
pub fn write_json<T: serde::Serialize>(path: &Path, value: &T) -> Result<(), StoreError> {
    write(path, &json_text(path, value)?)
}

/// Reads a value from JSON. The error names the file and the line.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path, expected: &'static str) -> Result<T, StoreError> {
    parse_json(path, &carved_files::read(path).map_err(StoreError::io("read", path))?, expected)
}

/// The same of the bytes of the file `path`.
pub fn parse_json<T: serde::de::DeserializeOwned>(path: &Path, text: &[u8], expected: &'static str) -> Result<T, StoreError> {
    serde_json::from_slice(text).map_err(|e| StoreError::Format { path: path.to_owned(), expected, found: e.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_write_the_same_file_at_the_same_time_do_not_disturb_each_other() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("result");
        std::thread::scope(|scope| {
            for byte in [1u8, 2] {
                let path = &path;
                scope.spawn(move || {
                    for _ in 0..40 {
                        write_beside_others(path, &vec![byte; 1 << 16]).unwrap();
                        let found = fs::read(path).unwrap();
                        assert!(found == vec![1; 1 << 16] || found == vec![2; 1 << 16], "a mixture");
                    }
                });
            }
        });
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file is left");
    }
}
