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
    written(table, str::to_owned)
}

/// The whole file for a spreadsheet: with the byte order mark by which it recognises UTF-8, and without formulas.
pub fn for_spreadsheet(table: &Table) -> String {
    format!("\u{feff}{}", written(table, harmless))
}

/// The signs that begin a formula, in the three widths that spreadsheets of East Asian languages read as one.
const FORMULA: [char; 12] = ['=', '+', '-', '@', '＝', '＋', '－', '＠', '﹦', '﹢', '﹣', '﹫'];

/// Marks a text that a spreadsheet would compute as text, with an apostrophe before it: one that begins with the sign of a formula, also after
/// characters that a spreadsheet may leave out, or with a control character such as a new line. A text that is a number stays.
fn harmless(text: &str) -> String {
    let is_left_out =
        |c: char| c.is_whitespace() || c.is_control() || matches!(c, '\u{ad}' | '\u{200b}'..='\u{200f}' | '\u{2060}' | '\u{feff}');
    let shown = text.trim_start_matches(is_left_out);
    let is_formula = text.starts_with(char::is_control) || shown.starts_with(FORMULA);
    if is_formula && text.trim().parse::<f64>().is_err() { format!("'{text}") } else { text.to_owned() }
}

fn written(table: &Table, of_text: fn(&str) -> String) -> String {
    let mut writer = WriterBuilder::new().terminator(Terminator::CRLF).from_writer(Vec::new());
    let headings = table.headings.iter().map(|heading| heading.name.clone()).collect();
    let of_cell = |written: &Cell| match written {
        Cell::Text(text) => of_text(text),
        other => cell(other),
    };
    let rows = table.rows.iter().map(|row| row.iter().map(of_cell).collect::<Vec<_>>());
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

    #[test]
    fn a_spreadsheet_computes_no_cell_and_numbers_stay_numbers() {
        let headings = [("text", Kind::Text), ("z", Kind::Number)].map(|(name, kind)| Heading { name: name.into(), kind }).to_vec();
        let formulas = [
            "=1+1",
            "+x",
            "-x",
            "@SUM(A1)",
            "\t=1",
            "\r=1",
            "=a,b",
            "\n=1+1",
            "\r\n@x",
            "\nDMSO",
            " =1",
            "\u{a0}+x",
            "\u{3000}=1",
            "\u{feff}=1",
            "\u{200b}-x",
            " \n =1",
            "＝1+1",
            "＋x",
            "－x",
            "＠SUM(A1)",
            " ＝1",
            "﹦1",
        ];
        let texts = ["DMSO", "a=b", "-3.1", "+5e-3", "\u{b5}M", " DMSO", " -3.1", "a\n=1"];
        let rows = formulas.iter().chain(&texts).map(|text| vec![Cell::from(*text), Cell::from(-3.5)]).collect();
        let table = Table { headings, rows };
        let of = |text: &str| {
            let mut reader = ::csv::ReaderBuilder::new().has_headers(false).from_reader(text.as_bytes());
            reader.records().map(|row| row.unwrap().iter().map(str::to_owned).collect::<Vec<_>>()).collect::<Vec<_>>()
        };
        let text = for_spreadsheet(&table);
        let read = of(text.strip_prefix('\u{feff}').unwrap());
        let marked = formulas.iter().map(|formula| format!("'{formula}"));
        let expected: Vec<String> = marked.chain(texts.map(str::to_owned)).collect();
        assert_eq!(read[1..].iter().map(|row| row[0].clone()).collect::<Vec<_>>(), expected);
        assert!(read[1..].iter().all(|row| row[1] == "-3.5"), "{text}");
        assert_eq!(of(&super::text(&table))[1][0], "=1+1", "programs read every cell as it is");
    }
}
