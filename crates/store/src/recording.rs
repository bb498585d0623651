//! A recording: the files of one specimen. Replay and offline measurement read it.
//!
//! ```text
//! runs/RUN/A01/recording.json          rig, method, ledger (rewritten durably after each view)
//!              frames/view_000.png     the raw frame, lossless; Bayer frames stay mosaics
//!              frames/view_000.retake-1.png   a retake of this view, if the first take did not fit
//!              frames/closure.png      the view at 360 deg
//!              second/view_000.png     the frame of the second camera for this view, if there is one
//!              frames/empty.png        the empty-capillary picture that frames are compared with, if there is one
//!              frames/detect.png       the detection frame, on which the well was judged
//!              profiles/view_000.png   the mask that was carved with
//!              references.json         the reference larvae for a larva of known age
//!              measurement.json        the numbers
//!              mesh.ply                the surface, um
//!              model.glb               the surface with fewer triangles
//!              lateral.png, .tif       the left side of a larva, head to the left
//!              dorsal.png, .tif        its back, head to the left
//!              SHA256SUMS              checksums of all of the above, once the recording is closed
//! ```

use super::{RECORDING, RecordingFiles, Software, StoreError, durable, frames, receipt, schema, sums};
use carved_core::flag::{Flag, StoredFlag};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::geometry::{Camera, SecondOptics};
use carved_core::measure::Measurement;
use carved_core::measure::fluorescence::{Fluorescence, SecondView};
use carved_core::measure::references::{EyeNumbers, References, Specimen, Standing, estimates};
use carved_core::pipeline::SpecimenRecord;
use carved_core::profile::Mask;
use carved_core::quality::UsualOpacity;
use carved_core::surface::Mesh;
use carved_core::units::{Sense, StepsPerRevolution};
use carved_records::{InstrumentIdentity, Ledger, LedgerEntry, Method, Mode, PlannedWell, is_plain_name, is_well, sha256_hex};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub(super) const SCHEMA: &str = "carved.recording/1";
/// The detection frame, on which the well was judged.
pub(super) const DETECTION: &str = "frames/detect.png";

/// Name of the file with a recording's numbers.
pub const MEASUREMENT: &str = "measurement.json";

/// Content of `measurement.json`: the numbers, and the mode. It contains no time and no name of a run, so that equal numbers give equal
/// bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MeasurementFile {
    pub mode: Mode,
    #[serde(flatten)]
    pub record: SpecimenRecord,
    /// Result of the second camera, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fluorescence: Option<Fluorescence>,
    /// Comparison with reference larvae. `None` for a bead, or for a larva of unknown age.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<Standing>,
    /// The lab's version of the method. `None` if the method has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method_version: Option<String>,
}

impl MeasurementFile {
    /// The numbers of a recording, compared with these references.
    pub fn new(recording: &Recording, references: &[References], mut record: SpecimenRecord) -> Self {
        let measurement = &record.measurement;
        let standing = |dpf| {
            let specimen = Specimen {
                dpf,
                asd: recording.method.asd,
                views: measurement.views,
                voxel_um: measurement.voxel_size_um,
                epsilon: measurement.epsilon,
                simulated: recording.mode == Mode::Simulated,
                strain: recording.specimen.strain.clone(),
                treatment: recording.specimen.treatment_of_larva(),
                untreated: recording.specimen.is_untreated(),
                estimates: estimates(measurement),
                eyes: record.eyes.as_ref().and_then(EyeNumbers::of),
                is_bound: StoredFlag::is_bound(&record.flags),
            };
            Standing::of(&specimen, references)
        };
        let reference = recording.specimen.age_of_larva().filter(|_| !references.is_empty()).map(standing);
        if let Some(standing) = &reference {
            let trusted = record.measurement.estimator.name();
            record.compare_with_references(standing.z(trusted), recording.method.quality.reference_z);
        }
        if let Some(usual) = recording.usual_opacity {
            record.compare_with_earlier(usual);
        }
        // A few frames of a sweep may be lost; an imported turn was complete once.
        if !recording.missing_views.is_empty() && recording.mode == Mode::Imported {
            record.flags.push(Flag::MissingViews.into());
        }
        Self { mode: recording.mode, record, fluorescence: None, reference, method_version: recording.method.version.clone() }
    }
}

