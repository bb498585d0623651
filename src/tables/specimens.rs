//! The table of specimens: a row per planned well of every run.

use super::columns::{AFTER, BEFORE, Column};
use super::row::{OfRun, Row};
use super::{Cell, Heading, Kind, Table};
use carved_store::{StoreError, StoredRun};
use std::collections::{BTreeMap, BTreeSet};

/// The table of these runs, in their order, the wells in the order of the plan. A column of the lab's own that only some of the runs have is
/// empty in the others.
///
/// # Errors
/// A file that is there and cannot be read, or was altered.
pub fn table(runs: &[StoredRun]) -> Result<Table, StoreError> {
    let of_runs: Vec<OfRun> = runs.iter().map(|run| OfRun::new(run.record())).collect();
    // By column, the heading of each run.
    let own: Vec<BTreeMap<String, String>> = of_runs.iter().map(|run| column_names(run.kept.keys())).collect();
    let own_names: BTreeSet<&String> = own.iter().flat_map(BTreeMap::keys).collect();
    let heading = |column: &Column| Heading { name: column.name.to_owned(), kind: column.kind };
    let mut headings: Vec<Heading> = BEFORE.iter().map(heading).collect();
    headings.extend(own_names.iter().map(|name| Heading { name: (*name).clone(), kind: Kind::Text }));
    headings.extend(AFTER.iter().map(heading));
    let mut rows = Vec::new();
    for ((stored, run), own) in runs.iter().zip(&of_runs).zip(&own) {
        for (i, planned) in run.record.plan.plate_map.iter().enumerate() {
            let well = stored.well(planned)?;
            let row = Row { run, place: i + 1, well: &well };
            let kept = |name: &String| own.get(name).and_then(|heading| run.kept.get(heading)?.get(&planned.well).cloned());
            let mut cells: Vec<Cell> = BEFORE.iter().map(|column| column.cell(&row)).collect();
            cells.extend(own_names.iter().map(|name| Cell::from(kept(name))));
            cells.extend(AFTER.iter().map(|column| column.cell(&row)));
            rows.push(cells);
        }
    }
    Ok(Table { headings, rows })
}

/// Names of columns for headings of the lab: `meta_` and the heading in lower case with `_` for everything that is no letter or digit.
/// Headings that become equal get a number.
fn column_names<'h>(headings: impl Iterator<Item = &'h String>) -> BTreeMap<String, String> {
    let mut names = BTreeMap::new();
    for heading in headings {
        let plain = |c: char| if c.is_alphanumeric() { c } else { '_' };
        let base = format!("meta_{}", heading.to_lowercase().chars().map(plain).collect::<String>());
        let (mut name, mut count) = (base.clone(), 1);
        while names.contains_key(&name) {
            count += 1;
            name = format!("{base}_{count}");
        }
        names.insert(name, heading.clone());
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_become_names_that_programs_can_type() {
        let headings = ["Clutch, ID", "clutch  id", "Größe (mm)", "clutch__id"].map(str::to_owned);
        let names = column_names(headings.iter());
        let keys: Vec<&str> = names.keys().map(String::as_str).collect();
        assert_eq!(keys, ["meta_clutch__id", "meta_clutch__id_2", "meta_clutch__id_3", "meta_größe__mm_"]);
        assert_eq!(names["meta_clutch__id"], "Clutch, ID");
    }

    #[test]
    fn every_column_has_a_name_of_its_own() {
        let mut seen = BTreeSet::new();
        for column in BEFORE.iter().chain(AFTER) {
            assert!(seen.insert(column.name), "{} is there twice", column.name);
            assert!(!column.name.starts_with("meta_"), "{} could be a column of the lab's own", column.name);
        }
    }
}
