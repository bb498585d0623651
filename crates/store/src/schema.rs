//! Reads files that name their format, such as `carved.run/1`. A file of a newer carved is refused.

use super::StoreError;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::path::Path;

/// The common part of all versions of these files.
#[derive(Deserialize)]
struct Stamp {
    schema: String,
    #[serde(default)]
    software: Option<Writer>,
}

#[derive(Deserialize)]
struct Writer {
    version: String,
}

/// Reads a file of the format `known`, the newest known version of its kind.
pub(super) fn read<T: DeserializeOwned>(path: &Path, known: &'static str) -> Result<T, StoreError> {
    parse(path, &carved_files::read(path).map_err(StoreError::io("read", path))?, known)
}

/// The same of the bytes of the file `path`.
pub(super) fn parse<T: DeserializeOwned>(path: &Path, text: &[u8], known: &'static str) -> Result<T, StoreError> {
    let format = |found: String| StoreError::Format { path: path.to_owned(), expected: known, found };
    let stamp: Stamp = serde_json::from_slice(text).map_err(|e| format(e.to_string()))?;
    if stamp.schema != known {
        let newer = split(&stamp.schema).zip(split(known)).is_some_and(|((kind, found), (of, known))| kind == of && found > known);
        let writer = stamp.software.map(|w| w.version);
        return Err(if newer {
            StoreError::Newer { path: path.to_owned(), found: stamp.schema, known: known.to_owned(), writer }
        } else {
            format(stamp.schema)
        });
    }
    serde_json::from_slice(text).map_err(|e| format(e.to_string()))
}

/// Kind and version.
fn split(schema: &str) -> Option<(&str, u32)> {
    let (kind, version) = schema.split_once('/')?;
    Some((kind, version.parse().ok()?))
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_newer_format_is_reported_with_both_versions_and_another_kind_is_no_version() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.json");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            super::read::<serde_json::Value>(&path, "carved.run/2").map_err(|e| e.to_string())
        };
        assert!(read(r#"{"schema": "carved.run/2"}"#).is_ok());
        let newer = read(r#"{"schema": "carved.run/11", "software": {"name": "carved", "version": "9.1.0"}}"#).unwrap_err();
        for part in ["run.json", "carved.run/11", "carved.run/2", "9.1.0", env!("CARGO_PKG_VERSION"), "Use that one"] {
            assert!(newer.contains(part), "{newer}");
        }
        for other in [r#"{"schema": "carved.recording/3"}"#, r#"{"schema": "carved.run/1"}"#, r#"{"schema": "x"}"#, "{}", "nonsense"] {
            assert!(read(other).unwrap_err().contains("expected carved.run/2"), "{other}");
        }
    }
}
