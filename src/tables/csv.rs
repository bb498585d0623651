//! A table as CSV that pandas, polars, `DuckDB` and R read without options (RFC 4180, UTF-8, comma, point).
//!
//! * A decimal number has a point or an exponent, so that a column does not begin with integers and end with decimals: polars derives types
//!   from the first rows.
//! * `TRUE` and `FALSE`: R takes `true` beside an empty cell for text.
//! * An empty cell is a value that is not known or does not apply. An empty text does not exist.

use super::{Cell, Table};
use csv::{Terminator, WriterBuilder};

/// The whole file.
pub fn text(table: &Table) -> String {
    let mut writer = WriterBuilder::new().terminator(Terminator::CRLF).from_writer(Vec::new());
    let headings = table.headings.iter().map(|heading| heading.name.clone()).collect();
    let rows = table.rows.iter().map(|row| row.iter().map(cell).collect::<Vec<_>>());
    for row in std::iter::once(headings).chain(rows) {
        // Every row has a cell per heading, and memory takes what is written.
        if let Err(error) = writer.write_record(&row) {
            tracing::error!(%error, "a row of a table is not written");
        }
    }
    // Of cells that are UTF-8.
    writer.into_inner().map_or_else(|_| String::new(), |bytes| String::from_utf8_lossy(&bytes).into_owned())
}

/// The text of a cell. Empty where it has no value.
pub fn cell(cell: &Cell) -> String {
    match cell {
        Cell::Empty => String::new(),
        Cell::Text(text) => text.clone(),
        // The shortest text that is the same number again, always with a point or an exponent.
        Cell::Number(number) => format!("{number:?}"),
        Cell::Integer(number) => number.to_string(),
        Cell::Truth(true) => "TRUE".to_owned(),
        Cell::Truth(false) => "FALSE".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Heading, Kind};
    use super::*;

    #[test]
    fn a_reader_of_csv_finds_every_cell_as_it_was() {
        let kinds = [("text, \"one\"", Kind::Text), ("x_um", Kind::Number), ("n", Kind::Integer), ("is", Kind::Truth)];
        let headings = kinds.map(|(name, kind)| Heading { name: name.into(), kind }).to_vec();
        let rows = vec![
            vec![Cell::from("a \"b\", c\nd"), Cell::from(5.0), Cell::from(3u32), Cell::from(true)],
            vec![Cell::from("0017"), Cell::from(1.25e-9), Cell::from(f64::NAN), Cell::Empty],
            vec![Cell::from(""), Cell::from(3.0e20), Cell::from(None::<u32>), Cell::from(false)],
        ];
        let text = text(&Table { headings, rows });
        let mut reader = ::csv::Reader::from_reader(text.as_bytes());
        assert_eq!(reader.headers().unwrap(), vec!["text, \"one\"", "x_um", "n", "is"]);
        let read: Vec<Vec<String>> = reader.records().map(|r| r.unwrap().iter().map(str::to_owned).collect()).collect();
        assert_eq!(read[0], ["a \"b\", c\nd", "5.0", "3", "TRUE"]);
        assert_eq!(read[1], ["0017", "1.25e-9", "", ""]);
        assert_eq!(read[2], ["", "3e20", "", "FALSE"]);
        assert!(text.contains("\r\n0017,1.25e-9,,\r\n") && text.ends_with("FALSE\r\n"), "{text}");
    }
}
