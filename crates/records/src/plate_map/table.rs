//! The CSV format: one heading, one line per well.
//!
//! ```text
//! compound, 1, 2, 3 ..  A, x, y, ..         a block per column in the layout of the plate (plater) ── matrix
//! Run ID, 7   [DETAILS]   Destination Well  a dispenser's report: its first lines are left out ────── transfers
//! # header s,d                              the first line of OMERO's tables is left out
//! ```

use super::cell::{Cell, Column, Row, well_of};
use super::number::Decimal;
use super::{MappedColumn, Mistake, Place, Reading, text};
use csv::{ByteRecord, ReaderBuilder, StringRecord};
use std::collections::{BTreeMap, BTreeSet};

/// The records of a CSV, each with its line, and the decimal sign of its numbers. `None` after a mistake.
fn records(bytes: &[u8], reading: &mut Reading) -> Option<(Vec<(u64, StringRecord)>, Decimal)> {
    let text = match text::decode(bytes) {
        Ok(text) => text,
        Err(mistake) => {
            reading.wrong(mistake);
            return None;
        }
    };
    let (stated, text, lines_before) = stated_delimiter(&text);
    let delimiter = stated.unwrap_or_else(|| likely_delimiter(text));
    if let Some(line) = unclosed_quote(text.as_bytes(), delimiter, None) {
        reading.wrong(Mistake::in_line(lines_before + line, "", UNCLOSED_QUOTE));
        return None;
    }
    let decimal = match delimiter {
        b';' => Decimal::Comma,
        b',' => Decimal::Point,
        _ => Decimal::Either,
    };
    let mut rows: Vec<(u64, StringRecord)> = Rows::new(text, delimiter, lines_before).collect();
    if rows.first().is_some_and(|(_, record)| record.get(0).is_some_and(|cell| cell.starts_with("# header"))) {
        rows.remove(0);
    }
    Some((rows, decimal))
}

/// A table by its headings.
pub struct Headed {
    /// Line of the headings.
    pub line: u64,
    pub headings: StringRecord,
    pub rows: Vec<StringRecord>,
    pub decimal: Decimal,
}

/// A table and its headings, whatever they say. `None` after a mistake.
pub fn headed(bytes: &[u8], reading: &mut Reading) -> Option<Headed> {
    let (rows, decimal) = records(bytes, reading)?;
    if let Some((line, _)) = rows.first().filter(|(_, record)| is_matrix_heading(record)) {
        reading.wrong(Mistake::in_line(*line, "", "the file is in the layout of the plate: its blocks are named in their corners"));
        return None;
    }
    let names_a_column = |(_, record): &(u64, StringRecord)| record.iter().any(|cell| Column::of_heading(cell).is_some());
    let begin = match heading(&rows, reading) {
        0 if !rows.first().is_some_and(names_a_column) => likely_heading(&rows),
        found => found,
    };
    let is_in_sections = details(&rows).is_some();
    let mut rows = section(rows, begin).into_iter();
    let Some((line, headings)) = rows.next() else {
        reading.wrong(Mistake::in_line(1, "", "the file is empty"));
        return None;
    };
    // Lines behind the list name no well.
    let rows = rows.map(|(_, record)| record).filter(|record| !is_in_sections || record.len() >= headings.len()).collect();
    Some(Headed { line, headings, rows, decimal })
}

/// The place of the headings, where they name no column of carved: the first line with as many cells as most lines have. A title has one
/// cell, and a line with a cell too many is a mistake in it. In a report with sections it is that of the list of transfers.
fn likely_heading(records: &[(u64, StringRecord)]) -> usize {
    let details = details(records).unwrap_or(0);
    let list = || records[details.min(records.len())..].iter().map(|(_, record)| record.len());
    let mut lines = BTreeMap::<usize, usize>::new();
    for cells in list().filter(|cells| *cells > 1) {
        *lines.entry(cells).or_default() += 1;
    }
    let usual = lines.into_iter().max_by_key(|&(cells, lines)| (lines, cells)).map_or(1, |(cells, _)| cells);
    details + list().position(|cells| cells == usual).unwrap_or_default()
}

