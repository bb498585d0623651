//! The columns of the table of specimens: name, kind, meaning, and where the value comes from.

use super::row::{Row, hash_of};
use super::{Cell, Kind, ontology};
use crate::{Computation, RunRecord};
use carved_core::flag::StoredFlag;
use carved_core::measure::Estimator;
use carved_records::{InstrumentIdentity, Mode, PlannedWell, SpecimenKind, WellNote};
use serde_json::Value;

/// Where a value is.
#[derive(Clone, Copy)]
pub enum Source {
    /// `measurement.json`, by JSON pointer.
    Measured(&'static str),
    /// `recording.json`, by JSON pointer.
    Recorded(&'static str),
    /// `timings.json`, by JSON pointer.
    Timed(&'static str),
    /// A key of a check, by the name of the check.
    Check(&'static str, &'static str),
    /// A key of the place among reference larvae, by the quantity.
    Reference(&'static str, &'static str),
    /// The run, the same for all its wells. It may change while the run goes on.
    Run(fn(&RunRecord) -> Cell),
    /// Anything else.
    Made(fn(&Row) -> Cell),
}

/// One column.
pub struct Column {
    pub name: &'static str,
    pub kind: Kind,
    pub source: Source,
    pub meaning: &'static str,
}

use Kind::{Integer, Number, Text, Truth};
use Source::{Check, Made, Measured, Recorded, Reference, Run, Timed};

const fn col(name: &'static str, kind: Kind, source: Source, meaning: &'static str) -> Column {
    Column { name, kind, source, meaning }
}

/// The unit of a number, by the end of its name. The longer endings come first.
const UNITS: &[(&str, &str)] = &[
    ("_grey_px_per_nl", "grey levels px/nl"),
    ("_grey_px", "grey levels px"),
    ("_per_um", "1/um"),
    ("_per_mm", "1/mm"),
    ("_um3", "um^3"),
    ("_um2", "um^2"),
    ("_um", "um"),
    ("_px", "px"),
    ("_deg", "deg"),
    ("_percent", "%"),
    ("_percentile", "%"),
    ("_share", "share"),
    ("_s", "s"),
];

impl Column {
    /// The unit of a number. `None` for a number without a unit, and for what is no decimal number.
    pub fn unit(&self) -> Option<&'static str> {
        let known = || UNITS.iter().find(|(end, _)| self.name.ends_with(end)).map(|(_, unit)| *unit);
        if self.kind == Number { known() } else { None }
    }

    /// The value of a run. `None` for a column of specimens.
    pub(crate) fn of_run(&self, run: &RunRecord) -> Option<Cell> {
        if let Run(make) = self.source { Some(make(run)) } else { None }
    }

    /// The value in a row.
    pub fn cell(&self, row: &Row) -> Cell {
        let value = match self.source {
            Measured(pointer) => row.measured(pointer),
            Recorded(pointer) => row.recorded(pointer),
            Timed(pointer) => row.well.timings.as_ref().and_then(|timings| timings.pointer(pointer)),
            Check(name, key) => row.check(name).and_then(|check| check.get(key)),
            Reference(quantity, key) => row.reference(quantity, key),
            Run(make) => return make(row.run.record),
            Made(make) => return make(row),
        };
        Cell::of_json(self.kind, value)
    }
}

/// Columns before those of the lab's own metadata: what and where the specimen is.
pub const BEFORE: &[Column] = &[
    col("run", Text, Run(|r| r.id.as_str().into()), "name of the run"),
    col("external_id", Text, Run(|r| r.plan.external_id.clone().into()), "the run's name in another system"),
    col("plate_barcode", Text, Run(|r| r.plan.plate_barcode.as_str().into()), "barcode of the plate"),
    col("operator", Text, Run(|r| r.plan.operator.as_str().into()), "who started the run"),
    col("mode", Text, Run(|r| mode(r.mode).into()), "`hardware`, `simulated` or `imported`: where the frames come from"),
    col("instrument", Text, Made(instrument), "name of the instrument in its configuration"),
    col("instrument_serial", Text, Run(|r| identity(r).and_then(|i| i.serial.clone()).into()), "serial number of the instrument"),
    col("instrument_location", Text, Run(|r| identity(r).and_then(|i| i.location.clone()).into()), "where the instrument stands"),
    col(
        "instrument_uuid",
        Text,
        Run(|r| identity(r).map(|i| i.uuid.as_str()).into()),
        "uuid of the instrument; it stays the same when the name changes",
    ),
    col("well", Text, Made(|r| r.well.planned.well.as_str().into()), "`A01` to `AF48`"),
    col("plate_row", Text, Made(|r| parted(r).map(|(row, _)| row).into()), "letters of the well"),
    col("plate_column", Integer, Made(|r| parted(r).and_then(|(_, column)| column.parse::<u32>().ok()).into()), "number of the well"),
    col("place", Integer, Made(|r| r.place.into()), "place in the order of the plan, from 1"),
    col("specimen", Text, Made(|r| specimen(r.well.planned.specimen).into()), "`larva` or `bead`"),
    col("dpf", Number, Made(|r| r.well.planned.dpf.into()), "days post fertilisation"),
    col("strain", Text, Made(|r| r.well.planned.strain.clone().into()), "strain"),
    col("treatment", Text, Made(|r| r.well.planned.treatment.clone().into()), "treatment"),
    col("compound", Text, Made(|r| r.well.planned.compound.clone().into()), "compound"),
    col("concentration", Number, Made(|r| r.well.planned.concentration.into()), "concentration, in the unit of the next column"),
    col(
        "concentration_unit",
        Text,
        Made(|r| r.well.planned.concentration_unit.map(carved_records::ConcentrationUnit::symbol).into()),
        "unit as the plate map has it",
    ),
    col("control", Text, Made(control), "`positive`, `negative`, or empty for no control"),
    col("replicate", Integer, Made(|r| r.well.planned.replicate.into()), "number of the repetition, from 1"),
    col("taxon_id", Text, Made(|r| of_animal(r, ontology::taxon)), "of a larva that is not simulated: its species in the NCBI Taxonomy"),
    col(
        "stage_id",
        Text,
        Made(|r| of_animal(r, ontology::stage)),
        "of a larva from 2 to 29 dpf that is not simulated: its stage in the Zebrafish Developmental Stages Ontology (ZFS), from `dpf`",
    ),
    col(
        "exposure_id",
        Text,
        Made(|r| of_animal(r, ontology::exposure)),
        "of a larva with a compound that is neither simulated nor a negative control, whose compound is the vehicle: chemical treatment, in the Zebrafish Experimental Conditions Ontology (ZECO)",
    ),
];

/// The eyes that were found in a larva.
fn eyes<'a>(row: &'a Row<'a>) -> Option<&'a Vec<Value>> {
    row.measured("/eyes/eyes").and_then(Value::as_array)
}

/// A number of the eye on one side.
fn eye(row: &Row, side: &str, key: &str) -> Cell {
    let found = eyes(row).and_then(|eyes| eyes.iter().find(|eye| eye["side"] == side));
    Cell::of_json(Number, found.and_then(|eye| eye.get(key)))
}

/// The instrument of the run. Runs of earlier versions and imported runs have none.
fn identity(run: &RunRecord) -> Option<&InstrumentIdentity> {
    run.instrument.as_ref()
}

/// The name of the instrument. Recordings of earlier versions have it as the name of the rig.
fn instrument(row: &Row) -> Cell {
    let recorded = || row.recorded("/rig/name").and_then(serde_json::Value::as_str);
    identity(row.run.record).map(|i| i.name.as_str()).or_else(recorded).into()
}

/// Row and column of the well: a name ends in two digits.
fn parted<'r>(row: &Row<'r>) -> Option<(&'r str, &'r str)> {
    let well = row.well.planned.well.as_str();
    well.split_at_checked(well.len().checked_sub(2)?)
}

pub fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::Hardware => "hardware",
        Mode::Simulated => "simulated",
        Mode::Imported => "imported",
    }
}

