//! Reads and checks plate maps in common file formats. Pure functions: from bytes to wells, or to the list of all mistakes.
//!
//! ```text
//! CSV ── text ── table ──┐
//!                        ├─> Row: cells by column ─> wells, notes ─> check for duplicates ─> PlateMap
//! JSON ─┬─ wells ────────┤                             mistakes, each with its place
//!       └─ MIHCSME ──────┘
//! ```
//! Clear input is read leniently (`a1` is `A01`). Ambiguous input is refused (`1,500`).

mod cell;
mod json;
mod kept;
mod mapping;
mod mihcsme;
mod number;
mod table;
mod text;

pub use cell::{Column, well_of};
pub use kept::{KeptColumns, kept_columns};
pub use mapping::{ColumnProposal, MappedColumn, ProposedColumn, propose};
pub use table::{UNCLOSED_QUOTE, unclosed_quote};

use super::plan::off_plate;
use super::{FieldError, Metadata, PlannedWell, PlateFormat};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The format of a plate map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// CSV with comma, semicolon or tab as the delimiter.
    Csv,
    /// A list of wells, `{"plate_map": [...], "metadata": {...}}`, or MIHCSME metadata.
    Json,
}

/// A plate map without mistakes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PlateMap {
    /// The `plate_format` of a run's plan, where the file names it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate_format: Option<u32>,
    /// The `plate_map` of a run's plan: the wells in the order of the file.
    pub plate_map: Vec<PlannedWell>,
    /// The `metadata` of a run's plan: MIHCSME unchanged, or `columns` with the cells of CSV columns that carved does not read.
    pub metadata: Metadata,
    /// What was read differently from the file, each with its place.
    pub notes: Vec<String>,
    /// What a person confirms before a run: a single well makes the plate larger, and may be a misprint. `None` where nothing is to be confirmed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirm: Option<String>,
}

/// A mistake, and its place: a JSON pointer, or a line and a column of a CSV.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Mistake {
    /// JSON pointer into the body, such as `/plate_map/3/well`. The empty pointer is the body itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pointer: Option<String>,
    /// Line of the file, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// The heading of the column. Missing if the whole line is meant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    pub detail: String,
}

impl Mistake {
    fn at(pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { pointer: Some(pointer.into()), line: None, column: None, detail: detail.into() }
    }

    fn in_line(line: u64, column: &str, detail: impl Into<String>) -> Self {
        let column = (!column.is_empty()).then(|| column.to_owned());
        Self { pointer: None, line: Some(line), column, detail: detail.into() }
    }
}

impl From<FieldError> for Mistake {
    fn from(error: FieldError) -> Self {
        Self::at(error.pointer, error.detail)
    }
}

impl std::fmt::Display for Mistake {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.line, &self.column, self.pointer.as_deref()) {
            (Some(line), Some(column), _) => write!(f, "line {line}, {column}: ")?,
            (Some(line), None, _) => write!(f, "line {line}: ")?,
            (None, _, Some(pointer)) if !pointer.is_empty() => write!(f, "{pointer}: ")?,
            _ => {}
        }
        f.write_str(&self.detail)
    }
}

/// Maximum number of listed mistakes. A file of another kind has one in every line.
const LISTED: usize = 1000;

/// Reads a plate map.
///
/// `plate` names one of several plates of a MIHCSME file. `chosen` is the number of wells of the plate that a person chose. It counts
/// before the one that the file names.
///
/// # Errors
/// All mistakes, each with its line and column, or with its JSON pointer.
pub fn read(bytes: &[u8], format: Format, plate: Option<&str>, chosen: Option<u32>) -> Result<PlateMap, Vec<Mistake>> {
    let mut reading = Reading::default();
    match format {
        Format::Csv => table::read(bytes, None, &mut reading),
        Format::Json => json::read(bytes, plate, &mut reading),
    }
    reading.finish_on(chosen)
}

/// Reads a CSV whose columns a person has named. The mapping is kept in the metadata, as `column_mapping`.
///
/// # Errors
/// As [`read`].
pub fn read_mapped(bytes: &[u8], chosen: Option<u32>, columns: &[MappedColumn]) -> Result<PlateMap, Vec<Mistake>> {
    let mut reading = Reading::default();
    table::read(bytes, Some(columns), &mut reading);
    if let Ok(mapping) = serde_json::to_value(columns) {
        reading.map.metadata.insert("column_mapping".into(), mapping);
    }
    reading.finish_on(chosen)
}

/// A place in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Place {
    Line(u64),
    Pointer(String),
}

impl Place {
    /// `column` is the name of the column, or the last part of a pointer.
    fn mistake(&self, column: &str, detail: impl Into<String>) -> Mistake {
        match self {
            Self::Line(line) => Mistake::in_line(*line, column, detail),
            Self::Pointer(pointer) if column.is_empty() => Mistake::at(pointer.clone(), detail),
            Self::Pointer(pointer) => Mistake::at(format!("{pointer}/{column}"), detail),
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Pointer(pointer) => f.write_str(pointer),
        }
    }
}

