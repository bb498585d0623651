//! The columns of a table that another program or person made: what each of them seems to be, and what somebody says that it is.
//!
//! ```text
//! CSV ──> propose: heading and cells of each column ──> a person corrects ──> read_mapped: as any plate map
//! ```
//! A proposal is only shown. Nothing is read by it before somebody has seen it.

use super::cell::{Column, well_of};
use super::number::{self, Decimal};
use super::{Mistake, Reading, table};
use crate::ConcentrationUnit;
use serde::{Deserialize, Serialize};

/// What a column of a file is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct MappedColumn {
    /// Its heading in the file.
    pub heading: String,
    /// What it is read as. `null`: a column of the lab, which is kept as it is.
    pub column: Option<Column>,
    /// The unit of a concentration, where no column of the file has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<ConcentrationUnit>,
}

/// The columns of a file, with what each seems to be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct ColumnProposal {
    /// Line of the headings, from 1.
    pub line: u64,
    /// Number of lines below the headings.
    pub rows: u64,
    pub columns: Vec<ProposedColumn>,
}

/// A column of a file, with what it seems to be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct ProposedColumn {
    pub heading: String,
    /// What it seems to be. `null`: a column of the lab, which is kept as it is.
    pub column: Option<Column>,
    /// The unit that the heading of a concentration names.
    pub unit: Option<ConcentrationUnit>,
    /// Whether the heading is carved's own name of the column.
    pub is_own_name: bool,
    /// Its first different cells.
    pub examples: Vec<String>,
}

/// Number of cells that are shown of a column.
const EXAMPLES: usize = 3;
/// Most columns of a table whose columns are proposed.
const MOST_COLUMNS: usize = 500;

/// What the columns of a CSV seem to be. No column is proposed twice, and none whose cells it could not read.
///
/// # Errors
/// The file is no table, or is in the layout of the plate, which has no headings.
pub fn propose(bytes: &[u8]) -> Result<ColumnProposal, Vec<Mistake>> {
    let mut reading = Reading::default();
    let table = table::headed(bytes, &mut reading).ok_or_else(|| std::mem::take(&mut reading.mistakes))?;
    if table.headings.len() > MOST_COLUMNS {
        let detail = format!("{} columns; at most {MOST_COLUMNS} can be named", table.headings.len());
        return Err(vec![Mistake::in_line(table.line, "", detail)]);
    }
    let cells = |at: usize| table.rows.iter().filter_map(move |row| row.get(at)).filter(|cell| !cell.is_empty());
    let mut columns: Vec<ProposedColumn> = Vec::new();
    for (at, heading) in table.headings.iter().enumerate() {
        let mut examples: Vec<String> = Vec::new();
        for cell in cells(at) {
            if examples.len() < EXAMPLES && !examples.iter().any(|known| known == cell) {
                examples.push(cell.to_owned());
            }
        }
        columns.push(ProposedColumn { heading: heading.to_owned(), column: None, unit: None, is_own_name: false, examples });
    }
    // The surest reason first: a later one takes only columns that are free.
    let rules: [fn(&str) -> Option<Column>; 3] = [Column::of_heading, Column::of_foreign_heading, by_words];
    for rule in rules {
        for at in 0..columns.len() {
            let Some(column) = rule(&columns[at].heading) else { continue };
            let is_free = columns[at].column.is_none() && columns.iter().all(|other| other.column != Some(column));
            if is_free && (is_readable(column, cells(at), table.decimal) || Column::of_heading(&columns[at].heading).is_some()) {
                columns[at].column = Some(column);
            }
        }
    }
    if columns.iter().all(|found| found.column != Some(Column::Well))
        && let Some(at) = (0..columns.len()).find(|&at| {
            let found = &columns[at];
            found.column.is_none() && !is_of_source(&words_of(&found.heading)) && is_readable(Column::Well, cells(at), table.decimal)
        })
    {
        columns[at].column = Some(Column::Well);
    }
    let has_units = columns.iter().any(|found| found.column == Some(Column::ConcentrationUnit));
    for found in &mut columns {
        found.is_own_name = found.column.is_some() && Column::of_heading(&found.heading) == found.column;
        found.unit = unit_of(&found.heading).filter(|_| found.column == Some(Column::Concentration) && !has_units);
    }
    Ok(ColumnProposal { line: table.line, rows: table.rows.len() as u64, columns })
}

