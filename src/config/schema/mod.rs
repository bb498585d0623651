//! The schema of the configuration, which is generated from the types of the settings.
//!
//! ```text
//! types of the settings: fields, defaults, documentation ── schemars ──┐
//! RANGES ───────────────────────────────────────────────── in_schema ──┼─> tidy ─> schema ─┬─> `carved config schema`, for editors
//! x-level of the fields ───────────────────────────────────────────────┘                   └─> keys ─> reference_page, and the tests
//! ```
//! No key is listed a second time.

mod keys;
mod page;

pub use keys::{Key, keys};
pub use page::reference_page;

use super::raw::Raw;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value};

const LEVEL: &str = "x-level";

/// The JSON schema (draft 2020-12) of a configuration. Each key also has `x-level` (who sets it: `operator`, `method` or `expert`), and
/// each number has `x-unit`.
pub fn schema() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| settings.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<Raw>().to_value();
    schema["title"] = "Configuration of carved".into();
    tidy(&mut schema, None, None);
    schema
}

/// Removes what TOML cannot express, and gives each key its own level and default.
fn tidy(node: &mut Value, level: Option<&str>, default: Option<Value>) {
    without_null(node);
    let Value::Object(found) = node else { return };
    found.remove("format");
    let own = found.remove(LEVEL);
    let level = own.as_ref().and_then(Value::as_str).or(level);
    let default = found.remove("default").or(default).filter(|value| !value.is_null());
    let required: Vec<Value> = found.get("required").and_then(Value::as_array).cloned().unwrap_or_default();
    if let Some(Value::Object(properties)) = found.get_mut("properties") {
        for (key, child) in properties {
            // The required keys of a table with a default have no default of their own.
            let own = default.as_ref().and_then(|table| table.get(key)).filter(|_| !required.iter().any(|name| name == key));
            tidy(child, level, own.cloned());
        }
    }
    if let Some(child @ Value::Object(_)) = found.get_mut("additionalProperties") {
        tidy(child, level, None);
    }
    for choice in ["oneOf", "anyOf"] {
        for variant in found.get_mut(choice).and_then(Value::as_array_mut).into_iter().flatten() {
            if variant.get("properties").is_some() {
                describe_only_key(variant);
                tidy(variant, level, None);
            }
        }
    }
    // The allowed values of a list need no range.
    if found.contains_key("enum") {
        found.remove("minimum");
        found.remove("maximum");
    }
    // A table with a driver also represents the key `driver`.
    let is_key = !(found.contains_key("properties") || found.contains_key("additionalProperties"));
    if is_key {
        found.extend(level.map(|level| (LEVEL.to_owned(), level.into())));
    }
    if is_key || !required.is_empty() {
        found.extend(default.map(|default| ("default".to_owned(), default)));
    }
}

/// For a value such as `{ line = "Line1" }`, the description is at the variant. Copies it to the key.
fn describe_only_key(variant: &mut Value) {
    let about = variant["description"].clone();
    let Some(Value::Object(properties)) = variant.get_mut("properties") else { return };
    if let (1, Some(only), true) = (properties.len(), properties.values_mut().next(), about.is_string())
        && only.get("description").is_none()
    {
        only["description"] = about;
    }
}

/// Removes null. TOML has no null, so an optional key cannot be null.
fn without_null(node: &mut Value) {
    let Value::Object(found) = node else { return };
    if let Some(Value::Array(types)) = found.get_mut("type") {
        types.retain(|name| name != "null");
        if let [name] = types.as_slice() {
            let name = name.clone();
            found.insert("type".into(), name);
        }
    }
    let Some(Value::Array(variants)) = found.get_mut("anyOf") else { return };
    variants.retain(|variant| variant["type"] != "null");
    if let [Value::Object(only)] = variants.as_slice() {
        // The description of the key overrides that of its type.
        let mut merged: Map<String, Value> = only.clone();
        found.remove("anyOf");
        merged.append(found);
        *found = merged;
    }
}
