//! Reads the store beside the daemon that writes it. Lists come from the index, everything else from the run folders.
//!
//! ```text
//! runs(query) ─────────────── index.sqlite, read-only, a connection per query
//! run, specimen, file ─────── runs/RUN/..., names are checked before they become a path, bytes against SHA256SUMS
//! ```

use super::disk;
use super::gates::{self, GateFile};
use super::index::{self, EventsAfter, RunRow, RunsQuery};
use super::recording::{DETECTION, MEASUREMENT, frame_name};
use super::stored_run::remove_claims_on_unseen_parts;
use super::{
    RECORDING, Receipt, RecordingReader, Replayed, RunFiles, RunRecord, StoreError, attempts, durable, frames, is_own_file, is_own_folder,
    receipt, replay, run, sums,
};
use carved_core::flag::StoredFlag;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::pipeline::standard::Aspect;
use carved_records::{Event, ViewTaken, WellStatus, is_plain_name, is_well, sha256_hex};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A cloneable read handle. It keeps nothing open.
#[derive(Debug, Clone)]
pub struct StoreReader {
    root: Arc<Path>,
    /// The folder of the rig's calibrations.
    calibrations: Arc<Path>,
}

/// A stored well of a run.
#[derive(Debug)]
pub struct StoredSpecimen {
    /// Status of the newest attempt. `None` for an earlier attempt.
    pub status: Option<WellStatus>,
    /// Numbers of the earlier attempts.
    pub earlier: Vec<u32>,
    pub recording: Value,
    pub measurement: Option<Value>,
    /// Views of the newest attempt, from the journal. Empty for an earlier attempt.
    pub views: Vec<ViewTaken>,
    pub files: Vec<SpecimenFile>,
}

/// A file of a specimen that clients can request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SpecimenFile {
    Mesh,
    Model,
    /// The detection frame. A skipped well has no other frame.
    Detection,
    /// The newest take of a view, by its number in the ledger. The closure view is not available.
    View(u32),
    Profile(u32),
    /// A standard picture of a larva.
    Standard {
        aspect: Aspect,
        /// TIFF in place of PNG.
        is_tiff: bool,
    },
}

impl SpecimenFile {
    /// Name of a standard picture in the recording.
    pub fn standard_name(aspect: Aspect, is_tiff: bool) -> String {
        format!("{}.{}", aspect.name(), if is_tiff { "tif" } else { "png" })
    }

    /// The standard pictures.
    pub fn standard() -> impl Iterator<Item = Self> {
        Aspect::ALL.into_iter().flat_map(|aspect| [false, true].map(|is_tiff| Self::Standard { aspect, is_tiff }))
    }

    /// File name in the recording.
    fn name(self, recording: &Path) -> String {
        match self {
            Self::Mesh => "mesh.ply".into(),
            Self::Model => "model.glb".into(),
            Self::Detection => DETECTION.into(),
            Self::View(i) => {
                let takes = (0..).map(|take| frame_name(i, take)).take_while(|name| recording.join(name).is_file());
                takes.last().unwrap_or_else(|| frame_name(i, 0))
            }
            Self::Profile(i) => format!("profiles/view_{i:03}.png"),
            Self::Standard { aspect, is_tiff } => Self::standard_name(aspect, is_tiff),
        }
    }
}

/// An existing file, and its hash if the recording is closed.
#[derive(Debug)]
pub struct StoredFile {
    /// The recording's folder.
    folder: PathBuf,
    name: String,
    sha256: Option<String>,
}

impl StoredFile {
    pub fn sha256(&self) -> Option<&str> {
        self.sha256.as_deref()
    }

    fn path(&self) -> PathBuf {
        self.folder.join(&self.name)
    }

    /// The stored bytes.
    ///
    /// # Errors
    /// The file cannot be read, or differs from the recorded one.
    pub fn read(self) -> Result<Vec<u8>, StoreError> {
        let path = self.path();
        let bytes = carved_files::read_below(&self.folder, Path::new(&self.name)).map_err(StoreError::io("read", &path))?;
        if let Some(expected) = &self.sha256 {
            sums::same(&path, expected, &sha256_hex(&bytes))?;
        }
        Ok(bytes)
    }