/// The place of the line behind which an Echo lists the transfers that it made. Those that failed are in a section of their own.
fn details(records: &[(u64, StringRecord)]) -> Option<usize> {
    titled(records, "[DETAILS]")
}

/// The place of the line that begins a section of a report.
fn titled(records: &[(u64, StringRecord)], title: &str) -> Option<usize> {
    records.iter().position(|(_, record)| record.get(0).is_some_and(|cell| cell.eq_ignore_ascii_case(title)))
}

/// The lines from the headings on, up to the next section of the report.
fn section(records: Vec<(u64, StringRecord)>, begin: usize) -> Vec<(u64, StringRecord)> {
    let is_section = |record: &StringRecord| {
        let mut cells = record.iter();
        cells.next().is_some_and(|cell| cell.starts_with('[') && cell.ends_with(']')) && cells.all(str::is_empty)
    };
    let list = records.into_iter().skip(begin).enumerate().take_while(|(at, (_, record))| *at == 0 || !is_section(record));
    list.map(|(_, line)| line).collect()
}

/// Reads a table. With a `mapping`, its columns are what a person says.
pub fn read(bytes: &[u8], mapping: Option<&[MappedColumn]>, reading: &mut Reading) {
    let Some((rows, decimal)) = records(bytes, reading) else { return };
    if mapping.is_none() && rows.first().is_some_and(|(_, record)| is_matrix_heading(record)) {
        return matrix(&rows, decimal, reading);
    }
    let begin = match mapping {
        None => heading(&rows, reading),
        Some(mapping) => {
            let has_all = |record: &StringRecord| mapping.iter().all(|mapped| record.iter().any(|cell| cell == mapped.heading));
            let first = details(&rows).unwrap_or(0);
            let Some(found) = rows.iter().skip(first).position(|(_, record)| has_all(record)).map(|at| first + at) else {
                let names: Vec<&str> = mapping.iter().map(|mapped| mapped.heading.as_str()).collect();
                return reading.wrong(Mistake::in_line(1, "", format!("no line has the columns {}", names.join(", "))));
            };
            found
        }
    };
    let is_in_sections = details(&rows).is_some();
    if let Some((line, _)) = titled(&rows, "[EXCEPTIONS]").and_then(|at| rows.get(at)) {
        reading.note(format!("line {line}: the transfers of this section failed, and are left out"));
    }
    let mut rows = section(rows, begin).into_iter();
    let Some((line, headings)) = rows.next() else {
        return reading.wrong(Mistake::in_line(1, "", format!("the file is empty; its first line names the columns: {}", Column::known())));
    };
    let columns = match mapping {
        None => columns(line, &headings, reading),
        Some(mapping) => {
            let column_of = |heading: &str| mapping.iter().find(|mapped| mapped.heading == heading).and_then(|mapped| mapped.column);
            named(line, &headings, column_of, reading)
        }
    };
    let unit = mapping.and_then(|mapping| unit_of_concentration(mapping, reading));
    let rows: Vec<_> = rows.collect();
    one_plate(&rows, line, &columns, reading);
    let rows = transfers(rows, &columns, is_in_sections, reading);
    if !columns.iter().any(|heading| matches!(heading, Heading::Known(Column::Well, _))) {
        // Every line would have the same mistake.
        return;
    }
    for (line, record) in rows {
        if record.len() != headings.len() {
            let detail = format!(
                "{} cells, the heading has {} columns: a delimiter (a decimal comma is one) or a quote is missing or too many",
                record.len(),
                headings.len()
            );
            reading.wrong(Mistake::in_line(line, "", detail));
            continue;
        }
        let (mut cells, mut kept) = (Vec::new(), Vec::new());
        for (text, column) in record.iter().zip(&columns).filter(|(text, _)| !text.is_empty()) {
            match column {
                Heading::Known(column, name) => cells.push(Cell { column: *column, name: name.clone(), text: text.to_owned() }),
                Heading::Unknown(name) => kept.push((name, text)),
                Heading::Empty => reading.wrong(Mistake::in_line(line, "", format!("{text:?} stands in a column without a heading"))),
            }
        }
        if cells.is_empty() && kept.is_empty() {
            continue;
        }
        let has = |column: Column| cells.iter().any(|cell: &Cell| cell.column == column);
        if let Some((heading, symbol)) = unit.filter(|_| has(Column::Concentration) && !has(Column::ConcentrationUnit)) {
            cells.push(Cell { column: Column::ConcentrationUnit, name: heading.to_owned(), text: symbol.to_owned() });
        }
        if let Some(well) = reading.row(&Row { place: Place::Line(line), decimal, cells }) {
            for (column, text) in kept {
                reading.keep(column, &well, text);
            }
        }
    }
}