/// The state of a reader.
#[derive(Default)]
struct Reading {
    map: PlateMap,
    mistakes: Vec<Mistake>,
    left_out: usize,
    /// Where each well occurred first.
    named: BTreeMap<String, Place>,
}

impl Reading {
    fn wrong(&mut self, mistake: Mistake) {
        if self.mistakes.len() < LISTED {
            self.mistakes.push(mistake);
        } else {
            self.left_out += 1;
        }
    }

    fn note(&mut self, note: String) {
        self.map.notes.push(note);
    }

    /// Stores a cell of a column that carved does not read, as `metadata.columns.<column>.<well>`.
    fn keep(&mut self, column: &str, well: &str, text: &str) {
        let object = || serde_json::Value::Object(Metadata::new());
        let columns = self.map.metadata.entry("columns").or_insert_with(object);
        let cells = columns.as_object_mut().map(|columns| columns.entry(column).or_insert_with(object));
        if let Some(cells) = cells.and_then(serde_json::Value::as_object_mut) {
            cells.insert(well.to_owned(), text.into());
        }
    }

    /// Takes the number of wells of the plate.
    fn on_plate(&mut self, wells: &serde_json::Value) {
        match wells.as_u64().and_then(|wells| PlateFormat::of_wells(u32::try_from(wells).ok()?)) {
            Some(format) => self.map.plate_format = Some(format.wells()),
            None => self.wrong(Mistake::at(
                "/plate_format",
                format!("{wells:.60} is not the number of wells of a plate: {}", PlateFormat::known()),
            )),
        }
    }

    /// Takes one well. Returns its name, or records its mistakes.
    fn row(&mut self, row: &cell::Row) -> Option<String> {
        let (planned, mistakes, notes) = row.well();
        self.map.notes.extend(notes);
        let sound = mistakes.is_empty();
        for (column, detail) in mistakes {
            self.wrong(row.place.mistake(&column, detail));
        }
        let planned = planned?;
        if let Some(first) = self.named.get(&planned.well) {
            let detail = format!("{} stands in the plate map twice, first at {first}", planned.well);
            let column = row.name_of(cell::Column::Well);
            self.wrong(row.place.mistake(&column, detail));
            return None;
        }
        let well = planned.well.clone();
        self.named.insert(well.clone(), row.place.clone());
        if sound {
            self.map.plate_map.push(planned);
        }
        Some(well)
    }

    /// Notes the wells that make a plate larger than the next smaller one. A single one may be a misprint, and is to be confirmed.
    fn note_larger(&mut self) {
        const NAMED: usize = 3;
        let names = self.map.plate_map.iter().map(|planned| planned.well.as_str());
        let shown = PlateFormat::shown(None, &names);
        let Some(smaller) = shown.next_usual_below() else { return };
        let beyond: Vec<_> = names.filter(|well| !smaller.holds(well)).collect();
        let at = |well: &str| self.named.get(well).map_or_else(|| well.to_owned(), |place| format!("{place}: {well}"));
        let [smaller, larger] = [smaller, shown].map(PlateFormat::wells);
        if let [alone] = beyond[..] {
            let at = at(alone);
            self.map.confirm = Some(format!(
                "{at} is the only well that is not on a plate of {smaller} wells, so the plate counts as one of {larger} wells; choose the plate, or \
                 correct the well"
            ));
            return;
        }
        let more = if beyond.len() > NAMED { format!(" and {} more", beyond.len() - NAMED) } else { String::new() };
        let named: Vec<_> = beyond.iter().take(NAMED).map(|well| at(well)).collect();
        let named = named.join(", ");
        self.note(format!(
            "{named}{more}: not on a plate of {smaller} wells, so the plate counts as one of {larger} wells; choose the plate if it is another"
        ));
    }

    fn finish_on(mut self, chosen: Option<u32>) -> Result<PlateMap, Vec<Mistake>> {
        if let Some(wells) = chosen {
            self.on_plate(&wells.into());
        }
        self.finish()
    }

    fn finish(mut self) -> Result<PlateMap, Vec<Mistake>> {
        if let Some(format) = self.map.plate_format.and_then(PlateFormat::of_wells) {
            let off: Vec<_> = self.named.iter().filter(|(well, _)| !format.holds(well)).collect();
            let mistakes: Vec<_> = off.into_iter().map(|(well, place)| place.mistake("well", off_plate(well, format))).collect();
            for mistake in mistakes {
                self.wrong(mistake);
            }
        } else {
            self.note_larger();
        }
        if self.mistakes.is_empty() && self.map.plate_map.is_empty() {
            self.wrong(Mistake::in_line(1, "", "the plate map names no well"));
        }
        if let (1.., Some(last)) = (self.left_out, self.mistakes.last()) {
            let detail = format!("{} more mistakes are not listed", self.left_out);
            self.mistakes.push(Mistake { column: None, detail, ..last.clone() });
        }
        if self.mistakes.is_empty() { Ok(self.map) } else { Err(self.mistakes) }
    }
}

#[cfg(test)]
mod tests;
