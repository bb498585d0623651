//! The JSON forms: carved's own wells, and MIHCSME metadata.

use super::cell::{Cell, Column, Row};
use super::number::Decimal;
use super::{Mistake, Place, Reading, mihcsme};
use serde_json::Value;

pub fn read(bytes: &[u8], plate: Option<&str>, reading: &mut Reading) {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match serde_json::from_slice(bytes) {
        Err(why) => {
            let place = Mistake::at("", format!("this is not JSON: {why}"));
            reading.wrong(Mistake { line: Some(why.line().max(1) as u64), ..place });
        }
        Ok(Value::Array(wells)) => self::wells(&wells, "", reading),
        Ok(Value::Object(mut document)) => {
            if mihcsme::is_one(&document) {
                mihcsme::read(document, plate, reading);
                return;
            }
            match document.remove("metadata") {
                None => {}
                Some(Value::Object(metadata)) => reading.map.metadata = metadata,
                Some(_) => reading.wrong(Mistake::at("/metadata", "metadata is an object, or is left out")),
            }
            match document.remove("plate_format") {
                None | Some(Value::Null) => {}
                Some(format) => reading.on_plate(&format),
            }
            // What a check answered can be checked again.
            document.remove("notes");
            document.remove("confirm");
            match document.remove("plate_map") {
                Some(Value::Array(wells)) => self::wells(&wells, "/plate_map", reading),
                Some(_) => reading.wrong(Mistake::at("/plate_map", "plate_map is a list of wells")),
                None => {
                    reading
                        .wrong(Mistake::at("/plate_map", "plate_map is missing, and assay_conditions or AssayConditions of MIHCSME too"));
                }
            }
            for key in document.keys() {
                reading
                    .wrong(Mistake::at(format!("/{}", escape(key)), "unknown field; the known ones are plate_format, plate_map, metadata"));
            }
        }
        Ok(_) => reading.wrong(Mistake::at("", "expected a list of wells, or an object with plate_map")),
    }
}

fn wells(wells: &[Value], at: &str, reading: &mut Reading) {
    for (i, well) in wells.iter().enumerate() {
        let place = Place::Pointer(format!("{at}/{i}"));
        let Value::Object(fields) = well else {
            reading.wrong(place.mistake("", "expected an object with a well"));
            continue;
        };
        let mut cells = Vec::new();
        for (key, value) in fields {
            match Column::of_heading(key) {
                None => reading.wrong(place.mistake(&escape(key), format!("unknown field; the known ones are {}", Column::known()))),
                Some(column) => match text_of(value) {
                    Err(detail) => reading.wrong(place.mistake(&escape(key), detail)),
                    Ok(text) if text.is_empty() => {}
                    Ok(text) => cells.push(Cell { column, name: escape(key), text }),
                },
            }
        }
        reading.row(&Row { place, decimal: Decimal::Point, cells });
    }
}

/// A key in a JSON pointer (RFC 6901).
pub fn escape(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}

/// A value as the text of a cell. `null` is empty.
pub fn text_of(value: &Value) -> Result<String, String> {
    match value {
        Value::Null => Ok(String::new()),
        Value::String(text) => Ok(text.trim().to_owned()),
        Value::Number(number) => Ok(number.to_string()),
        Value::Bool(_) | Value::Array(_) | Value::Object(_) => Err(format!("expected a text or a number, found {value:.60}")),
    }
}
