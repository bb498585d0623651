//! Converts the cells of one well into a planned well.

use super::Place;
use super::number::{self, Decimal};
use crate::{ConcentrationUnit, Control, PlannedWell, SpecimenKind, is_well};
use serde::{Deserialize, Serialize};

/// A column that carved reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Column {
    Well,
    Specimen,
    Compound,
    Concentration,
    ConcentrationUnit,
    Dpf,
    Strain,
    Treatment,
    Control,
    Replicate,
}

impl Column {
    pub const ALL: [Self; 10] = [
        Self::Well,
        Self::Specimen,
        Self::Compound,
        Self::Concentration,
        Self::ConcentrationUnit,
        Self::Dpf,
        Self::Strain,
        Self::Treatment,
        Self::Control,
        Self::Replicate,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Well => "well",
            Self::Specimen => "specimen",
            Self::Compound => "compound",
            Self::Concentration => "concentration",
            Self::ConcentrationUnit => "concentration_unit",
            Self::Dpf => "dpf",
            Self::Strain => "strain",
            Self::Treatment => "treatment",
            Self::Control => "control",
            Self::Replicate => "replicate",
        }
    }

    /// The column of a heading. The case is ignored, and words may be separated by blanks, `-` or `_`. `None` if it is unknown.
    pub fn of_heading(heading: &str) -> Option<Self> {
        let heading = heading.trim().to_ascii_lowercase().replace([' ', '-'], "_");
        Self::ALL.into_iter().find(|c| c.name() == heading)
    }

    /// The column of a heading of a dispenser's report or of another program (Echo, D300, OMERO). `None` if it is unknown.
    pub fn of_foreign_heading(heading: &str) -> Option<Self> {
        const FOREIGN: [(&str, Column); 13] = [
            ("destination_well", Column::Well),
            ("dispensed_well", Column::Well),
            ("well_name", Column::Well),
            ("sample_name", Column::Compound),
            ("fluid_name", Column::Compound),
            ("compound_name", Column::Compound),
            ("dispensed_conc", Column::Concentration),
            ("dispensed_concentration", Column::Concentration),
            ("destination_concentration", Column::Concentration),
            ("final_concentration", Column::Concentration),
            ("conc_units", Column::ConcentrationUnit),
            ("concentration_units", Column::ConcentrationUnit),
            ("destination_concentration_units", Column::ConcentrationUnit),
        ];
        let heading = heading.trim().to_ascii_lowercase().replace('.', "").replace([' ', '-'], "_");
        FOREIGN.into_iter().find(|(name, _)| *name == heading).map(|(_, column)| column)
    }

    pub fn known() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

/// A cell: its column, the name of the column in the file, and its trimmed text.
pub struct Cell {
    pub column: Column,
    pub name: String,
    pub text: String,
}

/// The non-empty cells of one well.
pub struct Row {
    pub place: Place,
    pub decimal: Decimal,
    pub cells: Vec<Cell>,
}

/// A well as a file may name it: `a1` and `A1` are `A01`, and `aa1` is `AA01`. `Ab1` is none: some programs name the rows of a plate of 1536
/// wells `Aa`, `Ab`, `Ac`, `Ad`, `Ba`, .. in this order, so `Ab` would be the second row there and the 28th here.
pub fn well_of(written: &str) -> Option<String> {
    let letters = written.bytes().take_while(u8::is_ascii_alphabetic).count();
    let is_upper = |at: usize| written.as_bytes()[at].is_ascii_uppercase();
    if letters == 2 && is_upper(0) != is_upper(1) {
        return None;
    }
    let (row, column) = (written[..letters].to_ascii_uppercase(), &written[letters..]);
    let digits = !column.is_empty() && column.len() <= 2 && column.bytes().all(|b| b.is_ascii_digit());
    let name = format!("{row}{column:0>2}");
    (digits && is_well(&name)).then_some(name)
}

/// A mistake in a cell: the name of its column in the file, and the reason.
type Wrong = (String, String);

impl Row {
    fn cell(&self, column: Column) -> Option<&Cell> {
        self.cells.iter().find(|c| c.column == column)
    }