    /// The frame in the file, which a camera sent in this format.
    ///
    /// # Errors
    /// As [`Self::read`], and a file that holds no such frame.
    pub fn decode(self, format: PixelFormat) -> Result<RawFrame, StoreError> {
        let path = self.path();
        frames::decode_bytes(&path, &self.read()?, format)
    }
}

impl StoreReader {
    pub fn new(root: &Path) -> Self {
        Self { root: root.into(), calibrations: root.join("calibrations").into() }
    }

    /// The same with the rig's calibrations in another folder.
    #[must_use]
    pub fn with_calibrations(self, folder: &Path) -> Self {
        Self { calibrations: folder.into(), ..self }
    }

    /// The bead gates that are kept, the oldest first, of all rigs whose calibrations are in the folder.
    ///
    /// # Errors
    /// A folder that cannot be listed.
    pub fn gates(&self) -> Result<Vec<GateFile>, StoreError> {
        gates::every(&self.calibrations)
    }

    /// Runs, newest first.
    ///
    /// # Errors
    /// The index cannot be read.
    pub fn runs(&self, query: &RunsQuery) -> Result<Vec<RunRow>, StoreError> {
        index::runs(&self.root, query)
    }

    /// The events behind the one with this id.
    ///
    /// # Errors
    /// The index cannot be read.
    pub fn events_after(&self, id: u64, most: usize) -> Result<EventsAfter, StoreError> {
        index::events_after(&self.root, id, most)
    }

    /// Whether the journal contains a run of this name, even if its folder was removed.
    ///
    /// # Errors
    /// The index cannot be read.
    pub fn was_accepted(&self, run: &str) -> Result<bool, StoreError> {
        disk::watched(false, || index::was_accepted(&self.root, run))
    }

    pub(super) fn used_bytes(&self) -> Result<u64, StoreError> {
        index::used_bytes(&self.root)
    }

    /// The folder of a run. `None` of a name that is none of a run, and of a link.
    pub(super) fn run_folder(&self, run: &str) -> Option<PathBuf> {
        is_plain_name(run).then(|| self.root.join("runs").join(run)).filter(|folder| is_own_folder(folder))
    }

    fn specimen_folder(&self, run: &str, well: &str, attempt: u32) -> Option<PathBuf> {
        let folder = self.run_folder(run).filter(|_| is_well(well))?.join(attempts::folder_name(well, attempt));
        is_own_folder(&folder).then_some(folder)
    }

    /// The run of this name. `None` if there is none.
    ///
    /// # Errors
    /// The run cannot be read.
    pub fn run(&self, id: &str) -> Result<Option<RunRecord>, StoreError> {
        let Some(file) = self.run_folder(id).map(|f| f.join(run::FILE)).filter(|f| is_own_file(f)) else { return Ok(None) };
        RunRecord::read(&file).map(Some)
    }

    /// The events of a run after the event `after`, oldest first, at most `most`. Those of single views are left out.
    ///
    /// # Errors
    /// An index that cannot be read.
    pub fn events_of(&self, run: &str, after: u64, most: usize) -> Result<Vec<Event>, StoreError> {
        index::events_of(&self.root, run, after, most)
    }

    /// The copies of a run that `carved archive` made, newest first. Receipts that cannot be read are logged and count as none.
    pub fn copies(&self, run: &str) -> Vec<Receipt> {
        let Some(folder) = self.run_folder(run) else { return Vec::new() };
        receipt::receipts(&folder).unwrap_or_else(|error| {
            tracing::warn!(%error, "the receipts of a run's copies are not read");
            Vec::new()
        })
    }

    /// The files of a run that has ended. `None` if there is no such run.
    ///
    /// # Errors
    /// A run under way, and a folder that cannot be read.
    pub fn run_files(&self, id: &str) -> Result<Option<RunFiles>, StoreError> {
        let Some(folder) = self.run_folder(id).filter(|f| is_own_file(&f.join(run::FILE))) else { return Ok(None) };
        RunFiles::of(&folder).map(Some)
    }

