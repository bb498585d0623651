//! The daily bead gates of a rig. They are computed from recordings of beads and stored with a date beside the rig's calibrations.
//!
//! ```text
//!  recordings of beads ── made ── gate-DAY-ID.json ── newest: passed, how old
//!                          ▲            └── earlier gates that passed ── charts of the next
//!                          └────────────────┘
//! ```

use super::{RecordingReader, Software, StoreError, disk, durable};
use carved_core::quality::gate::{BeadGate, BeadMeasured, GateNumbers, GateSettings, GateVerdict};
use carved_core::statistics::upper_median;
use carved_records::{Mode, SpecimenKind, is_fresh, sha256_hex};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

pub const SCHEMA: &str = "carved.bead-gate/1";

/// Content of `gate-DAY-ID.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GateFile {
    pub schema: String,
    /// The first 12 digits of the SHA-256 of the fields in `found`.
    pub id: String,
    pub software: Software,
    /// When the gate was computed, RFC 3339.
    pub date: jiff::Timestamp,
    #[serde(flatten)]
    pub found: MeasuredGate,
}

/// The result of the beads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeasuredGate {
    pub rig: String,
    pub mode: Mode,
    /// When the recording of the last bead began. Its day is in the file name.
    pub measured: jiff::Timestamp,
    pub recordings: Vec<PathBuf>,
    /// Recordings of beads to which no sphere was fitted.
    pub passed_over: Vec<PathBuf>,
    pub method: String,
    pub method_version: Option<String>,
    /// The limits, from the method of the last bead.
    pub settings: GateSettings,
    /// Starts a new history: earlier gates do not describe the rig as it is now.
    pub begins_history: bool,
    pub gate: BeadGate,
}

impl GateFile {
    /// Whether specimens may be measured with this gate at the time `now`.
    pub fn stands(&self, now: jiff::Timestamp) -> bool {
        self.found.gate.verdict.passes() && is_fresh(self.age_h(now) * 3600.0, self.found.settings.max_age_h * 3600.0)
    }

    pub fn age_h(&self, now: jiff::Timestamp) -> f64 {
        now.duration_since(self.found.measured).as_secs_f64() / 3600.0
    }
}

/// The recording of a bead and its numbers.
struct Bead {
    path: PathBuf,
    measured: jiff::Timestamp,
    reader: RecordingReader,
    /// `None` if no sphere was fitted.
    turn: Option<BeadMeasured>,
}

/// The gate of the beads among these recordings. It is compared with this rig's earlier gates in `folder`. The same well in several runs is
/// the same bead. `None` if there are no beads.
///
/// # Errors
/// A recording cannot be read, or the recordings are of different rigs.
pub fn made(recordings: &[PathBuf], folder: &Path, begins_history: bool) -> Result<Option<GateFile>, StoreError> {
    let mut beads = Vec::new();
    for path in recordings {
        beads.extend(bead(path)?);
    }
    let Some(last) = beads.iter().max_by_key(|b| b.measured) else { return Ok(None) };
    let recording = last.reader.recording();
    let (rig, mode) = (recording.rig.name.clone(), recording.mode);
    for bead in &beads {
        let other = bead.reader.recording();
        if (&other.rig.name, other.mode) != (&rig, mode) {
            let found = format!("{:?} ({:?}) beside {rig:?} ({mode:?})", other.rig.name, other.mode);
            return Err(StoreError::Format { path: bead.path.clone(), expected: "beads of one rig and mode", found });
        }
    }
    let earlier = if begins_history { Vec::new() } else { history(folder, &rig, mode, last.measured)? };
    let settings = recording.method.quality.gate;
    let turns: Vec<BeadMeasured> = beads.iter().filter_map(|b| b.turn.clone()).collect();
    let Some(gate) = BeadGate::of(&turns, &earlier, &settings) else { return Ok(None) };
    let paths = |has_sphere: bool| beads.iter().filter(|b| b.turn.is_some() == has_sphere).map(|b| b.path.clone()).collect();
    let found = MeasuredGate {
        measured: last.measured,
        recordings: paths(true),
        passed_over: paths(false),
        method: recording.method_name.clone(),
        method_version: recording.method.version.clone(),
        rig,
        mode,
        settings,
        begins_history,
        gate,
    };
    let id = sha256_hex(&durable::json_text(folder, &found)?)[..12].to_owned();
    Ok(Some(GateFile { schema: SCHEMA.into(), id, software: Software::this(), date: jiff::Timestamp::now(), found }))
}