/// The words of a heading, without a unit in brackets.
fn words_of(heading: &str) -> Vec<String> {
    let plain = heading.split(['(', '[']).next().unwrap_or_default();
    plain.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(str::to_lowercase).collect()
}

/// Whether a heading is that of the plate from which a dispenser takes. Its wells are not those of the measured plate.
fn is_of_source(words: &[String]) -> bool {
    words.iter().any(|word| ["source", "src"].contains(&word.as_str()))
}

/// The column that the words of a heading suggest.
fn by_words(heading: &str) -> Option<Column> {
    const WORDS: [(&[&str], Column); 9] = [
        (&["well", "wells", "position", "pos", "wellid", "coordinate", "coordinates"], Column::Well),
        (&["unit", "units"], Column::ConcentrationUnit),
        (&["conc", "concentration", "dose", "dosage"], Column::Concentration),
        (&["compound", "drug", "chemical", "substance", "molecule"], Column::Compound),
        (&["strain", "genotype", "line"], Column::Strain),
        (&["treatment", "condition", "exposure"], Column::Treatment),
        (&["replicate", "rep", "repeat"], Column::Replicate),
        (&["control", "ctrl"], Column::Control),
        (&["dpf", "age"], Column::Dpf),
    ];
    let words = words_of(heading);
    if is_of_source(&words) {
        return None;
    }
    let found = WORDS.into_iter().find(|(known, _)| words.iter().any(|word| known.contains(&word.as_str())));
    found.map(|(_, column)| column).or_else(|| (words == ["specimen", "type"]).then_some(Column::Specimen))
}

/// The unit in a heading: in brackets, or as its last word, as in `Dose (uM)` and `conc_uM`.
fn unit_of(heading: &str) -> Option<ConcentrationUnit> {
    let inside = heading.rfind(['(', '[']).map(|at| heading[at + 1..].trim_end_matches([')', ']']));
    let last = heading.rsplit([' ', '_']).next();
    inside.and_then(ConcentrationUnit::from_file).or_else(|| last.filter(|word| *word != heading).and_then(ConcentrationUnit::from_file))
}

/// Whether every cell can be read as this column, and there is one.
fn is_readable<'a>(column: Column, mut cells: impl Iterator<Item = &'a str> + Clone, decimal: Decimal) -> bool {
    let is_number = |cell: &str| number::read(cell, decimal).is_ok();
    let is_one_of = |cell: &str, words: &[&str]| words.iter().any(|word| word.eq_ignore_ascii_case(cell));
    cells.clone().next().is_some()
        && cells.all(|cell| match column {
            Column::Well => well_of(cell).is_some(),
            Column::Concentration => is_number(cell),
            Column::Dpf => number::read(cell, decimal).is_ok_and(|age| (0.0..=30.0).contains(&age)),
            Column::ConcentrationUnit => ConcentrationUnit::from_file(cell).is_some(),
            Column::Replicate => cell.parse::<u32>().is_ok_and(|number| number > 0),
            Column::Control => is_one_of(cell, &["positive", "negative"]),
            Column::Specimen => is_one_of(cell, &["larva", "bead"]),
            Column::Compound | Column::Strain | Column::Treatment => true,
        })
}

#[cfg(test)]
mod tests {
    use super::super::{PlateMap, read_mapped};
    use super::*;

    const FOREIGN: &str = "Plate layout of 3 March\n\
        Position;Line;Drug;Dose (µM);Type;Rep;Batch;Remark\n\
        a1;AB;valproate;1,5;test;1;7;\n\
        a2;AB;valproate;50;test;2;7;pale\n\
        a3;AB;DMSO;;vehicle;1;7;\n";

    fn proposed(text: &str) -> Vec<(String, Option<Column>, Option<ConcentrationUnit>)> {
        propose(text.as_bytes()).unwrap().columns.into_iter().map(|found| (found.heading, found.column, found.unit)).collect()
    }

    fn mapped(text: &str) -> Vec<MappedColumn> {
        proposed(text).into_iter().map(|(heading, column, unit)| MappedColumn { heading, column, unit }).collect()
    }

    fn read(text: &str, columns: &[MappedColumn]) -> Result<PlateMap, Vec<String>> {
        read_mapped(text.as_bytes(), None, columns).map_err(|mistakes| mistakes.iter().map(ToString::to_string).collect())
    }

