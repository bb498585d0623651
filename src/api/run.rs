//! Plans, plate maps and results, as clients send and read them.

use super::words::{ConcentrationUnit, Control, SpecimenKind, SpecimenOutcome};
use carved_core::flag::StoredFlag;
use carved_records as records;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Body of `PUT /v1/runs/{run_id}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RunPlan {
    #[schema(pattern = "^[A-Za-z0-9_-][A-Za-z0-9._-]{0,63}$")]
    pub plate_barcode: String,
    /// Name of a method of the configuration.
    pub method: String,
    /// The version that the method must have there; any where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method_version: Option<String>,
    #[schema(pattern = r"\S")]
    pub operator: String,
    #[serde(default)]
    pub external_id: Option<String>,
    /// Number of wells of the plate: 6, 12, 24, 48, 96, 384 or 1536. Without it the plate is one that holds the wells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate_format: Option<u32>,
    /// The wells in the order in which they are visited.
    #[schema(min_items = 1)]
    pub plate_map: Vec<PlannedWell>,
    /// What the lab keeps with the plate, as MIHCSME has it; stored with the run and not read.
    #[serde(default, skip_serializing_if = "records::Metadata::is_empty")]
    #[schema(value_type = Object)]
    pub metadata: records::Metadata,
}

impl From<records::RunPlan> for RunPlan {
    fn from(from: records::RunPlan) -> Self {
        let records::RunPlan { plate_barcode, method, method_version, operator, external_id, plate_format, plate_map, metadata } = from;
        Self {
            plate_barcode,
            method,
            method_version,
            operator,
            external_id,
            plate_format,
            plate_map: plate_map.into_iter().map(Into::into).collect(),
            metadata,
        }
    }
}

impl From<RunPlan> for records::RunPlan {
    fn from(from: RunPlan) -> Self {
        let RunPlan { plate_barcode, method, method_version, operator, external_id, plate_format, plate_map, metadata } = from;
        Self {
            plate_barcode,
            method,
            method_version,
            operator,
            external_id,
            plate_format,
            plate_map: plate_map.into_iter().map(Into::into).collect(),
            metadata,
        }
    }
}

/// One well of a plate map: what is in it, and what was done to it. carved measures by `specimen` and `dpf` and carries the rest
/// into the results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlannedWell {
    /// `A01` to `AF48`.
    #[schema(pattern = "^([A-Z]|A[A-F])(0[1-9]|[1-3][0-9]|4[0-8])$")]
    pub well: String,
    #[serde(default = "larva")]
    pub specimen: SpecimenKind,
    /// Days post fertilisation.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 30)]
    pub dpf: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(max_length = 200, pattern = r"\S")]
    pub compound: Option<String>,
    /// In `concentration_unit`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0)]
    pub concentration: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub concentration_unit: Option<ConcentrationUnit>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(max_length = 200, pattern = r"\S")]
    pub strain: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(max_length = 200, pattern = r"\S")]
    pub treatment: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub control: Option<Control>,
    /// Number of the repetition of the same condition, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1)]
    pub replicate: Option<u32>,
}

impl From<records::PlannedWell> for PlannedWell {
    fn from(from: records::PlannedWell) -> Self {
        let records::PlannedWell {
            well,
            specimen,
            dpf,
            compound,
            concentration,
            concentration_unit,
            strain,
            treatment,
            control,
            replicate,
        } = from;
        Self {
            well,
            specimen: specimen.into(),
            dpf,
            compound,
            concentration,
            concentration_unit: concentration_unit.map(Into::into),
            strain,
            treatment,
            control: control.map(Into::into),
            replicate,
        }
    }
}

impl From<PlannedWell> for records::PlannedWell {
    fn from(from: PlannedWell) -> Self {
        let PlannedWell { well, specimen, dpf, compound, concentration, concentration_unit, strain, treatment, control, replicate } = from;
        Self {
            well,
            specimen: specimen.into(),
            dpf,
            compound,
            concentration,
            concentration_unit: concentration_unit.map(Into::into),
            strain,
            treatment,
            control: control.map(Into::into),
            replicate,
        }
    }
}

/// A plate map that holds no mistake.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct PlateMap {
    /// The `plate_format` of a run's plan, where the file names it.
    pub plate_format: Option<u32>,
    /// The `plate_map` of a run's plan: the wells in the order of the file.
    pub plate_map: Vec<PlannedWell>,
    /// The `metadata` of a run's plan: MIHCSME as it came, or `columns` with the cells of a CSV that carved does not read.
    #[schema(value_type = Object)]
    pub metadata: records::Metadata,
    /// What was read otherwise than it stands there, each with its place.
    pub notes: Vec<String>,
}

impl From<records::plate_map::PlateMap> for PlateMap {
    fn from(from: records::plate_map::PlateMap) -> Self {
        let records::plate_map::PlateMap { plate_format, plate_map, metadata, notes } = from;
        Self { plate_format, plate_map: plate_map.into_iter().map(Into::into).collect(), metadata, notes }
    }
}

fn larva() -> SpecimenKind {
    SpecimenKind::Larva
}

/// One thing wrong with what was sent, and where: a JSON pointer, or a line and a column of a CSV.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Mistake {
    /// JSON pointer into the body, as `/plate_map/3/well`; the body itself is the empty one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pointer: Option<String>,
    /// Line of the file, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// The column by its heading; not there where the whole line is meant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    pub detail: String,
}

impl From<records::plate_map::Mistake> for Mistake {
    fn from(from: records::plate_map::Mistake) -> Self {
        let records::plate_map::Mistake { pointer, line, column, detail } = from;
        Self { pointer, line, column, detail }
    }
}

impl From<Mistake> for records::plate_map::Mistake {
    fn from(from: Mistake) -> Self {
        let Mistake { pointer, line, column, detail } = from;
        Self { pointer, line, column, detail }
    }
}

/// One well of the run, as far as it has come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WellStatus {
    pub well: String,
    /// What the plate map says is in it.
    pub specimen: SpecimenKind,
    pub dpf: Option<f64>,
    pub outcome: Option<SpecimenOutcome>,
    /// Why a skipped or failed well has no number.
    pub reason: Option<String>,
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    pub flags: Vec<StoredFlag>,
    /// What made the numbers to trust: `support` (slices of the outlines) or `voxel` (the paper's).
    #[serde(default)]
    pub estimator: Option<String>,
    pub volume_um3: Option<f64>,
    /// Standard deviation.
    #[serde(default)]
    pub volume_sd_um3: Option<f64>,
    pub area_um2: Option<f64>,
    #[serde(default)]
    pub area_sd_um2: Option<f64>,
    /// Of the surface where the outlines put it, which is the one that is shown.
    pub field_volume_um3: Option<f64>,
    pub field_area_um2: Option<f64>,
    /// Of the fitted sphere, for beads.
    pub diameter_um: Option<f64>,
    /// Views that count; fewer than planned where some did not belong, or the method ended the turn early. Of a well that was aborted or
    /// interrupted, the views that are stored: 0 if none was taken, `null` in runs of versions that did not count them.
    #[serde(default)]
    pub views: Option<u32>,
    /// By the method: `views` of so many.
    #[serde(default)]
    pub views_planned: Option<u32>,
    /// Residual of the median view: how far its edges lie from those of the calibrated model, px.
    #[serde(default)]
    pub residual_px: Option<f64>,
    /// Fluorescence in the second camera per volume: grey levels times px per nl.
    #[serde(default)]
    pub signal_per_nl: Option<f64>,
    /// Where a larva of known age stands among reference larvae.
    #[serde(default)]
    pub reference: Option<Box<ReferenceStatus>>,
}

impl From<records::WellStatus> for WellStatus {
    fn from(from: records::WellStatus) -> Self {
        let records::WellStatus {
            well,
            specimen,
            dpf,
            outcome,
            reason,
            flags,
            estimator,
            volume_um3,
            volume_sd_um3,
            area_um2,
            area_sd_um2,
            field_volume_um3,
            field_area_um2,
            diameter_um,
            views,
            views_planned,
            residual_px,
            signal_per_nl,
            reference,
        } = from;
        Self {
            well,
            specimen: specimen.into(),
            dpf,
            outcome: outcome.map(Into::into),
            reason,
            flags,
            estimator,
            volume_um3,
            volume_sd_um3,
            area_um2,
            area_sd_um2,
            field_volume_um3,
            field_area_um2,
            diameter_um,
            views,
            views_planned,
            residual_px,
            signal_per_nl,
            reference: reference.map(|r| Box::new((*r).into())),
        }
    }
}

/// Disjoint counts of a run's wells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
pub struct WellCounts {
    pub succeeded: u32,
    pub flagged: u32,
    pub failed: u32,
    pub skipped: u32,
    pub interrupted: u32,
    pub pending: u32,
    pub total: u32,
}

impl From<records::WellCounts> for WellCounts {
    fn from(from: records::WellCounts) -> Self {
        let records::WellCounts { succeeded, flagged, failed, skipped, interrupted, pending, total } = from;
        Self { succeeded, flagged, failed, skipped, interrupted, pending, total }
    }
}

/// The place of `volume_um3` and `area_um2`; `measurement.json` has the whole of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReferenceStatus {
    pub volume: PlaceStatus,
    pub area: PlaceStatus,
}

impl From<records::ReferenceStatus> for ReferenceStatus {
    fn from(from: records::ReferenceStatus) -> Self {
        let records::ReferenceStatus { volume, area } = from;
        Self { volume: volume.into(), area: area.into() }
    }
}

/// One number among the reference larvae of its age; `null` throughout where there are none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlaceStatus {
    /// `area 0.8 SD below the mean of 24 larvae of 4 dpf`, or why there is no such place.
    pub words: String,
    /// Name of the group of reference larvae.
    pub group: Option<String>,
    /// Larvae in it.
    pub n: Option<u32>,
    /// Standard deviations above the group's mean.
    pub z: Option<f64>,
    /// Share of the group's larvae that are smaller, %.
    pub percentile: Option<f64>,
    /// What of the measurement and the group does not match, or is not known, in words.
    pub mismatches: Vec<String>,
}

impl From<records::PlaceStatus> for PlaceStatus {
    fn from(from: records::PlaceStatus) -> Self {
        let records::PlaceStatus { words, group, n, z, percentile, mismatches } = from;
        Self { words, group, n, z, percentile, mismatches }
    }
}

/// Seconds until the run is done.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Eta {
    /// Median, s.
    pub p50: f64,
    /// Nine runs in ten are done by then, s.
    pub p90: f64,
}

impl From<records::Eta> for Eta {
    fn from(from: records::Eta) -> Self {
        let records::Eta { p50, p90 } = from;
        Self { p50, p90 }
    }
}