    /// The name of a column in the file.
    pub fn name_of(&self, column: Column) -> String {
        self.cell(column).map_or_else(|| column.name().to_owned(), |c| c.name.clone())
    }

    /// The planned well if it has a name, all mistakes, and notes on what was read differently from the file.
    pub fn well(&self) -> (Option<PlannedWell>, Vec<Wrong>, Vec<String>) {
        let mut mistakes = Vec::new();
        let mut notes = Vec::new();
        let text = |column| self.cell(column).map(|c| c.text.clone());
        let well = match text(Column::Well) {
            None => {
                mistakes.push((self.name_of(Column::Well), "this row names no well".into()));
                None
            }
            Some(written) => {
                let found = well_of(&written);
                match &found {
                    None => mistakes.push((
                        self.name_of(Column::Well),
                        format!("{written:?} is not a well: A01 to AF48, rows A to Z and AA to AF in capitals"),
                    )),
                    Some(name) if *name != written => notes.push(format!("{}: {written} is read as {name}", self.place)),
                    Some(_) => {}
                }
                found
            }
        };
        let mut planned = PlannedWell::new(well.clone().unwrap_or_default(), SpecimenKind::Larva, None);
        (planned.compound, planned.strain, planned.treatment) = (text(Column::Compound), text(Column::Strain), text(Column::Treatment));
        let mut parse = Parse { row: self, mistakes: &mut mistakes };
        planned.specimen =
            parse.word(Column::Specimen, &[("larva", SpecimenKind::Larva), ("bead", SpecimenKind::Bead)]).unwrap_or(SpecimenKind::Larva);
        planned.control = parse.word(Column::Control, &[("positive", Control::Positive), ("negative", Control::Negative)]);
        planned.dpf = parse.number(Column::Dpf);
        planned.concentration = parse.number(Column::Concentration);
        planned.concentration_unit = parse.read(Column::ConcentrationUnit, |unit| {
            ConcentrationUnit::from_file(unit)
                .ok_or_else(|| format!("{unit:?} is not a unit of concentration; the units are {}", ConcentrationUnit::known()))
        });
        planned.replicate =
            parse.read(Column::Replicate, |n| n.parse().map_err(|_| format!("{n:?} is not the number of a replicate: 1, 2, 3 ...")));
        // Report an unreadable cell once. The check of the planned well would report it again as missing.
        let unread: Vec<String> = mistakes.iter().map(|(column, _)| column.clone()).collect();
        let concentration_unread = [Column::Concentration, Column::ConcentrationUnit].iter().any(|&c| unread.contains(&self.name_of(c)));
        for (field, detail) in planned.mistakes() {
            if field.starts_with("concentration") && concentration_unread {
                continue;
            }
            let name = Column::of_heading(field).map_or_else(|| field.to_owned(), |c| self.name_of(c));
            mistakes.push((name, detail));
        }
        (well.map(|_| planned), mistakes, notes)
    }
}

/// Reads cells and collects their mistakes.
struct Parse<'r> {
    row: &'r Row,
    mistakes: &'r mut Vec<Wrong>,
}

impl Parse<'_> {
    fn read<T>(&mut self, column: Column, read: impl FnOnce(&str) -> Result<T, String>) -> Option<T> {
        let cell = self.row.cell(column)?;
        read(&cell.text).map_err(|detail| self.mistakes.push((cell.name.clone(), detail))).ok()
    }

    fn number(&mut self, column: Column) -> Option<f64> {
        let decimal = self.row.decimal;
        self.read(column, |written| number::read(written, decimal))
    }

    fn word<T: Copy>(&mut self, column: Column, words: &[(&str, T)]) -> Option<T> {
        self.read(column, |written| {
            let found = words.iter().find(|(word, _)| word.eq_ignore_ascii_case(written)).map(|&(_, value)| value);
            let known = words.iter().map(|(word, _)| *word).collect::<Vec<_>>().join(", ");
            let empty = if column == Column::Specimen { "; the row of an empty well is left out" } else { "" };
            found.ok_or_else(|| format!("{written:?} is none of {known}, or nothing{empty}"))
        })
    }
}
