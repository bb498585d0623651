//! Tidy tables of stored runs: one row per specimen, and one row per slice of a specimen's body.
//!
//! ```text
//! run folders ── StoredRun ── specimens::table ─┐            ┌─ csv::text
//!                         └── stations::table ──┴─► Table ───┼─ parquet::bytes (feature `parquet`)
//!                                                            └─ mihcsme::metadata
//! ```
//! The columns of specimens are those of the index: `carved_store::columns`.

pub mod csv;
pub mod mihcsme;
#[cfg(feature = "parquet")]
pub mod parquet;
mod specimens;
mod stations;
pub mod statistics;

pub use carved_store::columns::{Cell, Kind, NOT_MEASURED_AGAIN, hash_of as method_hash, mode, ontology, page};
pub use specimens::table as specimens;
pub use stations::table as stations;

/// Name and kind of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Heading {
    pub name: String,
    pub kind: Kind,
}

/// Columns of one kind each, and rows with a cell per column.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    pub headings: Vec<Heading>,
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Number of rows whose cell in this column is not empty and fulfils a condition.
    pub fn count(&self, column: &str, condition: impl Fn(&Cell) -> bool) -> usize {
        let Some(place) = self.headings.iter().position(|heading| heading.name == column) else { return 0 };
        self.rows.iter().filter(|row| row[place] != Cell::Empty && condition(&row[place])).count()
    }
}
