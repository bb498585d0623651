//! Acknowledged means durable: write beside, sync, rename over, sync the folder.

use super::StoreError;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

/// Replaces `path` by `bytes`, so that a reader and a crash see the old file or the new one, never a mixture.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let at = |what| move |source| StoreError::Io { what, path: path.to_owned(), source };
    let folder = folder_of(path);
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = folder.join(name);
    let mut file = File::create(&part).map_err(at("create"))?;
    let written = file
        .write_all(bytes)
        .map_err(at("write"))
        .and_then(|()| file.sync_data().map_err(at("sync")))
        .and_then(|()| fs::rename(&part, path).map_err(at("rename")));
    if written.is_err() {
        // What is left of it is of no use; that the write failed is the error to tell.
        let _ = fs::remove_file(&part);
    }
    written?;
    sync_folder(folder)
}

/// The folder that a file lies in; of a bare name, the one that is worked in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes names in a folder durable.
pub fn sync_folder(folder: &Path) -> Result<(), StoreError> {
    File::open(folder).and_then(|f| f.sync_all()).map_err(|source| StoreError::Io {
        what: "sync the folder",
        path: folder.to_owned(),
        source,
    })
}

/// Creates a folder and those above it, each made durable in its parent.
pub fn create_folder(folder: &Path) -> Result<(), StoreError> {
    if folder.is_dir() {
        return Ok(());
    }
    if let Some(parent) = folder.parent().filter(|p| !p.as_os_str().is_empty()) {
        create_folder(parent)?;
        match fs::create_dir(folder) {
            Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => {
                return Err(StoreError::Io { what: "create the folder", path: folder.to_owned(), source: e });
            }
            _ => return sync_folder(parent),
        }
    }
    fs::create_dir_all(folder).map_err(|source| StoreError::Io { what: "create the folder", path: folder.to_owned(), source })
}

/// A value as indented JSON; `path` names it in errors only.
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

/// Reads a value from JSON; the error names the file and the line.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path, expected: &'static str) -> Result<T, StoreError> {
    let text = fs::read(path).map_err(|source| StoreError::Io { what: "read", path: path.to_owned(), source })?;
    serde_json::from_slice(&text).map_err(|e| StoreError::Format { path: path.to_owned(), expected, found: e.to_string() })
}
