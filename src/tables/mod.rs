//! Tidy tables of stored runs: one row per specimen, and one row per slice of a specimen's body.
//!
//! ```text
//! run folders ── StoredRun ── specimens::table ─┐            ┌─ csv::text
//!                         └── stations::table ──┴─► Table ───┼─ parquet::bytes (feature `parquet`)
//!                                                            └─ mihcsme::metadata
//! ```
//! A column is one entry of a list: name, kind, meaning and where its value comes from. The reference page is made from the same list.

mod columns;
pub mod csv;
pub mod mihcsme;
pub mod ontology;
#[cfg(feature = "parquet")]
pub mod parquet;
mod row;
mod specimens;
mod stations;
pub mod statistics;

pub use columns::{mode, page};
pub use row::hash_of as method_hash;
pub use specimens::table as specimens;
pub use stations::table as stations;

/// What the cells of a column hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Text,
    /// A decimal number.
    Number,
    /// A number without fraction.
    Integer,
    /// `true` or `false`.
    Truth,
}

impl Kind {
    /// The word of the reference page.
    pub fn name(self) -> &'static str {
        match self {
            Self::Text => "text",
            Self::Number => "number",
            Self::Integer => "integer",
            Self::Truth => "true or false",
        }
    }
}

/// One value.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    Empty,
    Text(String),
    Number(f64),
    Integer(i64),
    Truth(bool),
}

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

impl Cell {
    /// The value of JSON in a column of this kind. Empty where it is of another kind, or not there.
    fn of_json(kind: Kind, value: Option<&serde_json::Value>) -> Self {
        let found = value.and_then(|value| match kind {
            Kind::Text => value.as_str().map(|text| Self::Text(text.to_owned())),
            Kind::Number => value.as_f64().map(Self::Number),
            Kind::Integer => value.as_i64().map(Self::Integer),
            Kind::Truth => value.as_bool().map(Self::Truth),
        });
        found.unwrap_or(Self::Empty)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        // No reader agrees with another on how NaN is written.
        if number.is_finite() { Self::Number(number) } else { Self::Empty }
    }
}

impl From<u32> for Cell {
    fn from(number: u32) -> Self {
        Self::Integer(number.into())
    }
}

impl From<usize> for Cell {
    fn from(number: usize) -> Self {
        i64::try_from(number).map_or(Self::Empty, Self::Integer)
    }
}

impl From<bool> for Cell {
    fn from(truth: bool) -> Self {
        Self::Truth(truth)
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Empty, Into::into)
    }
}
