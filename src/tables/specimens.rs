//! The table of specimens: a row per planned well of every run.

use super::{Cell, Heading, Kind, Table};
use carved_store::StoredRun;
use carved_store::columns::{AFTER, BEFORE, Column, OfRun, Row};
use std::collections::BTreeSet;

/// The table of these runs, in their order, the wells in the order of the plan. A column of the lab's own that only some of the runs have is
/// empty in the others.
/// A well with a file that cannot be read, or was altered, has the reason in place of its numbers.
pub fn table(runs: &[StoredRun]) -> Table {
    let of_runs: Vec<OfRun> = runs.iter().map(|run| OfRun::new(run.record())).collect();
    let own_names: BTreeSet<&str> = of_runs.iter().flat_map(OfRun::own_columns).collect();
    let heading = |column: &Column| Heading { name: column.name.to_owned(), kind: column.kind };
    let mut headings: Vec<Heading> = BEFORE.iter().map(heading).collect();
    headings.extend(own_names.iter().map(|name| Heading { name: (*name).to_owned(), kind: Kind::Text }));
    headings.extend(AFTER.iter().map(heading));
    let mut rows = Vec::new();
    for (stored, run) in runs.iter().zip(&of_runs) {
        for (i, well) in stored.wells().enumerate() {
            let row = Row { run, place: i + 1, well: &well };
            let mut cells: Vec<Cell> = BEFORE.iter().map(|column| column.cell(&row)).collect();
            cells.extend(own_names.iter().map(|name| Cell::from(run.own_cell(name, &well.planned.well))));
            cells.extend(AFTER.iter().map(|column| column.cell(&row)));
            rows.push(cells);
        }
    }
    Table { headings, rows }
}
