//! The columns of a specimen: what `carved export table` and the index hold of it.
//!
//! ```text
//! run.json, recording.json, measurement.json, timings.json ── Row ── Column::cell ── Cell ─┬─ tables (CSV, Parquet)
//!                                                                                      └─ index.sqlite: specimen_table
//! ```
//! A column is one entry of a list: name, kind, meaning and where its value comes from. The reference page is made from the same list.

mod list;
pub mod ontology;
mod row;

pub use list::{AFTER, BEFORE, Column, NOT_MEASURED_AGAIN, Source, mode, page, shape_estimator};
pub use row::{OfRun, Row, hash_of};

use rusqlite::types::{Null, ToSql, ToSqlOutput};

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

    /// The type of a column of the index, which knows no truth values.
    pub(crate) fn sql(self) -> &'static str {
        match self {
            Self::Text => "TEXT",
            Self::Number => "REAL",
            Self::Integer | Self::Truth => "INTEGER",
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

impl ToSql for Cell {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        match self {
            // As in a file: an empty text does not exist.
            Self::Empty => Ok(ToSqlOutput::from(Null)),
            Self::Text(text) if text.is_empty() => Ok(ToSqlOutput::from(Null)),
            Self::Text(text) => text.to_sql(),
            Self::Number(number) => number.to_sql(),
            Self::Integer(number) => number.to_sql(),
            Self::Truth(truth) => truth.to_sql(),
        }
    }
}
