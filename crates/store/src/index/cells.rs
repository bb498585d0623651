//! The columns of specimens in the index, as `carved export table` has them.
//!
//! ```text
//! the list of columns ─┬─ run_cells       a row per run: what may change while the run goes on
//!                      ├─ specimen_cells  a row per planned well
//!                      └─ specimen_table  both: the view that people read
//! ```
//! The tables are made from the list. Where an index has those of another list, they are made anew, and all runs are read again.

use crate::columns::{AFTER, BEFORE, Column, OfRun, Row, Source};
use crate::{RunRecord, StoredWell};
use rusqlite::{Connection, ToSql, params_from_iter};

/// Tables and view with the statements that make them, in the order of their names.
fn schema() -> [(&'static str, String); 3] {
    let defined = |columns: Vec<&Column>| columns.iter().map(|c| format!("\"{}\" {}", c.name, c.kind.sql())).collect::<Vec<_>>().join(", ");
    let shown = |columns: &[Column]| {
        let from = |c: &Column| if is_of_run(c) { "r" } else { "s" };
        columns.iter().map(|c| format!("{}.\"{}\"", from(c), c.name)).collect::<Vec<_>>().join(", ")
    };
    let (of_runs, of_specimens) = (defined(columns(true).collect()), defined(columns(false).collect()));
    let (before, after) = (shown(BEFORE), shown(AFTER));
    [
        ("run_cells", format!("CREATE TABLE run_cells ({of_runs}, PRIMARY KEY (run)) WITHOUT ROWID")),
        (
            "specimen_cells",
            format!("CREATE TABLE specimen_cells (run TEXT, {of_specimens}, metadata TEXT, PRIMARY KEY (run, well)) WITHOUT ROWID"),
        ),
        (
            "specimen_table",
            format!(
                "CREATE VIEW specimen_table AS SELECT {before}, s.metadata, {after} FROM specimen_cells s JOIN run_cells r ON r.run = s.run"
            ),
        ),
    ]
}

fn is_of_run(column: &Column) -> bool {
    matches!(column.source, Source::Run(_))
}

/// The columns of runs, or those of specimens.
fn columns(of_run: bool) -> impl Iterator<Item = &'static Column> {
    BEFORE.iter().chain(AFTER).filter(move |column| is_of_run(column) == of_run)
}

/// Makes tables and view anew where they are not those of the list. Then the refresh that follows reads all runs again.
pub(super) fn follow_the_list(c: &Connection) -> rusqlite::Result<()> {
    let made: Vec<String> = c
        .prepare("SELECT sql FROM sqlite_schema WHERE name IN ('run_cells', 'specimen_cells', 'specimen_table') ORDER BY name")?
        .query_map([], |row| row.get(0))?
        .collect::<Result<_, _>>()?;
    let schema = schema();
    if made.iter().eq(schema.iter().map(|(_, sql)| sql)) {
        return Ok(());
    }
    c.execute_batch("DROP VIEW IF EXISTS specimen_table; DROP TABLE IF EXISTS run_cells; DROP TABLE IF EXISTS specimen_cells")?;
    for (_, sql) in &schema {
        c.execute_batch(sql)?;
    }
    c.execute("UPDATE runs SET run_json_ns = 0, run_json_bytes = 0", []).map(|_| ())
}

fn insert(c: &Connection, table: &str, cells: &[&dyn ToSql]) -> rusqlite::Result<()> {
    let places = vec!["?"; cells.len()].join(", ");
    c.prepare_cached(&format!("INSERT OR REPLACE INTO {table} VALUES ({places})"))?.execute(params_from_iter(cells)).map(|_| ())
}

/// Writes the row of a run.
pub(super) fn put_run(c: &Connection, record: &RunRecord) -> rusqlite::Result<()> {
    let cells: Vec<_> = columns(true).filter_map(|column| column.of_run(record)).collect();
    insert(c, "run_cells", &cells.iter().map(|cell| cell as &dyn ToSql).collect::<Vec<_>>())
}

/// Writes the row of a planned well. `place` counts from 0.
pub(super) fn put_specimen(c: &Connection, run: &OfRun, place: usize, well: &StoredWell) -> rusqlite::Result<()> {
    let row = Row { run, place: place + 1, well };
    let cells: Vec<_> = columns(false).map(|column| column.cell(&row)).collect();
    let own = run.own_cells(&well.planned.well);
    let values =
        std::iter::once(&run.record.id as &dyn ToSql).chain(cells.iter().map(|cell| cell as &dyn ToSql)).chain([&own as &dyn ToSql]);
    insert(c, "specimen_cells", &values.collect::<Vec<_>>())
}
