//! MIHCSME metadata of a run with its results: the JSON of the Python package mihcsme-py, which makes a spreadsheet of it and attaches it to
//! OMERO.
//!
//! ```text
//!  run.json: metadata ── investigation, study, assay ── unchanged, under the names of the Python model
//!            plate map ─┐
//!  table of specimens ──┴─ assay_conditions: per well {Compound, Dose, ..., carved_volume_um3, ...}
//! ```

use super::{csv, ontology, specimens};
use carved_records::plate_map::kept_columns;
use carved_records::{Metadata, Mode, PlannedWell, SpecimenKind};
use carved_store::StoredRun;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;

/// Before the names of the results, so that they are told apart from what the laboratory says.
const PREFIX: &str = "carved_";

/// The columns of the table of specimens that become conditions.
const RESULTS: [&str; 28] = [
    "run",
    "mode",
    "outcome",
    "reason",
    "flags",
    "flag_count",
    "estimator",
    "volume_um3",
    "volume_sd_um3",
    "area_um2",
    "area_sd_um2",
    "body_length_um",
    "shape_estimator",
    "eye_volume_um3",
    "eye_volume_sd_um3",
    "bladder_state",
    "bladder_volume_um3",
    "bladder_volume_sd_um3",
    "diameter_um",
    "taxon_id",
    "stage_id",
    "exposure_id",
    "software_version",
    "software_commit",
    "software_dirty",
    "method",
    "method_sha256",
    "measurement_sha256",
];