/// Reads the line `sep=;` of Excel. Returns the delimiter, the text behind this line, and the number of lines read.
fn stated_delimiter(text: &str) -> (Option<u8>, &str, u64) {
    let (first, rest) = text.split_once('\n').unwrap_or((text, ""));
    match first.trim_end().strip_prefix("sep=").map(str::as_bytes) {
        Some(&[delimiter]) if delimiter.is_ascii() => (Some(delimiter), rest, 1),
        _ => (None, text, 0),
    }
}

/// The delimiter that gives the first line with one the most known headings. With equal counts, the one that gives the most parts.
fn likely_delimiter(text: &str) -> u8 {
    // A title has none.
    let heading = text.lines().find(|line| line.contains(['\t', ';', ','])).unwrap_or_default();
    let rate = |delimiter: u8| {
        let parts: Vec<&str> = heading.split(char::from(delimiter)).collect();
        let known = parts.iter().filter(|p| Column::of_heading(p.trim().trim_matches('"')).is_some()).count();
        (known, parts.len())
    };
    // `max_by_key` returns the last of equal elements: the comma.
    [b'\t', b';', b','].into_iter().max_by_key(|&d| rate(d)).unwrap_or(b',')
}

/// The message for a line of [`unclosed_quote`].
pub const UNCLOSED_QUOTE: &str =
    "a quote opens a cell here and is never closed: everything behind it would be one cell; close it, or take it away";

/// The line, from 1, of a quote that is still open at the end of a CSV text. A reader would take the rest of the text as one cell. As in
/// the reader, a quote opens only at the beginning of a cell, and a double quote inside a quoted cell is a literal one. Lines that begin
/// with `comment` are ignored.
pub fn unclosed_quote(text: &[u8], delimiter: u8, comment: Option<u8>) -> Option<u64> {
    let (mut line, mut opened, mut begins, mut begins_line, mut in_comment) = (1, None, true, true, false);
    let mut bytes = text.iter().copied().peekable();
    while let Some(byte) = bytes.next() {
        line += u64::from(byte == b'\n');
        in_comment = if begins_line { opened.is_none() && Some(byte) == comment } else { in_comment && byte != b'\n' };
        begins_line = byte == b'\n';
        if in_comment {
            continue;
        }
        match (opened, byte) {
            (Some(_), b'"') if bytes.peek() == Some(&b'"') => {
                bytes.next();
            }
            (Some(_), b'"') => opened = None,
            (None, b'"') if begins => opened = Some(line),
            _ => {}
        }
        begins = opened.is_none() && (byte == delimiter || byte == b'\n');
    }
    opened
}

/// The meaning of a heading.
enum Heading {
    /// A column that carved reads, with its name in the file.
    Known(Column, String),
    /// A column that carved stores and does not read.
    Unknown(String),
    /// No heading. The cells of this column must be empty.
    Empty,
}

