//! Results of a specimen that were computed again from its frames: by another method in `WELL/replays/NAME/`, or in a folder outside the
//! run. The stored result is not changed.

use super::{MEASUREMENT, RECORDING, Software, StoreError, durable, schema, sums};
use carved_records::{Method, sha256_hex};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const SCHEMA: &str = "carved.replay/1";
const FILE: &str = "replay.json";
/// Folder in a recording.
const FOLDER: &str = "replays";

/// Content of `replay.json`.
#[derive(Serialize, Deserialize)]
struct Replay {
    schema: String,
    software: Software,
    /// RFC 3339, UTC. `None` outside the run, where the results of two jobs must be equal byte by byte.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    replayed: Option<String>,
    /// `None`: the recording's own method.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    method_name: Option<String>,
    method: Method,
    /// SHA-256 of `recording.json`, in a folder outside the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    recording_sha256: Option<String>,
}

/// What was computed again.
#[derive(Debug, Clone, PartialEq)]
pub struct Replayed {
    pub software: Software,
    /// RFC 3339, UTC. `None` of results outside the run.
    pub replayed: Option<String>,
    /// `None`: the recording's own method.
    pub method_name: Option<String>,
    pub method: Method,
    /// Bytes of `measurement.json`.
    pub measurement: Vec<u8>,
}

impl Replayed {
    /// The results in a folder outside the run. `None` where there are none, or an interrupted computation left them.
    ///
    /// # Errors
    /// Files that cannot be read, were altered, or were written by a newer carved.
    pub fn read(folder: &Path) -> Result<Option<Self>, StoreError> {
        if !folder.join(sums::FILE).is_file() {
            return Ok(None);
        }
        for name in [FILE, MEASUREMENT] {
            sums::check_one(folder, name)?;
        }
        let Replay { software, replayed, method_name, method, .. } = schema::read(&folder.join(FILE), SCHEMA)?;
        let path = folder.join(MEASUREMENT);
        let measurement = carved_files::read(&path).map_err(StoreError::io("read", &path))?;
        Ok(Some(Self { software, replayed, method_name, method, measurement }))
    }
}

/// The results of other methods beside those of a recording, by name. Results that cannot be read are logged and left out.
pub(super) fn beside(recording: &Path) -> Vec<Replayed> {
    let entries = std::fs::read_dir(recording.join(FOLDER)).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    folders.sort();
    let read = |folder: &PathBuf| {
        let unread = |error: &StoreError| tracing::warn!(%error, "results of another method are not read");
        Replayed::read(folder).inspect_err(unread).ok().flatten()
    };
    folders.iter().filter_map(read).collect()
}

pub struct ReplayWriter {
    folder: PathBuf,
    method_name: Option<String>,
}

impl ReplayWriter {
    /// A writer for results by the method of this (plain) name. `recording`: the recording's folder.
    pub fn new(recording: &Path, name: &str) -> Self {
        Self { folder: recording.join(FOLDER).join(name), method_name: Some(name.to_owned()) }
    }

    /// A writer for results in a folder outside the run, by a method of this name or by the recording's own.
    pub fn outside(folder: PathBuf, method_name: Option<&str>) -> Self {
        Self { folder, method_name: method_name.map(str::to_owned) }
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

    /// Whether this build has computed the numbers of this recording by this method already, and they are intact.
    pub fn is_done(&self, method: &Method, recording_sha256: &str) -> bool {
        let stored: Option<Replay> = schema::read(&self.folder.join(FILE), SCHEMA).ok();
        stored.is_some_and(|stored| {
            stored.software == Software::this()
                && stored.method == *method
                && stored.recording_sha256.as_deref() == Some(recording_sha256)
                && matches!(Replayed::read(&self.folder), Ok(Some(_)))
        })
    }

    /// Removes the checksums of earlier results, so that nobody takes these for results of today.
    ///
    /// # Errors
    /// They cannot be removed, or they are those of a recording.
    pub fn forget(&self) -> Result<(), StoreError> {
        self.refuse_recording()?;
        let sums = self.folder.join(sums::FILE);
        match std::fs::remove_file(&sums) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => Err(StoreError::Io { what: "remove", path: sums, source }),
            _ => Ok(()),
        }
    }

    /// Writes the results, and the checksums last. `recording_sha256`: of `recording.json`, for results outside the run. Several processes,
    /// also of several machines, may write the same results outside the run at the same time.
    ///
    /// # Errors
    /// A file cannot be written, or the folder is that of a recording.
    pub fn write(&self, method: &Method, recording_sha256: Option<String>, files: &[(&str, Vec<u8>)]) -> Result<(), StoreError> {
        self.refuse_recording()?;
        durable::create_folder(&self.folder)?;
        let replay = Replay {
            schema: SCHEMA.into(),
            software: Software::this(),
            replayed: recording_sha256.is_none().then(|| jiff::Timestamp::now().to_string()),
            method_name: self.method_name.clone(),
            method: method.clone(),
            recording_sha256,
        };
        let replay = durable::json_text(Path::new(FILE), &replay)?;
        let files: Vec<(&str, &[u8])> =
            std::iter::once((FILE, &*replay)).chain(files.iter().map(|(name, bytes)| (*name, &**bytes))).collect();
        for (name, bytes) in &files {
            durable::write_beside_others(&self.folder.join(name), bytes)?;
        }
        let sums = files.iter().map(|(name, bytes)| (PathBuf::from(name), sha256_hex(bytes))).collect();
        durable::write_beside_others(&self.folder.join(sums::FILE), sums::text(&sums).as_bytes())
    }

    /// A recording has files of the same names, which the results would replace.
    fn refuse_recording(&self) -> Result<(), StoreError> {
        let is_recording = self.folder.join(RECORDING).symlink_metadata().is_ok();
        if is_recording { Err(StoreError::IsRecording { path: self.folder.clone() }) } else { Ok(()) }
    }
}
