//! What the columns of one row are read from.

use super::Cell;
use crate::{RunRecord, StoredWell, place_among_references};
use carved_records::plate_map::{KeptColumns, kept_columns};
use carved_records::sha256_hex;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What is the same in every row of a run.
pub struct OfRun<'r> {
    pub record: &'r RunRecord,
    /// Cells of the lab's own columns, by the name of the column and the well.
    own: KeptColumns,
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
        let own = named(kept_columns(&plan.metadata, &plan.plate_barcode));
        let method_sha256 = serde_json::to_value(&record.method).map_or_else(|_| String::new(), |method| hash_of(&method));
        Self { record, own, method_sha256 }
    }

    /// Names of the lab's own columns: `meta_...`.
    pub fn own_columns(&self) -> BTreeSet<&str> {
        self.own.keys().map(String::as_str).collect()
    }

    /// The cell of one of the lab's own columns.
    pub fn own_cell(&self, column: &str, well: &str) -> Option<&str> {
        self.own.get(column)?.get(well).map(String::as_str)
    }

    /// The cells that a well has in the lab's own columns, as JSON. `None` where it has none.
    pub(crate) fn own_cells(&self, well: &str) -> Option<String> {
        let cells: BTreeMap<&str, &str> =
            self.own.keys().filter_map(|column| Some((column.as_str(), self.own_cell(column, well)?))).collect();
        if cells.is_empty() { None } else { serde_json::to_string(&cells).ok() }
    }
}

/// Names of columns for headings of the lab: `meta_` and the heading in lower case with `_` for everything that is no letter or digit.
/// Headings that become equal get a number.
fn named(kept: KeptColumns) -> KeptColumns {
    let mut names = KeptColumns::new();
    for (heading, cells) in kept {
        let plain = |c: char| if c.is_alphanumeric() { c } else { '_' };
        let base = format!("meta_{}", heading.to_lowercase().chars().map(plain).collect::<String>());
        let (mut name, mut count) = (base.clone(), 1);
        while names.contains_key(&name) {
            count += 1;
            name = format!("{base}_{count}");
        }
        names.insert(name, cells);
    }
    names
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_become_names_that_programs_can_type() {
        let headings = ["Clutch, ID", "clutch  id", "Größe (mm)", "clutch__id"].map(|heading| (heading.to_owned(), BTreeMap::new()));
        let names = named(KeptColumns::from(headings));
        let keys: Vec<&str> = names.keys().map(String::as_str).collect();
        assert_eq!(keys, ["meta_clutch__id", "meta_clutch__id_2", "meta_clutch__id_3", "meta_größe__mm_"]);
    }
}
