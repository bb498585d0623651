//! What the columns of one row are read from.

use super::Cell;
use carved_records::plate_map::KeptColumns;
use carved_records::sha256_hex;
use carved_store::{RunRecord, StoredWell, place_among_references};
use serde_json::Value;

/// What is the same in every row of a run.
pub struct OfRun<'r> {
    pub record: &'r RunRecord,
    /// Cells of the lab's own columns.
    pub kept: KeptColumns,
    /// SHA-256 of the run's method.
    pub method_sha256: String,
}

/// One row: a planned well.
pub struct Row<'r> {
    pub run: &'r OfRun<'r>,
    /// Place in the order of the plan, from 1.
    pub place: usize,
    pub well: &'r StoredWell,
}

impl<'r> OfRun<'r> {
    pub fn new(record: &'r RunRecord) -> Self {
        let plan = &record.plan;
        let kept = carved_records::plate_map::kept_columns(&plan.metadata, &plan.plate_barcode);
        let method_sha256 = serde_json::to_value(&record.method).map_or_else(|_| String::new(), |method| hash_of(&method));
        Self { record, kept, method_sha256 }
    }
}

/// SHA-256 of a method: of its JSON with sorted keys and without white space. It names the settings, not the file.
pub fn hash_of(method: &Value) -> String {
    // Objects of serde_json are sorted by key.
    sha256_hex(method.to_string().as_bytes())
}

impl Row<'_> {
    /// A value of `measurement.json`, by its JSON pointer.
    pub fn measured(&self, pointer: &str) -> Option<&Value> {
        self.well.measurement.as_ref()?.pointer(pointer)
    }

    /// A value of `recording.json`, by its JSON pointer.
    pub fn recorded(&self, pointer: &str) -> Option<&Value> {
        self.well.recording.as_ref()?.pointer(pointer)
    }

    /// A check of the specimen, by name and flag. Two checks against references have the same name.
    pub fn check(&self, name: &str) -> Option<&Value> {
        self.measured("/quality/checks")?.as_array()?.iter().find(|check| check["name"] == name)
    }

    fn standing(&self, quantity: &str) -> Option<(&str, &Value)> {
        place_among_references(self.well.measurement.as_ref()?, quantity)
    }

    /// A value of the place among reference larvae.
    pub fn reference(&self, quantity: &str, key: &str) -> Option<&Value> {
        self.standing(quantity)?.1.get(key)
    }

    /// The estimator that the reference larvae were measured by.
    pub fn reference_estimator(&self, quantity: &str) -> Cell {
        Cell::from(self.standing(quantity).map(|(name, _)| name))
    }

    /// What of the specimen and the reference larvae does not match: `asd; treatment`.
    pub fn reference_mismatches(&self, quantity: &str) -> Cell {
        let list = self.reference(quantity, "mismatches").and_then(Value::as_array);
        let names = |list: &Vec<Value>| list.iter().filter_map(|m| m["key"].as_str()).collect::<Vec<_>>().join(";");
        Cell::from(list.map(names))
    }

    /// Views of which a second take is in the ledger.
    pub fn retaken(&self) -> Option<usize> {
        let ledger = self.recorded("/ledger")?.as_array()?;
        Some(ledger.iter().filter(|entry| entry["retake"].as_u64().is_some_and(|take| take > 0)).count())
    }
}