fn columns(line: u64, headings: &StringRecord, reading: &mut Reading) -> Vec<Heading> {
    let column_of = |heading: &str| {
        let foreign = || Column::of_foreign_heading(heading).filter(|c| headings.iter().all(|other| Column::of_heading(other) != Some(*c)));
        Column::of_heading(heading).or_else(foreign)
    };
    if headings.iter().all(|heading| column_of(heading).is_none()) {
        let detail = format!("this line must name the columns, and names none of them: {}", Column::known());
        reading.wrong(Mistake::in_line(line, "", detail));
        return Vec::new();
    }
    for heading in headings {
        match column_of(heading) {
            Some(column) if Column::of_heading(heading).is_none() => {
                reading.note(format!("line {line}, {heading}: is read as {}", column.name()));
            }
            None if !heading.is_empty() => {
                let known = Column::known();
                reading.note(format!("line {line}, {heading}: carved does not read this column and keeps it as it is; it reads {known}"));
            }
            _ => {}
        }
    }
    named(line, headings, column_of, reading)
}

/// The heading and the unit of the concentration. A unit anywhere else, or beside a column of units, is a mistake.
fn unit_of_concentration<'m>(mapping: &'m [MappedColumn], reading: &mut Reading) -> Option<(&'m str, &'static str)> {
    let has_units = mapping.iter().any(|mapped| mapped.column == Some(Column::ConcentrationUnit));
    let mut unit = None;
    for (mapped, named) in mapping.iter().filter_map(|mapped| Some((mapped, mapped.unit?))) {
        if mapped.column != Some(Column::Concentration) {
            reading.wrong(Mistake::in_line(1, &mapped.heading, "a unit belongs to the column of the concentration, and to no other"));
        } else if has_units {
            reading.wrong(Mistake::in_line(1, &mapped.heading, "the unit of the concentration is named twice: here and by a column"));
        } else {
            unit = Some((mapped.heading.as_str(), named.symbol()));
        }
    }
    unit
}

/// The columns of these headings. One that `column_of` does not know is kept as it is.
fn named(line: u64, headings: &StringRecord, column_of: impl Fn(&str) -> Option<Column>, reading: &mut Reading) -> Vec<Heading> {
    let mut found: Vec<Heading> = Vec::new();
    for heading in headings {
        let column = column_of(heading);
        let is_same = |seen: &Heading| match (seen, column) {
            (Heading::Known(seen, _), Some(column)) => *seen == column,
            (Heading::Unknown(seen), None) => seen == heading,
            _ => false,
        };
        if found.iter().any(is_same) {
            let name = column.map_or_else(|| heading.to_owned(), |column| column.name().to_owned());
            reading.wrong(Mistake::in_line(line, heading, format!("the column {name} is there twice")));
        }
        found.push(match column {
            Some(column) => Heading::Known(column, heading.to_owned()),
            None if heading.is_empty() => Heading::Empty,
            None => Heading::Unknown(heading.to_owned()),
        });
    }
    if !found.iter().any(|heading| matches!(heading, Heading::Known(Column::Well, _))) {
        reading.wrong(Mistake::in_line(line, "well", format!("the column well is missing; the known columns are {}", Column::known())));
    }
    found
}

/// Whether a record begins a block in the layout of the plate: a name, and the numbers of the plate's columns.
fn is_matrix_heading(record: &StringRecord) -> bool {
    record.len() > 2 && record.iter().skip(1).zip(1..).all(|(cell, number): (&str, usize)| cell == number.to_string())
}

/// What the blocks say about a well.
struct BlockWell {
    well: String,
    /// Line of the first block that has a cell for it.
    line: u64,
    cells: Vec<Cell>,
    /// Cells of blocks that carved does not read, with the name of the block.
    kept: Vec<(String, String)>,
}

