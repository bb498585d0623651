//! What a lab says of single wells beside carved's own columns: cells of a CSV that carved does not read, and conditions of MIHCSME.

use super::mihcsme::{self, column_of};
use super::{json, well_of};
use crate::Metadata;
use serde_json::Value;
use std::collections::BTreeMap;

/// Cells by the heading of their column, then by well.
pub type KeptColumns = BTreeMap<String, BTreeMap<String, String>>;

/// The columns that the metadata of a run has of single wells. `plate` is the barcode of the run: a MIHCSME document may describe several
/// plates.
pub fn kept_columns(metadata: &Metadata, plate: &str) -> KeptColumns {
    let mut kept = KeptColumns::new();
    let mut keep = |heading: &str, well: &str, value: &Value| {
        if let Ok(text) = json::text_of(value)
            && !text.is_empty()
            && let Some(well) = well_of(well)
        {
            kept.entry(heading.trim().to_owned()).or_default().insert(well, text);
        }
    };
    for (heading, cells) in metadata.get("columns").and_then(Value::as_object).into_iter().flatten() {
        for (well, value) in cells.as_object().into_iter().flatten() {
            keep(heading, well, value);
        }
    }
    for entry in mihcsme::conditions_of(metadata, plate) {
        let text = |key: &str| entry.get(key).and_then(Value::as_str);
        let Some(well) = text("Well").or_else(|| text("well")) else { continue };
        let nested = entry.get("conditions").and_then(Value::as_object);
        for (heading, value) in entry.iter().chain(nested.into_iter().flatten()) {
            if column_of(heading).is_none() && !heading.eq_ignore_ascii_case("plate") {
                keep(heading, well, value);
            }
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn of(metadata: &Value, plate: &str) -> Value {
        serde_json::to_value(kept_columns(metadata.as_object().unwrap(), plate)).unwrap()
    }

    #[test]
    fn cells_of_a_csv_are_kept_by_heading_and_well() {
        let metadata = json!({"columns": {"batch": {"A01": "b1", "B02": "7"}, "empty": {"A01": " "}}, "project": {"a": 1}});
        assert_eq!(of(&metadata, "P-1"), json!({"batch": {"A01": "b1", "B02": "7"}}));
        assert_eq!(of(&json!({}), "P-1"), json!({}));
    }

    #[test]
    fn conditions_of_the_runs_own_plate_are_kept_unless_carved_reads_them() {
        let sheets = json!({"AssayConditions": [
            {"Plate": "P-1", "Well": "A1", "Compound": "DMSO", "Dose": "0.1", "Medium": "E3", "Passage": 3},
            {"Plate": "P-2", "Well": "A1", "Medium": "other"}]});
        assert_eq!(of(&sheets, "P-1"), json!({"Medium": {"A01": "E3"}, "Passage": {"A01": "3"}}));
        // The name of a single plate is the lab's own.
        let model = json!({"assay_conditions": [{"plate": "x", "well": "B02", "conditions": {"Strain": "AB", "Medium": "E3"}}]});
        assert_eq!(of(&model, "P-1"), json!({"Medium": {"B02": "E3"}}));
    }
}