/// A part of the metadata: its name in the spreadsheet and in the model, and those of its groups.
type Part = (&'static str, &'static str, &'static [(&'static str, &'static str)]);

const PARTS: [Part; 3] = [
    (
        "InvestigationInformation",
        "investigation_information",
        &[("DataOwner", "data_owner"), ("DataCollaborator", "data_collaborators"), ("InvestigationInfo", "investigation_info")],
    ),
    (
        "StudyInformation",
        "study_information",
        &[("Study", "study"), ("Biosample", "biosample"), ("Library", "library"), ("Protocols", "protocols"), ("Plate", "plate")],
    ),
    (
        "AssayInformation",
        "assay_information",
        &[
            ("Assay", "assay"),
            ("AssayComponent", "assay_component"),
            ("Biosample", "biosample"),
            ("ImageData", "image_data"),
            ("ImageAcquisition", "image_acquisition"),
            ("Specimen", "specimen"),
        ],
    ),
];

/// The metadata of a run. A well with a file that cannot be read, or was altered, has no results.
pub fn metadata(run: &StoredRun) -> Value {
    let plan = &run.record().plan;
    let mut document = Map::new();
    for (sheet, field, groups) in PARTS {
        document.insert(field.into(), part(&plan.metadata, sheet, field, groups));
    }
    let larvae = plan.plate_map.iter().any(|well| well.specimen == SpecimenKind::Larva);
    if larvae && run.record().mode != Mode::Simulated {
        name_the_species(&mut document["study_information"]);
    }
    document.insert("assay_conditions".into(), conditions(run).into());
    if let Some(sheets) = plan.metadata.get("reference_sheets") {
        document.insert("reference_sheets".into(), sheets.clone());
    }
    document.into()
}

/// A part as the model has it. A document with the spreadsheet's names is renamed. The keys inside a group are read under both names.
fn part(metadata: &Metadata, sheet: &str, field: &str, groups: &[(&str, &str)]) -> Value {
    if let Some(there) = metadata.get(field) {
        return there.clone();
    }
    let found = metadata.get(sheet).and_then(Value::as_object);
    let renamed = found.into_iter().flatten().map(|(group, values)| match groups.iter().find(|(name, _)| name == group) {
        Some((_, "data_collaborators")) => ("data_collaborators".to_owned(), collaborators(values)),
        Some((_, "specimen")) => ("specimen".to_owned(), channels(values)),
        Some((_, name)) => ((*name).to_owned(), values.clone()),
        None => (group.clone(), values.clone()),
    });
    Value::Object(renamed.collect())
}

/// The spreadsheet numbers its collaborators; the model has a list.
fn collaborators(values: &Value) -> Value {
    values.as_object().into_iter().flatten().map(|(_, orcid)| json!({ "orcid": orcid })).collect()
}

/// The spreadsheet has a key per channel and property, as in `Channel 1 entity`; the model has a list.
fn channels(values: &Value) -> Value {
    let of = |number: usize| {
        let keys = [("visualization_method", "visualization method"), ("entity", "entity"), ("label", "label"), ("id", "id")];
        let found =
            keys.iter().filter_map(|(key, words)| Some(((*key).to_owned(), values.get(format!("Channel {number} {words}"))?.clone())));
        found.collect::<Map<_, _>>()
    };
    let channels: Vec<Value> = (1..=8).map(of).filter(|channel| !channel.is_empty()).map(Value::Object).collect();
    json!({ "channel_transmission_id": values.get("Channel Transmission id"), "channels": channels })
}

/// Names the species where the laboratory has not.
fn name_the_species(study: &mut Value) {
    let Some(study) = study.as_object_mut() else { return };
    let sample = study.entry("biosample").or_insert(Value::Null);
    if sample.is_null() {
        *sample = json!({});
    }
    let Some(sample) = sample.as_object_mut() else { return };
    let keys = [
        ("biosample_taxon", "Biosample Taxon", ontology::ZEBRAFISH.id),
        ("biosample_organism", "Biosample Organism", ontology::ZEBRAFISH.name),
    ];
    for (field, alias, value) in keys {
        let is_said = [field, alias].iter().any(|key| sample.get(*key).is_some_and(|value| !value.is_null()));
        if !is_said {
            sample.insert(field.into(), value.into());
        }
    }
}

/// The conditions of every planned well: those of the laboratory, then the results.
fn conditions(run: &StoredRun) -> Vec<Value> {
    let plan = &run.record().plan;
    let kept = kept_columns(&plan.metadata, &plan.plate_barcode);
    let table = specimens(std::slice::from_ref(run));
    let wanted: BTreeSet<&str> = RESULTS.into_iter().collect();
    let of = |(well, row): (&PlannedWell, &Vec<super::Cell>)| {
        let mut conditions = Map::new();
        for (heading, cells) in &kept {
            conditions.extend(cells.get(&well.well).map(|text| (heading.clone(), text.as_str().into())));
        }
        conditions.extend(planned(well).into_iter().filter_map(|(key, text)| Some((key.to_owned(), text?.into()))));
        for (heading, cell) in table.headings.iter().zip(row).filter(|(heading, _)| wanted.contains(heading.name.as_str())) {
            let key = format!("{PREFIX}{}", heading.name);
            let text = csv::cell(cell);
            // Results of an earlier export may stand among the laboratory's conditions.
            conditions.remove(&key);
            if !text.is_empty() {
                conditions.insert(key, text.into());
            }
        }
        json!({ "plate": plan.plate_barcode, "well": well.well, "conditions": conditions })
    };
    plan.plate_map.iter().zip(&table.rows).map(of).collect()
}

/// What the plate map says of a well, under the names that carved reads.
fn planned(well: &PlannedWell) -> [(&'static str, Option<String>); 9] {
    let word = |value: Option<Value>| value.as_ref().and_then(Value::as_str).map(str::to_owned);
    [
        ("Specimen", word(serde_json::to_value(well.specimen).ok())),
        ("DPF", well.dpf.map(|dpf| dpf.to_string())),
        ("Strain", well.strain.clone()),
        ("Treatment", well.treatment.clone()),
        ("Compound", well.compound.clone()),
        ("Dose", well.concentration.map(|dose| dose.to_string())),
        ("DoseUnit", well.concentration_unit.map(|unit| unit.symbol().to_owned())),
        ("ControlType", word(well.control.and_then(|control| serde_json::to_value(control).ok()))),
        ("Replicate", well.replicate.map(|replicate| replicate.to_string())),
    ]
}