/// Reads blocks in the layout of the plate. Each is a column of the plate map: its name is in the corner, the letters of the rows are on the
/// left. A well is planned if a block has a cell for it.
fn matrix(records: &[(u64, StringRecord)], decimal: Decimal, reading: &mut Reading) {
    let mut wells: Vec<BlockWell> = Vec::new();
    let (mut name, mut width) = (String::new(), 0);
    for (line, record) in records {
        if is_matrix_heading(record) {
            (name, width) = (record[0].to_owned(), record.len());
            if name.is_empty() || Column::of_heading(&name) == Some(Column::Well) {
                reading.wrong(Mistake::in_line(*line, &name, "the corner of a block names its column, such as compound"));
            }
            continue;
        }
        let row = &record[0];
        if record.len() > width || well_of(&format!("{row}01")).is_none() {
            let detail = format!("expected a letter of a row and {} cells, or the heading of a block: a name, 1, 2, 3 ...", width - 1);
            reading.wrong(Mistake::in_line(*line, &name, detail));
            continue;
        }
        for (number, text) in record.iter().enumerate().skip(1).filter(|(_, text)| !text.is_empty()) {
            let well = format!("{}{number:02}", row.to_ascii_uppercase());
            let at = wells.iter().position(|known| known.well == well).unwrap_or_else(|| {
                let own = Cell { column: Column::Well, name: "well".into(), text: well.clone() };
                wells.push(BlockWell { well, line: *line, cells: vec![own], kept: Vec::new() });
                wells.len() - 1
            });
            let BlockWell { cells, kept, .. } = &mut wells[at];
            match Column::of_heading(&name) {
                Some(column) if cells.iter().any(|cell| cell.column == column) => {
                    reading.wrong(Mistake::in_line(*line, &name, format!("the block {name} is there twice, or its row {row} is")));
                }
                Some(column) => cells.push(Cell { column, name: name.clone(), text: text.to_owned() }),
                None => kept.push((name.clone(), text.to_owned())),
            }
        }
    }
    for BlockWell { line, cells, kept, .. } in wells {
        if let Some(well) = reading.row(&Row { place: Place::Line(line), decimal, cells }) {
            for (column, text) in kept {
                reading.keep(&column, &well, &text);
            }
        }
    }
}

/// The place of the heading among the records. A report has lines before it, which are left out.
fn heading(records: &[(u64, StringRecord)], reading: &mut Reading) -> usize {
    let names = |record: &StringRecord, find: fn(&str) -> Option<Column>, column: Option<Column>| {
        record.iter().filter_map(find).any(|found| column.is_none_or(|column| found == column))
    };
    if records.first().is_none_or(|(_, first)| names(first, Column::of_heading, None) || names(first, Column::of_foreign_heading, None)) {
        return 0;
    }
    // An Echo lists the transfers that failed before, under the same heading.
    let details = details(records).unwrap_or(0);
    let is_heading = |record: &StringRecord| {
        record.len() > 2
            && (names(record, Column::of_heading, Some(Column::Well)) || names(record, Column::of_foreign_heading, Some(Column::Well)))
    };
    let found = records.iter().skip(details).position(|(_, record)| is_heading(record)).map_or(0, |at| details + at);
    if let (1.., Some((line, _))) = (found, records.get(found)) {
        reading.note(format!("line {line} is read as the heading; the lines before it are left out"));
    }
    found
}

/// Refuses a list of several plates: their wells have the same names.
fn one_plate(records: &[(u64, StringRecord)], line: u64, columns: &[Heading], reading: &mut Reading) {
    const NAMES: [&str; 4] = ["destination plate barcode", "destination plate name", "destination plate", "plate"];
    for (at, column) in columns.iter().enumerate() {
        let Heading::Unknown(name) = column else { continue };
        if !NAMES.contains(&name.to_ascii_lowercase().as_str()) {
            continue;
        }
        let plates: BTreeSet<&str> = {
            let whole = records.iter().filter(|(_, record)| record.len() == columns.len());
            whole.filter_map(|(_, record)| record.get(at)).filter(|plate| !plate.is_empty()).collect()
        };
        if plates.len() > 1 {
            let plates = plates.into_iter().collect::<Vec<_>>().join(", ");
            reading.wrong(Mistake::in_line(line, name, format!("the file has the plates {plates}: keep the lines of one plate")));
        }
    }
}