/// The numbers of the second camera. `frames`: its frames with their ledger entries. The closure view is left out.
pub fn fluorescence<'a>(
    mesh: &Mesh,
    measurement: &Measurement,
    optics: &SecondOptics,
    frames: impl Iterator<Item = (&'a LedgerEntry, &'a RawFrame)>,
) -> Option<Fluorescence> {
    let views: Vec<SecondView> = frames
        .filter(|(entry, _)| !entry.closure)
        .map(|(entry, frame)| SecondView {
            view: entry.view,
            projection: optics.projection(entry.omega),
            pixels: frame.bytes(),
            width: frame.width() as usize,
            height: frame.height() as usize,
        })
        .collect();
    Fluorescence::measure(mesh, &views, measurement.volume_um3, measurement.volume_sd_um3)
}

/// The rig at the time of the recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RigRecord {
    pub name: String,
    /// The model camera psi. The angles are in the ledger.
    pub camera: Camera,
    pub pixel_format: PixelFormat,
    /// SHA-256 of the pixels of `frames/empty.png`, if frames were compared with it.
    #[serde(default)]
    pub empty_capillary_sha256: Option<String>,
    pub steps_per_revolution: StepsPerRevolution,
    pub sense: Sense,
    pub rotation_identity: String,
    pub camera_identity: String,
    /// The camera's own features that change the picture, such as exposure and gain, as it reported them when it was configured. Empty for
    /// imported pictures and in files of versions that did not write them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub camera_features: BTreeMap<String, String>,
    /// The second camera, if there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<SecondRecord>,
}

/// The second camera at the time of the recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SecondRecord {
    pub optics: SecondOptics,
    pub identity: String,
    /// As [`RigRecord::camera_features`], of this camera.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub camera_features: BTreeMap<String, String>,
}

/// Content of `recording.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Recording {
    pub schema: String,
    pub software: Software,
    pub mode: Mode,
    /// The instrument that took the frames. `None` for imported pictures and in files of versions that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instrument: Option<InstrumentIdentity>,
    pub run: String,
    pub specimen: PlannedWell,
    /// RFC 3339, UTC.
    pub started: String,
    pub rig: RigRecord,
    pub method_name: String,
    pub method: Method,
    /// The true values of a simulated specimen. `null` on an instrument.
    pub truth: Option<serde_json::Value>,
    /// SHA-256 of `references.json`, if the larva is compared with references.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub references_sha256: Option<String>,
    /// The method's rule ended the turn after this number of views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_after_views: Option<u32>,
    /// Numbers of the views without a picture: of an imported turn as the names of the pictures count, of a sweep around the turn.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing_views: Vec<u32>,
    /// How opaque the larvae were that this rig measured before it. `None` where too few are known, and in files of versions
    /// that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usual_opacity: Option<UsualOpacity>,
    /// The turn was accepted before the specimen was released. The numbers are computed from these frames only.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub accepted: bool,
    /// In the order in which the views were taken.
    pub ledger: Ledger,
}

impl Recording {
    pub fn new(run: &str, specimen: PlannedWell, mode: Mode, rig: RigRecord, method_name: &str, method: Method) -> Self {
        Self {
            schema: SCHEMA.into(),
            software: Software::this(),
            mode,
            instrument: None,
            run: run.into(),
            specimen,
            started: jiff::Timestamp::now().to_string(),
            rig,
            method_name: method_name.into(),
            method,
            truth: None,
            references_sha256: None,
            ended_after_views: None,
            missing_views: Vec::new(),
            usual_opacity: None,
            accepted: false,
            ledger: Ledger::default(),
        }
    }
}

impl Recording {
    /// Checks names that may become paths.
    fn check(&self, file: &Path) -> Result<(), StoreError> {
        let named = |expected, found: &str, is: bool| {
            let wrong = || StoreError::Format { path: file.to_owned(), expected, found: format!("{found:?}") };
            if is { Ok(()) } else { Err(wrong()) }
        };
        let (well, run, method) = (&self.specimen.well, &self.run, &self.method_name);
        named("a well A01 to AF48 as `specimen.well`", well, is_well(well))?;
        named("a name of letters, digits, '-', '_' and '.' as `run`", run, is_plain_name(run))?;
        named("a name of letters, digits, '-', '_' and '.' as `method_name`", method, is_plain_name(method))
    }
}