fn specimen(kind: SpecimenKind) -> &'static str {
    match kind {
        SpecimenKind::Larva => "larva",
        SpecimenKind::Bead => "bead",
    }
}

/// A term of a living larva. A simulated one has none.
fn of_animal(row: &Row, term: fn(&PlannedWell) -> Option<ontology::Term>) -> Cell {
    let is_simulated = row.run.record.mode == Mode::Simulated;
    term(&row.well.planned).filter(|_| !is_simulated).map(|term| term.id).into()
}

fn control(row: &Row) -> Cell {
    use carved_records::Control::{Negative, Positive};
    Cell::from(row.well.planned.control.map(|control| match control {
        Positive => "positive",
        Negative => "negative",
    }))
}

fn word<T: serde::Serialize>(value: &T) -> Cell {
    let word = serde_json::to_value(value).ok();
    Cell::from(word.as_ref().and_then(serde_json::Value::as_str))
}

fn outcome(row: &Row) -> Cell {
    row.well.status.as_ref().map_or(Cell::Empty, |status| word(&status.outcome))
}

/// The flags of the record, which also has those of the bead check; of a well without an entry those of the numbers.
fn flags<'r>(row: &'r Row) -> &'r [StoredFlag] {
    row.well.status.as_ref().map(|status| status.flags.as_slice()).unwrap_or_default()
}

