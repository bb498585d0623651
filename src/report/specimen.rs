//! What a report shows of one well.

use super::pictures::{self, Pictures};
use super::plots::WellNumber;
use crate::tables::statistics::WellCondition;
use carved_core::flag::{Flag, StoredFlag};
use carved_core::inside::EyesMissing;
use carved_core::quality::Quality;
use carved_records::{PlannedWell, SpecimenKind, SpecimenOutcome, WellNote};
use carved_store::{Computation, StoredRun, place_among_references};
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::Value;

/// Unit of volumes and areas in the report: 10^6 um^3 and 10^6 um^2.
pub(super) const MILLION: f64 = 1e6;

/// One planned well.
#[derive(Debug, Clone)]
pub struct Specimen {
    pub run: String,
    pub well: String,
    pub is_bead: bool,
    pub condition: WellCondition,
    pub outcome: Option<SpecimenOutcome>,
    pub reason: Option<String>,
    /// Why its files are not read.
    pub unreadable: Option<String>,
    pub flags: Vec<StoredFlag>,
    /// What a person said about it.
    pub note: Option<Box<WellNote>>,
    pub estimator: Option<String>,
    pub volume_um3: Option<f64>,
    pub volume_sd_um3: Option<f64>,
    pub area_um2: Option<f64>,
    pub area_sd_um2: Option<f64>,
    pub length_um: Option<f64>,
    /// Mean volume of both eyes, with its standard deviation.
    pub eye_volume_um3: [Option<f64>; 2],
    /// Distance between the centres of the eyes, with its standard deviation.
    pub eye_distance_um: [Option<f64>; 2],
    /// Volume of the gas in the swim bladder, with its standard deviation.
    pub bladder_volume_um3: [Option<f64>; 2],
    /// Whether it has gas.
    pub bladder_state: Option<String>,
    /// Why fewer than two eyes were found, in words.
    pub eyes_reason: Option<String>,
    pub diameter_um: Option<f64>,
    /// When the recording began, RFC 3339.
    pub started: Option<String>,
    pub sphere_rms_um: Option<f64>,
    pub aspect_ratio: Option<f64>,
    /// Standard deviations of volume, area, eye volume and distance of the eyes above the mean of reference larvae. `None` where the
    /// numbers are bounds.
    pub z: [Option<f64>; 4],
    pub quality: Quality,
    pub measurement_sha256: Option<String>,
    pub pictures: Pictures,
}

/// `left out by Kim: twin (tags: twin, oedema)`.
pub(super) fn note_words(note: &WellNote) -> String {
    let said = if note.excluded { "left out by" } else { "remark of" };
    let comment = if note.comment.is_empty() { String::new() } else { format!(": {}", note.comment) };
    let tags = if note.tags.is_empty() { String::new() } else { format!(" (tags: {})", note.tags.join(", ")) };
    format!("{said} {}{comment}{tags}", note.by)
}

impl Specimen {
    /// Every planned well of a run. The wells are read in parallel: nearly all of the time is their pictures.
    /// A well with a file that cannot be read, or was altered, has the reason and no numbers.
    pub fn all(run: &StoredRun) -> Vec<Self> {
        let read = |planned: &PlannedWell| {
            let well = run.readable_well(planned);
            let number = |pointer: &str| well.measurement.as_ref()?.pointer(pointer)?.as_f64();
            let place =
                |quantity: &str| well.measurement.as_ref().and_then(|m| place_among_references(m, quantity)).map(|(_, place)| place);
            let quantities = ["volume", "area", "eye_volume", "eye_distance"].map(place);
            let status = well.status.as_ref();
            let unreadable = if let Computation::Unreadable(why) = &well.computation { Some(why.clone()) } else { None };
            let flags = status.map(|s| s.flags.clone()).unwrap_or_default();
            let quality = well.measurement.as_ref().and_then(|m| serde_json::from_value(m["quality"].clone()).ok());
            Self {
                run: run.record().id.clone(),
                well: planned.well.clone(),
                is_bead: planned.specimen == SpecimenKind::Bead,
                condition: WellCondition::of(planned),
                outcome: status.and_then(|s| s.outcome),
                reason: unreadable.clone().or_else(|| status.and_then(|s| s.reason.clone())),
                unreadable,
                flags,
                note: status.and_then(|s| s.note.clone()),
                estimator: well.measurement.as_ref().and_then(|m| m["measurement"]["estimator"].as_str().map(str::to_owned)),
                volume_um3: number("/measurement/volume_um3"),
                volume_sd_um3: number("/measurement/volume_sd_um3"),
                area_um2: number("/measurement/area_um2"),
                area_sd_um2: number("/measurement/area_sd_um2"),
                length_um: number("/shape/body/length_um"),
                eye_volume_um3: [number("/eyes/mean_volume_um3"), number("/eyes/mean_volume_sd_um3")],
                eye_distance_um: [number("/eyes/distance_um"), number("/eyes/distance_sd_um")],
                bladder_volume_um3: [number("/bladder/volume_um3"), number("/bladder/volume_sd_um3")],
                bladder_state: well.measurement.as_ref().and_then(|m| m.pointer("/bladder/state")?.as_str().map(str::to_owned)),
                eyes_reason: well.measurement.as_ref().and_then(|m| words_of(m.pointer("/eyes/reason")?)),
                diameter_um: number("/measurement/diameter_um"),
                started: well.recording.as_ref().and_then(|r| r["started"].as_str().map(str::to_owned)),
                sphere_rms_um: number("/measurement/sphere_rms_um"),
                aspect_ratio: number("/measurement/aspect_ratio"),
                z: quantities.map(|place| place.and_then(|p| p["z"].as_f64())),
                quality: quality.unwrap_or_default(),
                pictures: pictures::of(&well),
                measurement_sha256: well.measurement_sha256,
            }
        };
        run.record().plan.plate_map.par_iter().map(read).collect()
    }

    /// Flags, reason and remark in words; empty without any.
    pub fn remarks(&self) -> String {
        let note = self.note.as_deref().map(note_words);
        let parts = [Some(StoredFlag::joined(&self.flags, ", ")), self.reason.clone(), note];
        parts.into_iter().flatten().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
    }

    /// Whether the true volume, area and length are larger than the numbers: part of the specimen was not measured.
    pub fn is_bound(&self) -> bool {
        StoredFlag::is_bound(&self.flags)
    }

    /// The volume for the plot of the plate, in 10^6 um^3.
    pub fn on_plate(&self) -> WellNumber {
        WellNumber {
            value: self.volume_um3.map(|v| v / MILLION),
            flagged: !self.flags.is_empty(),
            is_bound: self.is_bound(),
            is_excluded: self.flags.iter().any(|flag| *flag == Flag::Excluded),
        }
    }
}

/// The sentence for a reason. A later version's reason stays as it is written.
fn words_of(reason: &Value) -> Option<String> {
    EyesMissing::deserialize(reason).map_or_else(|_| reason.as_str().map(str::to_owned), |known| Some(known.to_string()))
}