    #[test]
    fn the_columns_of_a_foreign_table_are_proposed_by_their_headings_and_cells() {
        let found = propose(FOREIGN.as_bytes()).unwrap();
        assert_eq!((found.line, found.rows), (2, 3));
        let of = |heading: &str| found.columns.iter().find(|column| column.heading == heading).unwrap();
        for (heading, column) in [
            ("Position", Some(Column::Well)),
            ("Line", Some(Column::Strain)),
            ("Drug", Some(Column::Compound)),
            ("Dose (µM)", Some(Column::Concentration)),
            ("Type", None),
            ("Rep", Some(Column::Replicate)),
            ("Batch", None),
        ] {
            assert_eq!(of(heading).column, column, "{heading}");
        }
        assert_eq!(of("Dose (µM)").unit, Some(ConcentrationUnit::Micromolar));
        assert_eq!(of("Drug").examples, ["valproate", "DMSO"]);
        assert!(found.columns.iter().all(|column| !column.is_own_name));
    }

    #[test]
    fn a_table_is_read_as_a_person_says_and_the_mapping_is_kept() {
        let mut columns = mapped(FOREIGN);
        let map = read(FOREIGN, &columns).unwrap();
        let second = &map.plate_map[1];
        assert_eq!((second.well.as_str(), second.strain.as_deref(), second.compound.as_deref()), ("A02", Some("AB"), Some("valproate")));
        assert_eq!((second.concentration, second.concentration_unit), (Some(50.0), Some(ConcentrationUnit::Micromolar)));
        assert_eq!((second.replicate, map.plate_map[0].concentration), (Some(2), Some(1.5)));
        assert_eq!(map.metadata["columns"]["Remark"]["A02"], "pale");
        assert_eq!(map.metadata["columns"]["Type"]["A03"], "vehicle");
        let kept: Vec<MappedColumn> = serde_json::from_value(map.metadata["column_mapping"].clone()).unwrap();
        assert_eq!(kept, columns);
        // The person corrects: the type is the treatment, and the doses are in another unit.
        columns[4].column = Some(Column::Treatment);
        columns[3].unit = Some(ConcentrationUnit::Nanomolar);
        let map = read(FOREIGN, &columns).unwrap();
        assert_eq!(map.plate_map[2].treatment.as_deref(), Some("vehicle"));
        assert_eq!(map.plate_map[1].concentration_unit, Some(ConcentrationUnit::Nanomolar));
        assert!(map.metadata["columns"].get("Type").is_none());
    }

    #[test]
    fn what_a_mapping_gets_wrong_is_said_with_its_place() {
        let with = |change: fn(&mut Vec<MappedColumn>)| {
            let mut columns = mapped(FOREIGN);
            change(&mut columns);
            read(FOREIGN, &columns).unwrap_err().join("; ")
        };
        assert!(with(|columns| columns[0].column = None).contains("the column well is missing"));
        assert!(with(|columns| columns[1].column = Some(Column::Compound)).contains("line 2, Drug: the column compound is there twice"));
        assert!(with(|columns| columns[3].unit = None).contains("the concentration 1.5 has no unit"));
        assert!(with(|columns| columns[4].column = Some(Column::Control)).contains("line 3, Type"));
        assert!(with(|columns| columns[0].heading = "Well".into()).contains("no line has the columns"));
    }

    #[test]
    fn no_column_is_proposed_that_its_cells_contradict() {
        let found = proposed("Well,Dose,Rep,control,Age\nA1,high,first,yes,48 hpf\nA2,low,second,no,72 hpf\n");
        let columns: Vec<_> = found.into_iter().map(|(_, column, _)| column).collect();
        assert_eq!(
            columns,
            [Some(Column::Well), None, None, Some(Column::Control), None],
            "carved's own name stays, and its cells are mistakes"
        );
        // Without a heading that says so, the cells of the wells do.
        assert_eq!(proposed("Where,What\nB2,x\nB3,y\n")[0].1, Some(Column::Well));
        assert_eq!(proposed("conc_uM,Pos\n1,A1\n")[0].2, Some(ConcentrationUnit::Micromolar));
    }

