//! Results of a specimen by another method, in `WELL/replays/NAME/`. The stored result is not changed.

use super::{MEASUREMENT, Software, StoreError, durable, schema, sums};
use carved_records::Method;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const SCHEMA: &str = "carved.replay/1";
const FILE: &str = "replay.json";

/// Content of `replay.json`.
#[derive(Serialize, Deserialize)]
struct Replay {
    schema: String,
    software: Software,
    /// RFC 3339, UTC.
    replayed: String,
    method_name: String,
    method: Method,
}

pub struct ReplayWriter {
    folder: PathBuf,
    name: String,
}

impl ReplayWriter {
    /// A writer for results by the method of this (plain) name. `recording`: the recording's folder.
    pub fn new(recording: &Path, name: &str) -> Self {
        Self { folder: recording.join("replays").join(name), name: name.to_owned() }
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Whether the same numbers by the same method are stored already and complete.
    ///
    /// # Errors
    /// The folder of this name has results of another method, or other numbers. Nothing is overwritten.
    pub fn is_there(&self, method: &Method, numbers: &[u8]) -> Result<bool, StoreError> {
        // The checksums are written last. Without them an earlier replay was interrupted.
        if !self.folder.join(sums::FILE).is_file() {
            return Ok(false);
        }
        let stored: Replay = schema::read(&self.folder.join(FILE), SCHEMA)?;
        sums::check_one(&self.folder, MEASUREMENT)?;
        let path = self.folder.join(MEASUREMENT);
        let same = stored.method == *method && carved_files::read(&path).map_err(StoreError::io("read", &path))? == numbers;
        if same { Ok(true) } else { Err(StoreError::Exists { path: self.folder.clone() }) }
    }

    /// Writes the results.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, method: &Method, files: &[(&str, Vec<u8>)]) -> Result<(), StoreError> {
        durable::create_folder(&self.folder)?;
        let replay = Replay {
            schema: SCHEMA.into(),
            software: Software::this(),
            replayed: jiff::Timestamp::now().to_string(),
            method_name: self.name.clone(),
            method: method.clone(),
        };
        durable::write_json(&self.folder.join(FILE), &replay)?;
        for (name, bytes) in files {
            durable::write(&self.folder.join(name), bytes)?;
        }
        let sums = sums::of_folder(&self.folder)?;
        durable::write(&self.folder.join(sums::FILE), sums::text(&sums).as_bytes())
    }
}