/// Empty where nothing could be flagged.
fn flag_count(row: &Row) -> Cell {
    let count = flags(row).len();
    (count > 0 || row.well.measurement.is_some()).then_some(count).into()
}

/// The newest remark of a person on the well.
fn noted<'r>(row: &'r Row) -> Option<&'r WellNote> {
    row.well.status.as_ref()?.note.as_deref()
}

/// The reason of a row whose numbers are not in the folder of a later computation.
pub const NOT_MEASURED_AGAIN: &str = "not_measured_again";

/// The estimator of the shape in the JSON of a `measurement.json`: `field` too where an earlier version wrote no name. `None` without a
/// shape.
pub fn shape_estimator(measurement: &Value) -> Option<&str> {
    let shape = measurement.get("shape")?.as_object()?;
    Some(shape.get("estimator").and_then(Value::as_str).unwrap_or(Estimator::Field.name()))
}

fn reason(row: &Row) -> Cell {
    match &row.well.computation {
        Computation::Missing => return NOT_MEASURED_AGAIN.into(),
        Computation::Unreadable(why) => return Cell::from(why.as_str()),
        Computation::OfRun | Computation::Later { .. } => {}
    }
    row.well.status.as_ref().and_then(|status| status.reason.clone()).into()
}

/// Columns behind those of the lab's own metadata: what was found, how, and by what.
pub const AFTER: &[Column] = &[
    col("outcome", Text, Made(outcome), "`succeeded`, `failed`, `skipped`, `aborted`, `interrupted`; empty while the well is not done"),
    col(
        "reason",
        Text,
        Made(reason),
        "why there are no numbers; `not_measured_again`: none in the folder of `--measurements`; of a file that was altered or cannot be read: its name and what is wrong",
    ),
    col("flags", Text, Made(|r| StoredFlag::joined(flags(r), ";").into()), "flags, joined by `;`: [quality.md](quality.md)"),
    col("flag_count", Integer, Made(flag_count), "number of flags; 0 for a specimen without a doubt, empty for one without numbers"),
    col(
        "excluded",
        Truth,
        Made(|r| noted(r).map_or(Cell::Empty, |note| Cell::Truth(note.excluded))),
        "whether a person has left the well out of statistics; empty without a remark",
    ),
    col("noted_by", Text, Made(|r| noted(r).map(|note| note.by.as_str()).into()), "who wrote the newest remark on the well"),
    col("comment", Text, Made(|r| noted(r).map(|note| note.comment.as_str()).into()), "the remark: the reason of an exclusion"),
    col("tags", Text, Made(|r| noted(r).map(|note| note.tags.join(";")).into()), "tags of the remark, joined by `;`"),
    col("earlier_attempts", Integer, Made(|r| r.well.earlier_attempts.into()), "attempts at this well before the one of this row"),
    // Numbers of the trusted estimator.
    col("estimator", Text, Measured("/measurement/estimator"), "`support` or `voxel`: what `volume_um3` and `area_um2` come from"),
    col("estimator_fallback", Text, Measured("/measurement/fallback"), "why the estimator is not `support`"),
    col("volume_um3", Number, Measured("/measurement/volume_um3"), "volume"),
    col(
        "volume_sd_um3",
        Number,
        Measured("/measurement/volume_sd_um3"),
        "standard deviation of `volume_um3`: the root of the sum of the squares of its parts, without the differences between larvae",
    ),
    col("area_um2", Number, Measured("/measurement/area_um2"), "surface area"),
    col(
        "area_sd_um2",
        Number,
        Measured("/measurement/area_sd_um2"),
        "standard deviation of `area_um2`: the root of the sum of the squares of its parts, without the differences between larvae",
    ),
    col(
        "shape_estimator",
        Text,
        Made(|r| r.well.measurement.as_ref().and_then(shape_estimator).into()),
        "`field`: what all numbers of the shape, the slices, `mesh.ply` and `model.glb` come from, and `body_length_um` up to the ends of this surface; its volume is \
         `field_volume_um3`",
    ),
    col(
        "body_length_um",
        Number,
        Measured("/shape/body/length_um"),
        "length along the bent body axis; of a turn to the ends of its silhouettes",
    ),
    col(
        "body_axis_rms_um",
        Number,
        Measured("/shape/body/axis_rms_um"),
        "distance of the slices' centres from this axis (root mean square)",
    ),
    col("extent_along_um", Number, Measured("/measurement/length_um"), "extent along the capillary; of a turn that of its silhouettes"),
    col("diameter_um", Number, Measured("/measurement/diameter_um"), "of a bead: diameter of the fitted sphere"),
    col(
        "sphere_rms_um",
        Number,
        Measured("/measurement/sphere_rms_um"),
        "of a bead: distance of the surface from the sphere (root mean square)",
    ),
    col("aspect_ratio", Number, Measured("/measurement/aspect_ratio"), "of a bead: extent along the capillary over the extent across"),
    // Shape.
    col("sphericity", Number, Measured("/shape/solid/sphericity"), "area of the ball of the same volume over the area; 1 for a ball"),
    col("surface_per_volume_per_um", Number, Measured("/shape/solid/surface_per_volume_per_um"), "area over volume of the mesh"),
    col(
        "bending_total_deg",
        Number,
        Measured("/shape/body/bending/total_deg"),
        "sum of the bends along the body axis; 0 for a straight body",
    ),
    col("max_curvature_per_mm", Number, Measured("/shape/body/bending/max_curvature_per_mm"), "largest curvature of the body axis"),
    col("end_to_end_share", Number, Measured("/shape/body/bending/end_to_end_share"), "straight distance of the ends over the length"),
    col("head_end", Text, Measured("/shape/body/head/end"), "`left` or `right`: the end of the picture where the head is"),
    col("head_confidence", Number, Measured("/shape/body/head/confidence"), "0 to 1"),
    col("dorsal_confidence", Number, Measured("/shape/body/dorsal/confidence"), "0 to 1: how well the back is known"),
    // Eyes.
    col(
        "eyes_found",
        Integer,
        Made(|r| eyes(r).map(|eyes| eyes.len() as u32).into()),
        "of a larva: number of eyes that were found, 0 to 2",
    ),
    col("eyes_reason", Text, Measured("/eyes/reason"), "why fewer than two were found; docs/organs.md has the reasons"),
    col("eye_volume_um3", Number, Measured("/eyes/mean_volume_um3"), "mean volume of both eyes; empty without two eyes"),
    col("eye_volume_sd_um3", Number, Measured("/eyes/mean_volume_sd_um3"), "standard deviation of `eye_volume_um3`"),
    col(
        "eye_left_volume_um3",
        Number,
        Made(|r| eye(r, "left", "volume_um3")),
        "volume of the larva's left eye; empty where the side is not known",
    ),
    col("eye_left_volume_sd_um3", Number, Made(|r| eye(r, "left", "volume_sd_um3")), "standard deviation of `eye_left_volume_um3`"),
    col(
        "eye_right_volume_um3",
        Number,
        Made(|r| eye(r, "right", "volume_um3")),
        "volume of the larva's right eye; empty where the side is not known",
    ),
    col("eye_right_volume_sd_um3", Number, Made(|r| eye(r, "right", "volume_sd_um3")), "standard deviation of `eye_right_volume_um3`"),
    col("eye_distance_um", Number, Measured("/eyes/distance_um"), "distance between the centres of the eyes"),
    col("eye_distance_sd_um", Number, Measured("/eyes/distance_sd_um"), "standard deviation of `eye_distance_um`"),
    col(
        "eye_axis_angle_deg",
        Number,
        Measured("/eyes/axis_angle_deg"),
        "angle between the line from eye to eye and the body axis at the head; 90 for a straight head",
    ),
    // Swim bladder.
    col("bladder_state", Text, Measured("/bladder/state"), "of a larva: `inflated`, `not_inflated` (or missing) or `undecided`"),
    col("bladder_probability", Number, Measured("/bladder/probability"), "0 to 1: that the swim bladder has gas"),
    col("bladder_reason", Text, Measured("/bladder/reason"), "why there is no volume; docs/organs.md has the reasons"),
    col(
        "bladder_lobes",
        Integer,
        Made(|r| r.measured("/bladder/lobes").and_then(Value::as_array).map(|lobes| lobes.len() as u32).into()),
        "number of lobes with gas",
    ),
    col("bladder_volume_um3", Number, Measured("/bladder/volume_um3"), "volume of the gas; empty where none was found"),
    col("bladder_volume_sd_um3", Number, Measured("/bladder/volume_sd_um3"), "standard deviation of `bladder_volume_um3`"),
    col("bladder_length_um", Number, Measured("/bladder/length_um"), "extent of the gas along the body"),
    col("bladder_length_sd_um", Number, Measured("/bladder/length_sd_um"), "standard deviation of `bladder_length_um`"),
    col("bladder_along_um", Number, Measured("/bladder/along_um"), "place of its middle along the body axis, from the snout"),
    col("bladder_along_sd_um", Number, Measured("/bladder/along_sd_um"), "standard deviation of `bladder_along_um`"),
    col(
        "bladder_behind_eyes_um",
        Number,
        Measured("/bladder/behind_eyes_um"),
        "distance of its middle from that of the eyes, along the body",
    ),
    col("bladder_behind_eyes_sd_um", Number, Measured("/bladder/behind_eyes_sd_um"), "standard deviation of `bladder_behind_eyes_um`"),
    col("bladder_above_axis_um", Number, Measured("/bladder/above_axis_um"), "distance of its middle from the body axis, towards the back"),
    col("bladder_above_axis_sd_um", Number, Measured("/bladder/above_axis_sd_um"), "standard deviation of `bladder_above_axis_um`"),
    // Every estimator, and the parts of the standard deviations.
    col("support_volume_um3", Number, Measured("/measurement/estimators/support/volume_um3"), "volume by support functions"),
    col(
        "support_volume_sd_um3",
        Number,
        Measured("/measurement/estimators/support/volume_sd_um3"),
        "its standard deviation if the same specimen were turned again",
    ),
    col("support_area_um2", Number, Measured("/measurement/estimators/support/area_um2"), "area by support functions"),
    col(
        "support_area_sd_um2",
        Number,
        Measured("/measurement/estimators/support/area_sd_um2"),
        "its standard deviation if the same specimen were turned again",
    ),
    col("voxel_volume_um3", Number, Measured("/measurement/estimators/voxel/volume_um3"), "volume by the paper's method"),
    col("voxel_area_um2", Number, Measured("/measurement/estimators/voxel/area_um2"), "area by the paper's method"),
    col("field_volume_um3", Number, Measured("/measurement/field_volume_um3"), "volume inside the surface that is shown"),
    col("field_area_um2", Number, Measured("/measurement/field_area_um2"), "area of the surface that is shown"),
    col(
        "volume_sd_views_um3",
        Number,
        Measured("/measurement/spread/volume_views_um3"),
        "part of `volume_sd_um3`: what another turn of the same specimen would change",
    ),
    col(
        "volume_sd_calibration_um3",
        Number,
        Measured("/measurement/spread/volume_calibration_um3"),
        "part of `volume_sd_um3`: calibration",
    ),
    col("volume_sd_corners_um3", Number, Measured("/measurement/spread/volume_corners_um3"), "part of `volume_sd_um3`: corners of fins"),
    col("volume_sd_fins_um3", Number, Measured("/measurement/spread/volume_fins_um3"), "part of `volume_sd_um3`: fins"),
    col(
        "volume_sd_scale_um3",
        Number,
        Measured("/measurement/spread/volume_scale_um3"),
        "part of `volume_sd_um3`: scale of the rig, 0 if its error is not stated",
    ),
    col(
        "volume_sd_edge_um3",
        Number,
        Measured("/measurement/spread/volume_edge_um3"),
        "part of `volume_sd_um3`: all edges too far out or in",
    ),
    col("volume_fins_unseen_um3", Number, Measured("/measurement/spread/volume_fins_unseen_um3"), "what fins that no view shows may add"),
    col(
        "area_sd_views_um2",
        Number,
        Measured("/measurement/spread/area_views_um2"),
        "part of `area_sd_um2`: what another turn of the same specimen would change",
    ),
    col("area_sd_calibration_um2", Number, Measured("/measurement/spread/area_calibration_um2"), "part of `area_sd_um2`: calibration"),
    col("area_sd_corners_um2", Number, Measured("/measurement/spread/area_corners_um2"), "part of `area_sd_um2`: corners of fins"),
    col("area_sd_fins_um2", Number, Measured("/measurement/spread/area_fins_um2"), "part of `area_sd_um2`: fins"),
    col(
        "area_sd_scale_um2",
        Number,
        Measured("/measurement/spread/area_scale_um2"),
        "part of `area_sd_um2`: scale of the rig, 0 if its error is not stated",
    ),
    col("area_sd_edge_um2", Number, Measured("/measurement/spread/area_edge_um2"), "part of `area_sd_um2`: all edges too far out or in"),
    // Second camera.
    col("signal_grey_px", Number, Measured("/fluorescence/signal"), "light inside the model in the second camera, grey levels times px"),
    col("signal_sd_grey_px", Number, Measured("/fluorescence/signal_sd"), "standard deviation of `signal_grey_px` between the views"),
    col("signal_grey_px_per_nl", Number, Measured("/fluorescence/signal_per_nl"), "that light over the volume"),
    col("signal_sd_grey_px_per_nl", Number, Measured("/fluorescence/signal_per_nl_sd"), "standard deviation of `signal_grey_px_per_nl`"),
    // Reference larvae.
    col("reference_volume_z", Number, Reference("volume", "z"), "standard deviations above the mean of the reference larvae"),
    col("reference_volume_percentile", Number, Reference("volume", "percentile"), "share of the reference larvae that are smaller, %"),
    col("reference_volume_n", Integer, Reference("volume", "n"), "reference larvae"),
    col("reference_volume_group", Text, Reference("volume", "group"), "group of reference larvae: [references.md](references.md)"),
    col("reference_volume_estimator", Text, Made(|r| r.reference_estimator("volume")), "estimator that is compared"),
    col("reference_volume_mismatches", Text, Made(|r| r.reference_mismatches("volume")), "what does not match, joined by `;`"),
    col("reference_area_z", Number, Reference("area", "z"), "the same of the area"),
    col("reference_area_percentile", Number, Reference("area", "percentile"), "%"),
    col("reference_area_n", Integer, Reference("area", "n"), "reference larvae"),
    col("reference_area_group", Text, Reference("area", "group"), "group of reference larvae"),
    col("reference_area_estimator", Text, Made(|r| r.reference_estimator("area")), "estimator that is compared"),
    col("reference_area_mismatches", Text, Made(|r| r.reference_mismatches("area")), "what does not match, joined by `;`"),
    col("reference_eye_volume_z", Number, Reference("eye_volume", "z"), "the same of `eye_volume_um3`, where the references have eyes"),
    col("reference_eye_volume_percentile", Number, Reference("eye_volume", "percentile"), "%"),
    col("reference_eye_volume_n", Integer, Reference("eye_volume", "n"), "reference larvae"),
    col("reference_eye_volume_group", Text, Reference("eye_volume", "group"), "group of reference larvae"),
    col("reference_eye_volume_mismatches", Text, Made(|r| r.reference_mismatches("eye_volume")), "what does not match, joined by `;`"),
    col("reference_eye_distance_z", Number, Reference("eye_distance", "z"), "the same of `eye_distance_um`"),
    col("reference_eye_distance_percentile", Number, Reference("eye_distance", "percentile"), "%"),
    col("reference_eye_distance_n", Integer, Reference("eye_distance", "n"), "reference larvae"),
    col("reference_eye_distance_group", Text, Reference("eye_distance", "group"), "group of reference larvae"),
    col("reference_eye_distance_mismatches", Text, Made(|r| r.reference_mismatches("eye_distance")), "what does not match, joined by `;`"),
    // Quality.
    col("qc_passed", Truth, Measured("/quality/passed"), "whether no check is over its limit: [quality.md](quality.md)"),
    col("qc_closure_overlap_share", Number, Check("closure_overlap", "found"), "overlap of the profiles at 0 and 360 deg"),
    col("qc_closure_along_px", Number, Check("closure_along_px", "found"), "shift along the capillary at 360 deg"),
    col("qc_closure_along_sd_px", Number, Check("closure_along_px", "sd"), "standard deviation of it"),
    col("qc_closure_across_px", Number, Check("closure_across_px", "found"), "shift across the capillary at 360 deg"),
    col("qc_closure_across_sd_px", Number, Check("closure_across_px", "sd"), "standard deviation of it"),
    col("qc_closure_turn_deg", Number, Check("closure_turn_deg", "found"), "turn about the capillary at 360 deg"),
    col("qc_closure_turn_sd_deg", Number, Check("closure_turn_deg", "sd"), "standard deviation of it"),
    col("qc_views", Number, Check("views_least", "found"), "views that count"),
    col("qc_usable_percent", Number, Check("usable_percent", "found"), "views that count, of those planned"),
    col("qc_gap_deg", Number, Check("gap_deg", "found"), "widest gap between views that count"),
    col("qc_residual_px", Number, Check("residual_px", "found"), "residual of the median view"),
    col("qc_residual_view_px", Number, Check("residual_view_px", "found"), "residual of the worst view"),
    col("qc_scatter_px", Number, Check("scatter_px", "found"), "distance of the edges from the outlines of the slices"),
    col("qc_overlap_percent", Number, Check("overlap_percent", "found"), "least overlap of a view with the hull that no view misses"),
    col(
        "qc_volume_sd_percent",
        Number,
        Check("volume_sd_percent", "found"),
        "standard deviation of the volume: views, calibration, corners, fins",
    ),
    col("qc_uy_px", Number, Check("uy_px", "found"), "axis of the turn less that of the rig"),
    col("qc_gamma_deg", Number, Check("gamma_deg", "found"), "tilt of the axis in the picture less that of the rig"),
    col("qc_alpha_deg", Number, Check("alpha_deg", "found"), "tilt of the axis in depth less that of the rig"),
    col("qc_rho_percent", Number, Check("rho_percent", "found"), "turned angle off the ledger's"),
    // How and when.
    col("views", Integer, Measured("/measurement/views"), "views that carved"),
    col("views_planned", Integer, Recorded("/method/asd"), "views per turn by the method (ASD)"),
    col("views_retaken", Integer, Made(|r| r.retaken().into()), "views that were taken again"),
    col("views_of_early_end", Integer, Recorded("/ended_after_views"), "views after which the method ended the turn early"),
    col("voxel_um", Number, Measured("/measurement/voxel_size_um"), "edge of a voxel (SD)"),
    col("epsilon", Number, Measured("/measurement/epsilon"), "share of views that may miss a voxel"),
    col("started", Text, Recorded("/started"), "when the recording began, RFC 3339, UTC"),
    col("run_started", Text, Run(|r| r.started.as_str().into()), "when the run began"),
    col("run_ended", Text, Run(|r| r.ended.clone().into()), "when the run ended; empty while it is going on"),
    col("run_outcome", Text, Run(|r| word(&r.outcome)), "outcome of the run"),
    col("turn_s", Number, Timed("/phases_s/revolve"), "time of the turn"),
    col("devices_s", Number, Timed("/devices_s"), "time of motors, exposures and of loading and unloading"),
    col("own_s", Number, Timed("/own_s"), "time of carved itself"),
    // By what.
    col("rotation_identity", Text, Recorded("/rig/rotation_identity"), "what the rotation axis reports"),
    col("camera_identity", Text, Recorded("/rig/camera_identity"), "what the camera reports"),
    col(
        "software_version",
        Text,
        Recorded("/software/version"),
        "version of carved that recorded, or that measured again (`--measurements`)",
    ),
    col("software_commit", Text, Recorded("/software/commit"), "commit of its sources; `unknown` where it was not known"),
    col("software_dirty", Truth, Recorded("/software/dirty"), "whether its sources had changes that were not committed"),
    col("method", Text, Made(method_name), "name of the method"),
    col("method_version", Text, Recorded("/method/version"), "version of the method, if the lab gave one"),
    col("method_sha256", Text, Made(method_sha256), "SHA-256 of the method's settings: compact JSON with sorted keys"),
    col(
        "measurement_sha256",
        Text,
        Made(|r| r.well.measurement_sha256.clone().into()),
        "SHA-256 of `measurement.json`, as in `SHA256SUMS`",
    ),
    // What is known of a simulated specimen.
    col("truth_volume_um3", Number, Recorded("/truth/volume_um3"), "of a simulated specimen: its true volume"),
    col("truth_area_um2", Number, Recorded("/truth/area_um2"), "of a simulated specimen: its true area"),
    col("truth_hull_volume_um3", Number, Recorded("/truth/hull_volume_um3"), "of a simulated specimen: volume of its ideal visual hull"),
    col("truth_hull_area_um2", Number, Recorded("/truth/hull_area_um2"), "of a simulated specimen: area of its ideal visual hull"),
    col("truth_length_um", Number, Recorded("/truth/length_um"), "of a simulated specimen: its true extent along the capillary"),
    col("truth_diameter_um", Number, Recorded("/truth/diameter_um"), "of a simulated bead: its true diameter"),
];