    #[test]
    fn a_table_of_ours_and_an_echos_report_are_proposed_as_they_are_read() {
        let own = propose(b"well,compound,concentration,concentration_unit\nA01,x,1,uM\n").unwrap();
        assert!(own.columns.iter().all(|column| column.is_own_name), "{own:?}");
        let echo =
            "Run ID,7\n[DETAILS]\nDestination Well,Sample Name,Destination Concentration,Destination Concentration Units\nA1,x,1,uM\n";
        let columns: Vec<_> = proposed(echo).into_iter().map(|(_, column, _)| column).collect();
        assert_eq!(columns, [Column::Well, Column::Compound, Column::Concentration, Column::ConcentrationUnit].map(Some));
        for no_table in [&b""[..], b"compound,1,2,3\nA,x,y,z\n", b"\"", b"\xff\xfe\x00"] {
            assert!(propose(no_table).is_err(), "{no_table:?}");
        }
    }

    /// The transfers that failed are listed under the same headings, before or behind those that were made.
    #[test]
    fn a_report_with_exceptions_is_proposed_and_read_by_its_details() {
        let head = "Src Well,Dest Well,Substance,Conc (uM),Transfer Status";
        let made = format!("[DETAILS]\n{head}\nA1,B3,rapamycin,5,\nA2,B4,DMSO,,\n\nInstrument Name,E5XX-1\n");
        let failed = format!("[EXCEPTIONS]\n{head}\nA1,C1,rapamycin,5,MM0202007\nA1,C2,rapamycin,5,MM0202007\nA1,C3,x,5,MM0202007\n\n");
        for report in [format!("Run ID,7\n\n{failed}{made}"), format!("Run ID,7\n\n{made}\n{failed}")] {
            let found = propose(report.as_bytes()).unwrap();
            assert_eq!(found.columns[1].column, Some(Column::Well), "{found:?}");
            assert_eq!(found.columns[1].examples, ["B3", "B4"]);
            let mut columns = mapped(&report);
            for found in &mut columns {
                found.column = None;
            }
            for (at, column) in [(1, Column::Well), (2, Column::Compound), (3, Column::Concentration)] {
                columns[at].column = Some(column);
            }
            let map = read(&report, &columns).unwrap();
            assert_eq!(map.plate_map.iter().map(|planned| planned.well.as_str()).collect::<Vec<_>>(), ["B03", "B04"]);
            assert_eq!(map.plate_map[0].compound.as_deref(), Some("rapamycin"));
            assert!(map.notes.iter().any(|note| note.contains("the transfers of this section failed")), "{:?}", map.notes);
        }
    }

    /// A line with a cell too many is a mistake of that line, not the headings.
    #[test]
    fn one_bad_line_does_not_hide_the_headings() {
        let own = propose(b"well,compound,concentration,concentration_unit\nA01,x,1,uM\nA02,x,1,5,uM\n").unwrap();
        assert_eq!((own.line, own.columns.len()), (1, 4), "{own:?}");
        assert!(own.columns.iter().all(|column| column.is_own_name));
        let foreign = "Layout of May\nPosition,Drug,Dose (uM)\nA1,x,1\nA2,x,1,5\nA3,y,2\n";
        assert_eq!(propose(foreign.as_bytes()).unwrap().line, 2);
        let wrong = read(foreign, &mapped(foreign)).unwrap_err();
        assert!(wrong.len() == 1 && wrong[0].contains("line 4: 4 cells, the heading has 3 columns"), "{wrong:?}");
    }

    /// A unit is that of the concentration alone: of two that are named, the other one would be taken for it.
    #[test]
    fn the_unit_of_another_column_is_not_taken_for_that_of_the_concentration() {
        const TWO: &str = "Well,Stock conc (mM),Dose (nM)\nA01,10,3\n";
        let of = |heading: &str, column, unit| MappedColumn { heading: heading.to_owned(), column, unit };
        let columns = |stock_unit, dose_unit| {
            [
                of("Well", Some(Column::Well), None),
                of("Stock conc (mM)", None, stock_unit),
                of("Dose (nM)", Some(Column::Concentration), dose_unit),
            ]
        };
        let [milli, nano] = ["mM", "nM"].map(unit_of_symbol);
        assert!(read_mapped(TWO.as_bytes(), None, &columns(milli, nano)).is_err(), "a unit of a column that is kept as it is");
        assert!(read_mapped(TWO.as_bytes(), None, &columns(milli, None)).is_err());
        let read = read_mapped(TWO.as_bytes(), None, &columns(None, nano)).unwrap();
        assert_eq!(read.plate_map[0].concentration_unit, nano);
    }

    fn unit_of_symbol(symbol: &str) -> Option<ConcentrationUnit> {
        unit_of(&format!("Dose ({symbol})"))
    }
}
