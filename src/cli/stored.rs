//! Compares numbers that were computed again with the stored ones.
//!
//! ```text
//!  equal bytes ────────────────────────────────────────► identical
//!  every stored value again, and more fields ──────────► same (written by an earlier build with fewer fields)
//!  a value that differs or is missing now ─────────────► differs
//! ```

use carved_store::{MEASUREMENT, MeasurementFile, RecordingFiles, durable};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Result of the comparison.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Stored {
    /// No numbers are stored.
    None,
    /// Equal bit for bit.
    Identical,
    /// Every stored value is equal, bit for bit. These fields are not stored: JSON pointers, in which `-` is any element of a list.
    Same { new: BTreeSet<String> },
    /// JSON pointer to the first value that differs or is missing now.
    Differs { at: String },
}

impl Stored {
    /// The name for machine-readable output.
    pub fn word(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Identical => "identical",
            Self::Same { .. } => "same",
            Self::Differs { .. } => "differs",
        }
    }
}

impl std::fmt::Display for Stored {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Self::None | Self::Identical => f.write_str(self.word()),
            Self::Same { new } if new.len() == 1 => write!(f, "same (1 field is new)"),
            Self::Same { new } => write!(f, "same ({} fields are new)", new.len()),
            Self::Differs { at } => write!(f, "differs at {at}"),
        }
    }
}

/// Compares these numbers with those stored in a recording.
///
/// # Errors
/// An existing file that cannot be read.
pub(super) fn compare(files: &RecordingFiles, file: &MeasurementFile) -> anyhow::Result<Stored> {
    let Some(stored) = files.read(MEASUREMENT)? else { return Ok(Stored::None) };
    let ours = durable::json_text(Path::new(MEASUREMENT), file)?;
    if ours == stored {
        return Ok(Stored::Identical);
    }
    // A file that is not JSON was not written by an earlier build.
    let Ok(stored) = serde_json::from_slice(&stored) else { return Ok(Stored::Differs { at: "/".into() }) };
    Ok(beside(&stored, &serde_json::from_slice(&ours)?))
}

fn beside(stored: &Value, ours: &Value) -> Stored {
    let mut new = BTreeSet::new();
    match first_difference(stored, ours, &Place::default(), &mut new) {
        Some(at) => Stored::Differs { at },
        None => Stored::Same { new },
    }
}

/// A path in a document, with and without the indices of list elements.
#[derive(Debug, Clone, Default)]
struct Place {
    pointer: String,
    field: String,
}

impl Place {
    fn key(&self, key: &str) -> Self {
        Self { pointer: format!("{}/{key}", self.pointer), field: format!("{}/{key}", self.field) }
    }

    fn element(&self, index: usize) -> Self {
        Self { pointer: format!("{}/{index}", self.pointer), field: format!("{}/-", self.field) }
    }
}

/// The first path at which `ours` lacks or contradicts a stored value. Additional fields go to `new`.
fn first_difference(stored: &Value, ours: &Value, at: &Place, new: &mut BTreeSet<String>) -> Option<String> {
    match (stored, ours) {
        (Value::Object(stored), Value::Object(ours)) => {
            new.extend(ours.keys().filter(|key| !stored.contains_key(*key)).map(|key| at.key(key).field));
            stored.iter().find_map(|(key, value)| {
                let at = at.key(key);
                ours.get(key).map_or_else(|| Some(at.pointer.clone()), |ours| first_difference(value, ours, &at, new))
            })
        }
        (Value::Array(stored), Value::Array(ours)) if is_named(stored) && is_named(ours) => {
            let of = |list: &[Value], name: &Value| list.iter().find(|element| element["name"] == *name).cloned();
            let fresh = ours.iter().filter(|element| of(stored, &element["name"]).is_none());
            new.extend(fresh.map(|element| at.key(element["name"].as_str().unwrap_or_default()).field));
            stored.iter().enumerate().find_map(|(index, value)| {
                let at = at.element(index);
                of(ours, &value["name"]).map_or_else(|| Some(at.pointer.clone()), |ours| first_difference(value, &ours, &at, new))
            })
        }
        (Value::Array(stored), Value::Array(ours)) if stored.len() == ours.len() => {
            stored.iter().zip(ours).enumerate().find_map(|(index, (stored, ours))| first_difference(stored, ours, &at.element(index), new))
        }
        _ => (stored != ours).then(|| at.pointer.clone()),
    }
}

/// A list whose elements have names, like the quality checks: a further element counts as a further field.
fn is_named(list: &[Value]) -> bool {
    let names: Option<BTreeSet<&str>> = list.iter().map(|element| element["name"].as_str()).collect();
    names.is_some_and(|names| !list.is_empty() && names.len() == list.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn only_what_both_have_is_compared() {
        let stored = json!({"v": 1.5, "flags": ["moved"], "views": [{"r": 0.1}, {"r": null}], "checks": [{"name": "a", "found": 2}]});
        let with = |pointer: &str, value: Value| {
            let mut ours = stored.clone();
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            match ours.pointer_mut(parent).unwrap() {
                Value::Object(parent) => drop(parent.insert(key.into(), value)),
                Value::Array(parent) => parent.push(value),
                other => panic!("{other}"),
            }
            ours
        };
        let new = |fields: &[&str]| Stored::Same { new: fields.iter().map(ToString::to_string).collect() };
        assert_eq!(beside(&stored, &stored), new(&[]));
        assert_eq!(beside(&stored, &with("/sd", json!(0.1))), new(&["/sd"]));
        // The same field in every view counts as one field.
        let mut views = with("/views/0/sd", json!(0.1));
        views["views"][1]["sd"] = json!(0.2);
        assert_eq!(beside(&stored, &views), new(&["/views/-/sd"]));
        assert_eq!(beside(&stored, &with("/checks/-", json!({"name": "b", "found": 1}))), new(&["/checks/b"]));
        for (pointer, value, at) in [
            ("/v", json!(1.500_000_000_000_000_2), "/v"),
            ("/v", Value::Null, "/v"),
            ("/flags/-", json!("residual"), "/flags"),
            ("/views/-", json!({"r": 1}), "/views"),
            ("/views/1/r", json!(0.0), "/views/1/r"),
            ("/checks/0/found", json!(3), "/checks/0/found"),
            ("/checks/0/name", json!("b"), "/checks/0"),
        ] {
            assert_eq!(beside(&stored, &with(pointer, value)), Stored::Differs { at: at.into() }, "{pointer}");
        }
        // Somebody may have published a number that is missing now.
        assert_eq!(beside(&with("/sd", json!(0.1)), &stored), Stored::Differs { at: "/sd".into() });
    }

    #[test]
    fn a_person_reads_how_many_fields_are_new() {
        let same = |n: usize| Stored::Same { new: (0..n).map(|i| i.to_string()).collect() }.to_string();
        assert_eq!((same(1).as_str(), same(3).as_str()), ("same (1 field is new)", "same (3 fields are new)"));
    }
}
