//! MIHCSME metadata (Minimum Information about a High Content Screening Microscopy Experiment) as JSON. It has either the names of the
//! spreadsheet's sheets or those of the Python model.
//!
//! ```text
//! {"InvestigationInformation": {group: {key: value}}, "StudyInformation": ..., "AssayInformation": ...,
//!  "AssayConditions": [{"Plate": "P1", "Well": "A01", "Compound": "DMSO", "Dose": "0.1", "DoseUnit": "%", ...}]}
//! {"investigation_information": ..., "assay_conditions": [{"plate": "P1", "well": "A01", "conditions": {"Compound": ...}}]}
//! ```
//! The whole document is stored as the run's metadata. Conditions that carved has a column for are also copied into the wells.

use super::cell::{Cell, Column, Row};
use super::number::Decimal;
use super::{Mistake, Place, Reading, json};
use crate::Metadata;
use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// The name of the list of wells, in the spreadsheet and in the model.
const LISTS: [&str; 2] = ["AssayConditions", "assay_conditions"];

pub fn is_one(document: &Map<String, Value>) -> bool {
    LISTS.iter().any(|name| document.contains_key(*name))
}

/// The conditions of a document that are of this plate, each with its well; all of them where the document has one plate.
pub fn conditions_of<'d>(document: &'d Metadata, plate: &str) -> Vec<&'d Map<String, Value>> {
    let lists = LISTS.iter().filter_map(|name| document.get(*name)?.as_array());
    let entries: Vec<_> = lists.flatten().filter_map(Value::as_object).collect();
    let plates: BTreeSet<&str> = entries.iter().filter_map(|entry| plate_of(entry)).collect();
    let several = plates.len() > 1;
    entries.into_iter().filter(|entry| !several || plate_of(entry) == Some(plate)).collect()
}

fn plate_of(entry: &Map<String, Value>) -> Option<&str> {
    entry.get("Plate").or_else(|| entry.get("plate")).and_then(Value::as_str).map(str::trim)
}

/// The column of a condition. MIHCSME does not define the names. Known are those of its template and of carved.
pub fn column_of(condition: &str) -> Option<Column> {
    let plain: String = condition.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_ascii_lowercase();
    Some(match plain.as_str() {
        "well" => Column::Well,
        "specimen" | "specimentype" => Column::Specimen,
        "compound" | "compoundname" => Column::Compound,
        "dose" | "concentration" => Column::Concentration,
        "doseunit" | "doseunits" | "concentrationunit" | "concentrationunits" => Column::ConcentrationUnit,
        "dpf" | "dayspostfertilisation" | "dayspostfertilization" => Column::Dpf,
        "strain" => Column::Strain,
        "treatment" => Column::Treatment,
        "control" | "controltype" => Column::Control,
        "replicate" => Column::Replicate,
        _ => return None,
    })
}

pub fn read(document: Metadata, plate: Option<&str>, reading: &mut Reading) {
    for name in LISTS {
        match document.get(name) {
            None => {}
            Some(Value::Array(entries)) => conditions(name, entries, plate, reading),
            Some(_) => reading.wrong(Mistake::at(format!("/{name}"), "expected a list with an object per well")),
        }
    }
    reading.map.metadata = document;
}

fn conditions(name: &str, entries: &[Value], plate: Option<&str>, reading: &mut Reading) {
    let plate_of = |entry: &Value| entry.get("Plate").or_else(|| entry.get("plate")).and_then(Value::as_str).map(|p| p.trim().to_owned());
    let plates: BTreeSet<String> = entries.iter().filter_map(plate_of).collect();
    // With one plate, its name does not matter. With several plates, the barcode must name one of them.
    let several = plates.len() > 1;
    if several && !plate.is_some_and(|p| plates.contains(p)) {
        let known = plates.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        let asked = plate.map_or_else(|| "none was chosen".to_owned(), |p| format!("{p:?} is none of them"));
        reading.wrong(Mistake::at(format!("/{name}"), format!("there are several plates, {known}, and {asked}")));
        return;
    }
    for (i, entry) in entries.iter().enumerate() {
        if several && plate_of(entry).as_deref() != plate {
            continue;
        }
        let at = format!("/{name}/{i}");
        let Value::Object(fields) = entry else {
            reading.wrong(Mistake::at(at, "expected an object with a well"));
            continue;
        };
        // The model has the conditions in a nested field. Pointers lead into it.
        let nested = fields.get("conditions").and_then(Value::as_object);
        let own = fields.iter().filter(|(key, _)| nested.is_none() || key.as_str() != "conditions").map(|(k, v)| (json::escape(k), k, v));
        let inner = nested.into_iter().flatten().map(|(k, v)| (format!("conditions/{}", json::escape(k)), k, v));
        let place = Place::Pointer(at);
        let mut cells: Vec<Cell> = Vec::new();
        for (path, key, value) in own.chain(inner) {
            let Some(column) = column_of(key) else { continue };
            match json::text_of(value) {
                Err(detail) => reading.wrong(place.mistake(&path, detail)),
                Ok(text) if text.is_empty() => {}
                Ok(_) if cells.iter().any(|c| c.column == column) => {
                    reading.wrong(place.mistake(&path, format!("{} is said twice", column.name())));
                }
                Ok(text) => cells.push(Cell { column, name: path, text }),
            }
        }
        unit_of_its_own(&mut cells);
        reading.row(&Row { place, decimal: Decimal::Point, cells });
    }
}

/// Splits a dose such as `0.1%` or `10 uM`, as in the template, into the number and its unit, unless there is a separate unit.
fn unit_of_its_own(cells: &mut Vec<Cell>) {
    if cells.iter().any(|c| c.column == Column::ConcentrationUnit) {
        return;
    }
    let Some(dose) = cells.iter_mut().find(|c| c.column == Column::Concentration && c.text.parse::<f64>().is_err()) else { return };
    let Some(end) = dose.text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | ','))).filter(|&end| end > 0) else { return };
    let unit = dose.text.split_off(end).trim().to_owned();
    let name = dose.name.clone();
    cells.push(Cell { column: Column::ConcentrationUnit, name, text: unit });
}
