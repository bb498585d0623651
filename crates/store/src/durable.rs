//! Durable writes: write a temporary file, sync it, rename it, sync the folder.

use super::{StoreError, disk};
use std::fs;
use std::path::{Path, PathBuf};

/// Replaces `path` by `bytes`. A reader, or a start after a crash, sees the old or the new file, never a mixture.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let at = |what| StoreError::io(what, path);
    let folder = folder_of(path);
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = folder.join(name);
    let written = disk::create(&part, bytes)
        .map_err(at("write"))
        .and_then(|file| disk::sync(&file, &part).map_err(at("sync")))
        .and_then(|()| disk::rename(&part, path).map_err(at("rename")));
    if written.is_err() {
        // The partial file is useless. The error of the write is the one to report.
        let _ = disk::remove(&part);
    }
    written?;
    sync_folder(folder)
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