/// The frame file of a ledger entry, relative to the recording.
fn frame_file(entry: &LedgerEntry) -> String {
    picture_file("frames", entry)
}

fn second_file(entry: &LedgerEntry) -> String {
    picture_file("second", entry)
}

fn picture_file(folder: &str, entry: &LedgerEntry) -> String {
    let name = if entry.closure { "closure".to_owned() } else { view_name(entry.view) };
    take_name(folder, &name, entry.retake)
}

/// The frame file of a take of a view, relative to the recording. Take 0 is the first one.
pub(super) fn frame_name(view: u32, retake: u32) -> String {
    take_name("frames", &view_name(view), retake)
}

fn view_name(view: u32) -> String {
    format!("view_{view:03}")
}

fn take_name(folder: &str, name: &str, retake: u32) -> String {
    match retake {
        0 => format!("{folder}/{name}.png"),
        again => format!("{folder}/{name}.retake-{again}.png"),
    }
}

/// The empty-capillary picture, relative to the recording.
const EMPTY: &str = "frames/empty.png";

/// The reference larvae, relative to the recording.
const REFERENCES: &str = "references.json";

/// Writes a recording. Once `add_view` returns, the view survives a crash.
pub struct RecordingWriter {
    folder: PathBuf,
    recording: Recording,
    /// SHA-256 of each written file, by its name in the folder.
    written: BTreeMap<String, String>,
}

impl RecordingWriter {
    /// Starts a recording in a folder that has none. With the empty-capillary picture, the recording is reproducible from its own folder.
    pub fn create(folder: &Path, recording: Recording, empty: Option<&RawFrame>) -> Result<Self, StoreError> {
        if folder.join(RECORDING).exists() {
            return Err(StoreError::Exists { path: folder.to_owned() });
        }
        durable::create_folder(&folder.join("frames"))?;
        durable::create_folder(&folder.join("profiles"))?;
        if recording.rig.second.is_some() {
            durable::create_folder(&folder.join("second"))?;
        }
        let mut writer = Self { folder: folder.to_owned(), recording, written: BTreeMap::new() };
        if let Some(frame) = empty {
            writer.put(EMPTY, &frames::encode(frame)?)?;
        }
        writer.recording.rig.empty_capillary_sha256 = empty.map(|frame| sha256_hex(frame.bytes()));
        writer.save()?;
        Ok(writer)
    }

    /// Continues a recording after a restart, to add missing results and to close it.
    pub fn resume(reader: &RecordingReader) -> Self {
        Self { folder: reader.folder.clone(), recording: reader.recording.clone(), written: BTreeMap::new() }
    }

    fn put(&mut self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        durable::write(&self.folder.join(name), bytes)?;
        self.written.insert(name.to_owned(), sha256_hex(bytes));
        Ok(())
    }

    fn save(&mut self) -> Result<(), StoreError> {
        let text = durable::json_text(&self.folder.join(RECORDING), &self.recording)?;
        self.put(RECORDING, &text)
    }

    /// Adds the detection frame, and the true values of a simulated specimen.
    pub fn add_detection(&mut self, frame: &RawFrame, truth: Option<serde_json::Value>) -> Result<(), StoreError> {
        self.put(DETECTION, &frames::encode(frame)?)?;
        self.recording.truth = truth;
        self.save()
    }

    /// Adds the references of a larva of known age, so that the recording gives the comparison from its own folder.
    pub fn add_references(&mut self, references: &[References]) -> Result<(), StoreError> {
        if self.recording.specimen.age_of_larva().is_none() || references.is_empty() {
            return Ok(());
        }
        let text = durable::json_text(&self.folder.join(REFERENCES), &references)?;
        self.put(REFERENCES, &text)?;
        self.recording.references_sha256 = Some(sha256_hex(&text));
        self.save()
    }

    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Marks the turn as complete with fewer views than planned.
    pub fn end_after(&mut self, views: u32) -> Result<(), StoreError> {
        self.recording.ended_after_views = Some(views);
        self.save()
    }