/// `None` if the recording is not of a bead.
fn bead(path: &Path) -> Result<Option<Bead>, StoreError> {
    let reader = RecordingReader::open(path)?;
    let recording = reader.recording();
    if recording.specimen.specimen != SpecimenKind::Bead {
        return Ok(None);
    }
    let measured = recording.started.parse().map_err(|_| StoreError::Format {
        path: path.to_owned(),
        expected: "`started` as RFC 3339",
        found: recording.started.clone(),
    })?;
    let record = reader.measurement()?.record;
    let m = &record.measurement;
    let residuals: Vec<f64> = record.views.iter().filter(|v| v.used).filter_map(|v| v.residual_px).collect();
    let sphere = m.diameter_um.zip(m.aspect_ratio).zip(m.sphere_rms_um);
    let turn = sphere.map(|((diameter_um, aspect_ratio), sphere_rms_um)| BeadMeasured {
        bead: recording.specimen.well.clone(),
        diameter_um,
        aspect_ratio,
        sphere_rms_um,
        residual_px: (!residuals.is_empty()).then(|| upper_median(residuals)),
        uy_px: record.calibration.as_ref().map(|c| c.psi.uy),
        gamma_deg: record.calibration.as_ref().map(|c| c.psi.gamma.to_degrees()),
    });
    Ok(Some(Bead { path: path.to_owned(), measured, reader, turn }))
}

/// Writes a gate beside the rig's calibrations. An existing file is not overwritten.
///
/// # Errors
/// The folder cannot be written, or the gate exists already.
pub fn keep(folder: &Path, file: &GateFile) -> Result<PathBuf, StoreError> {
    let path = folder.join(format!("gate-{}-{}.json", file.found.measured.strftime("%Y-%m-%d"), file.id));
    if path.exists() {
        return Err(StoreError::Exists { path });
    }
    durable::create_folder(folder)?;
    durable::write_json(&path, file)?;
    Ok(path)
}

/// Computes and stores the gate of a run's beads. `None` if there are too few of them.
///
/// # Errors
/// As [`made`] and [`keep`].
pub fn after_run(run: &Path, folder: &Path) -> Result<Option<GateFile>, StoreError> {
    let mut recordings: Vec<PathBuf> = std::fs::read_dir(run)
        .map_err(StoreError::io("list", run))?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.join(super::MEASUREMENT).is_file())
        // An earlier attempt at a bead does not count.
        .filter(|path| path.extension().is_none())
        .collect();
    recordings.sort();
    let Some(file) = made(&recordings, folder, false)? else { return Ok(None) };
    if file.found.gate.verdict == GateVerdict::TooFewBeads {
        return Ok(None);
    }
    keep(folder, &file)?;
    Ok(Some(file))
}

/// This rig's gates, oldest first. A file that cannot be read is logged and skipped.
///
/// # Errors
/// The folder exists and cannot be listed.
pub fn all(folder: &Path, rig: &str, mode: Mode) -> Result<Vec<GateFile>, StoreError> {
    let mut gates = every(folder)?;
    gates.retain(|gate| gate.found.rig == rig && gate.found.mode == mode);
    Ok(gates)
}

/// The gates of every rig and mode in the folder, the oldest first. A file that cannot be read is logged and skipped.
///
/// # Errors
/// A folder that is there and cannot be listed.
pub fn every(folder: &Path) -> Result<Vec<GateFile>, StoreError> {
    disk::watched(false, || read_every(folder))
}

fn read_every(folder: &Path) -> Result<Vec<GateFile>, StoreError> {
    let mut gates: Vec<GateFile> = Vec::new();
    let is_gate = |path: &PathBuf| path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with("gate-"));
    for path in durable::json_files(folder)?.into_iter().filter(is_gate) {
        match durable::read_json::<GateFile>(&path, "a bead gate (carved.bead-gate/1)") {
            Ok(file) if file.schema == SCHEMA => gates.push(file),
            Ok(_) => {}
            Err(error) => tracing::warn!(%error, "a bead gate is passed over"),
        }
    }
    // The id makes the order of equal times unique, because a folder has no order.
    gates.sort_by(|a, b| (a.found.measured, a.date, &a.id).cmp(&(b.found.measured, b.date, &b.id)));
    Ok(gates)
}

/// The newest gate of this rig. A run checks it before it measures.
///
/// # Errors
/// As [`all`].
pub fn newest(folder: &Path, rig: &str, mode: Mode) -> Result<Option<GateFile>, StoreError> {
    Ok(all(folder, rig, mode)?.pop())
}

/// The passed gates before a time, back to the newest start of a history. If there are several of one measurement, the last computed one
/// counts.
fn history(folder: &Path, rig: &str, mode: Mode, before: jiff::Timestamp) -> Result<Vec<GateNumbers>, StoreError> {
    let mut gates: Vec<GateFile> = all(folder, rig, mode)?.into_iter().filter(|g| g.found.measured < before).collect();
    let from = gates.iter().rposition(|g| g.found.begins_history).unwrap_or(0);
    gates.drain(..from);
    let mut numbers: Vec<(jiff::Timestamp, GateNumbers)> = Vec::new();
    for gate in gates.into_iter().filter(|g| g.found.gate.verdict.passes()) {
        numbers.retain(|(measured, _)| *measured != gate.found.measured);
        numbers.push((gate.found.measured, gate.found.gate.numbers));
    }
    Ok(numbers.into_iter().map(|(_, numbers)| numbers).collect())
}
