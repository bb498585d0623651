//! A table as Parquet: one row group, plain pages without compression, every column optional.

use super::{Cell, Kind, Table};
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::sync::Arc;

/// The whole file.
///
/// # Errors
/// Columns that Parquet does not take: two of one name.
pub fn bytes(table: &Table) -> Result<Vec<u8>, ParquetError> {
    let column = |heading: &super::Heading| {
        let (physical, logical) = match heading.kind {
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Kind::Number => (Physical::DOUBLE, None),
            Kind::Integer => (Physical::INT64, None),
            Kind::Truth => (Physical::BOOLEAN, None),
        };
        let builder = Type::primitive_type_builder(&heading.name, physical).with_repetition(Repetition::OPTIONAL);
        builder.with_logical_type(logical).build().map(Arc::new)
    };
    let columns = table.headings.iter().map(column).collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("carved").with_fields(columns).build()?);
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(WriterProperties::new()))?;
    let mut rows = writer.next_row_group()?;
    let mut place = 0;
    while let Some(mut column) = rows.next_column()? {
        let cells = table.rows.iter().map(|row| &row[place]);
        // 1 for a value, 0 for none.
        let levels: Vec<i16> = cells.clone().map(|cell| i16::from(*cell != Cell::Empty)).collect();
        match column.untyped() {
            ColumnWriter::ByteArrayColumnWriter(writer) => {
                writer.write_batch(&cells.filter_map(text).collect::<Vec<_>>(), Some(&levels), None)
            }
            ColumnWriter::DoubleColumnWriter(writer) => {
                writer.write_batch(&cells.filter_map(number).collect::<Vec<_>>(), Some(&levels), None)
            }
            ColumnWriter::Int64ColumnWriter(writer) => {
                writer.write_batch(&cells.filter_map(integer).collect::<Vec<_>>(), Some(&levels), None)
            }
            ColumnWriter::BoolColumnWriter(writer) => writer.write_batch(&cells.filter_map(truth).collect::<Vec<_>>(), Some(&levels), None),
            _ => return Err(ParquetError::General(format!("column {place} is of a type that the table does not have"))),
        }?;
        column.close()?;
        place += 1;
    }
    rows.close()?;
    writer.into_inner()
}

fn text(cell: &Cell) -> Option<ByteArray> {
    if let Cell::Text(text) = cell { Some(text.as_str().into()) } else { None }
}

fn number(cell: &Cell) -> Option<f64> {
    if let Cell::Number(number) = cell { Some(*number) } else { None }
}

fn integer(cell: &Cell) -> Option<i64> {
    if let Cell::Integer(integer) = cell { Some(*integer) } else { None }
}

fn truth(cell: &Cell) -> Option<bool> {
    if let Cell::Truth(truth) = cell { Some(*truth) } else { None }
}

#[cfg(test)]
mod tests {
    use super::super::Heading;
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    #[test]
    fn what_is_written_is_read_back_with_its_gaps() {
        let kinds = [("well", Kind::Text), ("volume_um3", Kind::Number), ("views", Kind::Integer), ("qc_passed", Kind::Truth)];
        let headings = kinds.map(|(name, kind)| Heading { name: name.into(), kind }).to_vec();
        let rows = vec![
            vec![Cell::from("A01"), Cell::from(2.5e8), Cell::from(21u32), Cell::from(true)],
            vec![Cell::from("A02"), Cell::Empty, Cell::Empty, Cell::Empty],
            vec![Cell::Empty, Cell::from(1.0), Cell::from(7u32), Cell::from(false)],
        ];
        let file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut &file, &bytes(&Table { headings, rows }).unwrap()).unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        let read: Vec<Vec<Field>> = reader
            .get_row_iter(None)
            .unwrap()
            .map(|row| row.unwrap().get_column_iter().map(|(_, field)| field.clone()).collect())
            .collect();
        assert_eq!(read[0], [Field::Str("A01".into()), Field::Double(2.5e8), Field::Long(21), Field::Bool(true)]);
        assert_eq!(read[1], [Field::Str("A02".into()), Field::Null, Field::Null, Field::Null]);
        assert_eq!(read[2], [Field::Null, Field::Double(1.0), Field::Long(7), Field::Bool(false)]);
    }
}