    /// Names the planned views that did not arrive in a sweep.
    ///
    /// # Errors
    /// The record cannot be written.
    pub fn name_missing(&mut self) -> Result<(), StoreError> {
        let taken: BTreeSet<u32> = self.recording.ledger.carved().map(|entry| entry.view).collect();
        self.recording.missing_views = (0..self.recording.method.asd).filter(|view| !taken.contains(view)).collect();
        self.save()
    }

    /// Marks the turn as accepted. Once this returns it is durable, and the specimen may be released.
    pub fn accept(&mut self) -> Result<(), StoreError> {
        self.recording.accepted = true;
        self.save()
    }

    /// Writes the frame first, then the ledger. The ledger never lists a missing frame.
    pub fn add_view(&mut self, entry: LedgerEntry, frame: &RawFrame) -> Result<(), StoreError> {
        self.put(&frame_file(&entry), &frames::encode(frame)?)?;
        self.recording.ledger.push(entry).map_err(|e| StoreError::Format {
            path: self.folder.join(RECORDING),
            expected: "one ledger entry per view, all of one epoch",
            found: e.to_string(),
        })?;
        self.save()
    }

    /// Adds the second camera's frame of a view. Call it before `add_view`.
    pub fn add_second(&mut self, entry: &LedgerEntry, frame: &RawFrame) -> Result<(), StoreError> {
        self.put(&second_file(entry), &frames::encode(frame)?)
    }

    pub fn add_profile(&mut self, index: u32, mask: &Mask) -> Result<(), StoreError> {
        self.put(&format!("profiles/view_{index:03}.png"), &frames::encode_mask(mask)?)
    }

    /// Reads what is written so far.
    ///
    /// # Errors
    /// As [`RecordingReader::open`].
    pub fn reader(&self) -> Result<RecordingReader, StoreError> {
        RecordingReader::open(&self.folder)
    }

    /// Whether the recording has a file of this name.
    pub fn has(&self, name: &str) -> bool {
        self.folder.join(name).is_file()
    }

    /// Adds a result.
    pub fn add_file(&mut self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        self.put(name, bytes)
    }

    pub fn add_json<T: Serialize>(&mut self, name: &str, value: &T) -> Result<(), StoreError> {
        let text = durable::json_text(&self.folder.join(name), value)?;
        self.put(name, &text)
    }

    /// Writes the checksums and closes the recording, also after an interrupted turn. A file that differs from what was written is an
    /// error.
    pub fn close(self) -> Result<(), StoreError> {
        let sums = sums::of_recording(&self.folder)?;
        for (name, expected) in self.written {
            let path = self.folder.join(&name);
            match sums.get(Path::new(&name)) {
                Some(found) => sums::same(&path, &expected, found)?,
                None => return Err(StoreError::Vanished { path }),
            }
        }
        durable::write(&self.folder.join(super::sums::FILE), super::sums::text(&sums).as_bytes())
    }
}

/// Reads a recording. Each frame is verified against its recorded hash.
pub struct RecordingReader {
    files: RecordingFiles,
    folder: PathBuf,
    recording: Recording,
}