fn method_name(row: &Row) -> Cell {
    match &row.well.computation {
        Computation::Later { method_name: Some(name) } => name.as_str().into(),
        Computation::OfRun | Computation::Later { method_name: None } => row.run.record.plan.method.as_str().into(),
        Computation::Missing | Computation::Unreadable(_) => Cell::Empty,
    }
}

/// The hash of the method as the recording has it: a run read by a newer carved has further settings in its method.
fn method_sha256(row: &Row) -> Cell {
    if row.well.computation.is_left_out() {
        return Cell::Empty;
    }
    row.recorded("/method").map_or_else(|| row.run.method_sha256.clone(), hash_of).into()
}

/// The columns as a table of Markdown, for the reference page.
pub fn page() -> String {
    let line = |c: &Column| {
        let unit = c.unit().map(|unit| format!(", {unit}")).unwrap_or_default();
        format!("| `{}` | {}{unit} | {} |\n", c.name, c.kind.name(), c.meaning)
    };
    let own = "| `meta_...` | text | one column for each column of the plate map that carved does not read |\n".to_owned();
    let lines: String = BEFORE.iter().map(line).chain([own]).chain(AFTER.iter().map(line)).collect();
    format!("| column | holds | meaning |\n|---|---|---|\n{lines}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_column_has_a_name_of_its_own() {
        // The index has those of the lab's own as `metadata`.
        let mut seen = BTreeSet::from(["metadata"]);
        for column in BEFORE.iter().chain(AFTER) {
            assert!(seen.insert(column.name), "{} is there twice", column.name);
            assert!(!column.name.starts_with("meta_"), "{} could be a column of the lab's own", column.name);
        }
    }
}