    /// The format of the frames of a well. `None` where nothing was recorded of it.
    ///
    /// # Errors
    /// A recording that cannot be read, or that names no format.
    pub fn pixel_format(&self, run: &str, well: &str, attempt: u32) -> Result<Option<PixelFormat>, StoreError> {
        let Some(folder) = self.specimen_folder(run, well, attempt) else { return Ok(None) };
        let path = folder.join(RECORDING);
        let mut recording: Value = durable::read_json(&path, "JSON")?;
        let format = serde_json::from_value(recording["rig"]["pixel_format"].take());
        let wrong =
            |e: serde_json::Error| StoreError::Format { path, expected: "a pixel format as `rig.pixel_format`", found: e.to_string() };
        format.map(Some).map_err(wrong)
    }

    /// The recording of the newest attempt at a well of a run. `None` if nothing was recorded.
    ///
    /// # Errors
    /// A recording that cannot be read.
    pub fn recording(&self, run: &str, well: &str) -> Result<Option<RecordingReader>, StoreError> {
        self.specimen_folder(run, well, 0).map(|folder| RecordingReader::open(&folder)).transpose()
    }

    /// The results by other methods that are kept beside those of a well.
    pub fn replays(&self, run: &str, well: &str) -> Vec<Replayed> {
        self.specimen_folder(run, well, 0).map(|folder| replay::beside(&folder)).unwrap_or_default()
    }

    /// An attempt at a well of a run. Attempt 0 is the newest one. `None` if nothing was recorded.
    ///
    /// # Errors
    /// A file exists and cannot be read.
    pub fn specimen(&self, run: &str, well: &str, attempt: u32) -> Result<Option<StoredSpecimen>, StoreError> {
        let Some(folder) = self.specimen_folder(run, well, attempt) else { return Ok(None) };
        let record = self.run(run)?;
        let status = record.filter(|_| attempt == 0).and_then(|r| r.wells.into_iter().find(|w| w.well == well));
        let json = |name: &str| match folder.join(name) {
            path if is_own_file(&path) => durable::read_json::<Value>(&path, "JSON").map(Some),
            _ => Ok(None),
        };
        let recording = json(RECORDING)?.unwrap_or_default();
        let ledger = recording["ledger"].as_array().into_iter().flatten().filter(|e| e["closure"] != true);
        let views: Vec<u32> = ledger.filter_map(|e| e["view"].as_u64().map(|v| v as u32)).collect();
        let mut files = vec![SpecimenFile::Mesh, SpecimenFile::Model, SpecimenFile::Detection];
        files.extend(SpecimenFile::standard());
        files.extend(views.iter().flat_map(|&v| [SpecimenFile::View(v), SpecimenFile::Profile(v)]));
        files.sort_unstable();
        // The ledger lists each take of a retaken view.
        files.dedup();
        files.retain(|file| folder.join(file.name(&folder)).is_file());
        let earlier = folder.parent().map(|run| attempts::earlier(run, well)).unwrap_or_default();
        let mut measurement = json(MEASUREMENT)?;
        if let Some(numbers) = &mut measurement {
            remove_claims_on_unseen_parts(numbers, status.as_ref().is_some_and(|well| StoredFlag::is_bound(&well.flags)));
        }
        let newest = (attempt == 0).then(|| index::views(&self.root, run, well)).transpose();
        // The folder has all results. Without the index only the curve of volumes is missing.
        let broken = |error: &StoreError| tracing::warn!(%error, "the volumes after each view are not read");
        let taken = newest.inspect_err(broken).ok().flatten().unwrap_or_default();
        Ok(Some(StoredSpecimen { status, earlier, recording, measurement, views: taken, files }))
    }

    /// A file of a specimen. `None` if it does not exist.
    ///
    /// # Errors
    /// The checksums cannot be read, or do not list the file.
    pub fn file(&self, run: &str, well: &str, attempt: u32, file: SpecimenFile) -> Result<Option<StoredFile>, StoreError> {
        let Some(folder) = self.specimen_folder(run, well, attempt) else { return Ok(None) };
        let name = file.name(&folder);
        if !folder.join(&name).is_file() {
            return Ok(None);
        }
        let sha256 = sums::expected(&folder, &name)?;
        Ok(Some(StoredFile { folder, name, sha256 }))
    }
}