impl RecordingReader {
    /// Opens a recording. `path` is its folder, its `recording.json`, or its pack (`A01.tar`).
    ///
    /// # Errors
    /// There is no recording, or it cannot be read, was altered, or is of a newer carved.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let files = RecordingFiles::of(path)?;
        let file = files.path(RECORDING);
        let recording: Recording = schema::parse(&file, &files.require(RECORDING)?, SCHEMA)?;
        recording.check(&file)?;
        files.verified(RECORDING)?;
        Ok(Self { folder: files.folder(), files, recording })
    }

    /// The recording's folder. Of a pack `A01.tar` it is `A01` beside it, which need not exist.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Its files.
    pub fn files(&self) -> &RecordingFiles {
        &self.files
    }

    /// Returns an error with the number of views, unless the turn is complete.
    pub fn require_finished(&self) -> Result<(), StoreError> {
        // A sweep is accepted with a few lost frames. The method of an imported turn counts its pictures.
        let recording = &self.recording;
        let lost = if recording.mode == Mode::Imported { 0 } else { recording.missing_views.len() as u32 };
        let expected = recording.ended_after_views.unwrap_or(recording.method.asd.saturating_sub(lost));
        let found = recording.ledger.carved().count();
        if found != expected as usize {
            return Err(StoreError::Unfinished { path: self.folder.clone(), expected, found });
        }
        Ok(())
    }

    /// Whether the turn was accepted and all its frames are recorded.
    pub fn is_accepted(&self) -> bool {
        self.recording.accepted && self.require_finished().is_ok()
    }

    /// The numbers of a closed recording. `None` if they are not computed yet.
    pub fn closed_numbers(&self) -> Option<MeasurementFile> {
        let closed = [super::sums::FILE, MEASUREMENT].iter().all(|name| self.files.has(name));
        self.measurement().ok().filter(|_| closed)
    }

    /// The frame of a ledger entry, verified against the hash in the ledger.
    pub fn frame(&self, entry: &LedgerEntry) -> Result<RawFrame, StoreError> {
        self.raw(&frame_file(entry), self.recording.rig.pixel_format, &entry.sha256)
    }

    /// Where the frame of a ledger entry is. In a pack: the path that it would have in the folder.
    pub fn frame_path(&self, entry: &LedgerEntry) -> PathBuf {
        self.files.path(&frame_file(entry))
    }

    /// The second camera's frame of a ledger entry. `None` without a second camera.
    pub fn second(&self, entry: &LedgerEntry) -> Result<Option<RawFrame>, StoreError> {
        let Some(second) = &entry.second else { return Ok(None) };
        self.raw(&second_file(entry), PixelFormat::Mono8, &second.sha256).map(Some)
    }

    /// The empty-capillary picture that the frames were compared with. `None` without one.
    pub fn empty_capillary(&self) -> Result<Option<RawFrame>, StoreError> {
        let expected = self.recording.rig.empty_capillary_sha256.as_deref();
        expected.map(|expected| self.raw(EMPTY, self.recording.rig.pixel_format, expected)).transpose()
    }

    /// A raw frame. If it was pruned, the error says where its copy is.
    fn raw(&self, name: &str, format: PixelFormat, expected: &str) -> Result<RawFrame, StoreError> {
        let path = self.files.path(name);
        let Some(bytes) = self.files.read(name)? else { return Err(receipt::gone(&self.folder, name)) };
        let frame = frames::decode_bytes(&path, &bytes, format)?;
        sums::same(&path, expected, &sha256_hex(frame.bytes()))?;
        Ok(frame)
    }

    /// The bytes of a file of the recording, verified against its checksums. `None` if it is not there.
    ///
    /// # Errors
    /// The file cannot be read, is not listed in the checksums, or was altered.
    pub fn file(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        self.files.verified(name)
    }

    /// The stored numbers.
    pub fn measurement(&self) -> Result<MeasurementFile, StoreError> {
        let bytes = self.files.verified(MEASUREMENT)?.map_or_else(|| self.files.require(MEASUREMENT), Ok)?;
        durable::parse_json(&self.files.path(MEASUREMENT), &bytes, "the numbers of a specimen")
    }

    /// The references of the larva. Empty for a bead, or for a larva of unknown age.
    pub fn references(&self) -> Result<Vec<References>, StoreError> {
        let Some(expected) = &self.recording.references_sha256 else { return Ok(Vec::new()) };
        let path = self.files.path(REFERENCES);
        let bytes = self.files.require(REFERENCES)?;
        sums::same(&path, expected, &sha256_hex(&bytes))?;
        durable::parse_json(&path, &bytes, "references (carved.references/1)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// A sweep is accepted with a few lost frames, and its numbers are computed also after a crash.
    #[test]
    fn a_turn_is_finished_without_the_views_that_a_sweep_has_lost() {
        for (missing, mode, is_finished) in
            [(3, Mode::Simulated, true), (2, Mode::Simulated, false), (0, Mode::Simulated, false), (3, Mode::Imported, false)]
        {
            let dir = tempfile::tempdir().unwrap();
            let planned: PlannedWell = serde_json::from_value(serde_json::json!({ "well": "A01" })).unwrap();
            let mut recording = Recording { mode, missing_views: (0..missing).collect(), ..testing::recording("r1", &planned) };
            recording.method.asd = 3;
            let folder = dir.path().join("A01");
            RecordingWriter::create(&folder, recording, None).unwrap().accept().unwrap();
            let reader = RecordingReader::open(&folder).unwrap();
            assert_eq!((reader.require_finished().is_ok(), reader.is_accepted()), (is_finished, is_finished), "{missing} {mode:?}");
        }
    }
}