/// The lines of a dispenser's report that name a well's treatment: a solvent that was dispensed beside a compound is left out, and so are
/// lines behind the list that name no well. Of another file, all lines. A report is told by its sections or by the name of its wells.
fn transfers(
    records: Vec<(u64, StringRecord)>,
    columns: &[Heading],
    is_in_sections: bool,
    reading: &mut Reading,
) -> Vec<(u64, StringRecord)> {
    let place = |column: Column| columns.iter().position(|heading| matches!(heading, Heading::Known(known, _) if *known == column));
    let is_report = is_in_sections
        || columns
            .iter()
            .any(|heading| matches!(heading, Heading::Known(Column::Well, name) if Column::of_foreign_heading(name).is_some()));
    let (Some(well), true) = (place(Column::Well), is_report) else { return records };
    let well = |record: &StringRecord| record.get(well).and_then(well_of);
    let is_solvent = |record: &StringRecord| {
        let name = place(Column::Compound).and_then(|at| record.get(at)).unwrap_or_default().to_ascii_lowercase();
        // `PBS-1086` is a compound.
        let ends = |rest: &str| rest.chars().next().is_none_or(|next| next.is_whitespace() || "%(,;".contains(next));
        ["dmso", "water", "vehicle", "pbs"].iter().any(|solvent| name.strip_prefix(solvent).is_some_and(ends))
    };
    let cell = |record: &StringRecord, heading: &str| -> Option<String> {
        let at = columns.iter().position(|column| matches!(column, Heading::Unknown(name) if name.eq_ignore_ascii_case(heading)))?;
        record.get(at).map(str::to_owned).filter(|text| !text.is_empty())
    };
    let has_failed = |record: &StringRecord| {
        let states_failure = |status: String| !["ok", "success", "completed"].contains(&status.to_ascii_lowercase().as_str());
        cell(record, "transfer status").is_some_and(states_failure) || cell(record, "actual volume").is_some_and(|ul| ul.parse() == Ok(0.0))
    };
    for (line, record) in records.iter().filter(|(_, record)| has_failed(record)) {
        if let Some(well) = well(record) {
            reading.wrong(Mistake::in_line(*line, "well", format!("the transfer to {well} failed: correct this line, or take it away")));
        }
    }
    let treated: BTreeSet<String> = records.iter().filter(|(_, r)| !is_solvent(r)).filter_map(|(_, r)| well(r)).collect();
    let (mut beside, mut behind) = (0, 0);
    let mut kept: Vec<(u64, StringRecord)> = Vec::new();
    for (line, record) in records {
        let name = well(&record);
        if name.is_none() && record.len() < columns.len() {
            behind += 1;
        } else if is_solvent(&record) && name.is_some_and(|name| treated.contains(&name)) {
            beside += 1;
        } else {
            kept.push((line, record));
        }
    }
    if beside > 0 {
        reading.note(format!("{beside} line(s) of a solvent that was dispensed beside a compound are left out"));
    }
    if behind > 0 {
        reading.note(format!("{behind} line(s) that name no well are left out"));
    }
    kept
}

/// The non-empty records of a text, each with its first line.
struct Rows<'t> {
    text: &'t str,
    reader: csv::Reader<&'t [u8]>,
    lines_before: u64,
}

impl<'t> Rows<'t> {
    fn new(text: &'t str, delimiter: u8, lines_before: u64) -> Self {
        let reader =
            ReaderBuilder::new().has_headers(false).flexible(true).delimiter(delimiter).trim(csv::Trim::All).from_reader(text.as_bytes());
        Self { text, reader, lines_before }
    }

    /// The line of a record. `start` is the position where the reader began to look for it. The reader skips empty lines without counting
    /// them.
    fn line(&self, start: &csv::Position) -> u64 {
        let from = self.text.as_bytes().get(start.byte() as usize..).unwrap_or_default();
        let empty = from.iter().take_while(|&&b| b == b'\n').count() as u64;
        self.lines_before + start.line() + empty
    }
}

impl Iterator for Rows<'_> {
    type Item = (u64, StringRecord);

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let start = self.reader.position().clone();
            let mut record = ByteRecord::new();
            // Reading from memory cannot fail, and records may have any length.
            if !self.reader.read_byte_record(&mut record).unwrap_or(false) {
                return None;
            }
            // The text is UTF-8 and was split at ASCII characters.
            let record = StringRecord::from_byte_record_lossy(record);
            if record.iter().any(|cell| !cell.is_empty()) {
                return Some((self.line(&start), record));
            }
        }
    }
}
