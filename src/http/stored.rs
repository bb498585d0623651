//! The schemas of `recording.json` and `measurement.json`, which an answer contains as they are stored.
//!
//! ```text
//! types of the files: carved-store, carved-records, carved-core ── schemars ─> as_stored ─> components `Stored...` of the contract
//! ```
//! A schema requires what this program requires of a file. A field that an earlier version did not write has a default in its type, or is
//! an `Option`, and is therefore not required. Other fields are allowed, because an earlier version may have written some that this one
//! does not know any more.

use carved_store::{MeasurementFile, Recording};
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema, generate::SchemaSettings};
use serde_json::{Map, Value};
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, RefBuilder, Type};

/// Every name of these schemas begins with this, and no other one does. The types of files and those of the API may have the same name.
const PREFIX: &str = "Stored";
const COMPONENTS: &str = "/components/schemas";

/// The schemas by their names, with those of all types that they refer to.
pub(super) fn schemas() -> Map<String, Value> {
    let settings = SchemaSettings::draft2020_12().with(|settings| settings.definitions_path = COMPONENTS.into());
    let mut generator = settings.with_transform(RecursiveTransform(as_stored)).into_generator();
    generator.subschema_for::<Recording>();
    generator.subschema_for::<MeasurementFile>();
    generator.take_definitions(true).into_iter().map(|(name, schema)| (format!("{PREFIX}{name}"), schema)).collect()
}

/// Gives a schema its name in the contract, and removes what holds for a setting and not for a document: its default and level, the range
/// that this version accepts, and that other keys are refused.
fn as_stored(schema: &mut Schema) {
    if let Some(Value::String(reference)) = schema.get_mut("$ref") {
        *reference = reference.replacen(&format!("{COMPONENTS}/"), &format!("{COMPONENTS}/{PREFIX}"), 1);
    }
    if let Some(Value::String(description)) = schema.get_mut("description") {
        *description = description.replace("`None`", "`null`");
    }
    // The type of a map's values stays.
    if schema.get("additionalProperties").is_some_and(Value::is_boolean) {
        schema.remove("additionalProperties");
    }
    schema.remove("default");
    schema.remove("x-level");
    if schema.get("x-unit").is_some() {
        schema.remove("minimum");
        schema.remove("maximum");
    }
}

fn reference<T: JsonSchema>(description: &str) -> RefBuilder {
    let name = format!("{PREFIX}{}", T::schema_name());
    RefBuilder::new().ref_location_from_schema_name(name).description(Some(description))
}

/// Schema of `recording` in [`super::results::SpecimenDetail`].
pub(super) fn recording() -> RefBuilder {
    reference::<Recording>("`recording.json`: rig, method, ledger. One of an earlier version may lack fields that are not required.")
}

/// Schema of `measurement` in [`super::results::SpecimenDetail`].
pub(super) fn measurement() -> OneOfBuilder {
    let file = reference::<MeasurementFile>(
        "`measurement.json` with its flags and every view's quality; `null` without numbers. One of an earlier version may lack fields that \
         are not required.",
    );
    OneOfBuilder::new().item(file).item(ObjectBuilder::new().schema_type(Type::Null))
}

#[cfg(test)]
mod tests {
    use super::super::openapi;
    use super::*;

    #[test]
    fn a_stored_type_never_takes_the_name_of_a_type_of_the_api() {
        let (_, contract) = openapi::routes().split_for_parts();
        let own = contract.components.unwrap().schemas;
        assert!(own.len() > 50);
        let prefixed: Vec<&String> = own.keys().filter(|name| name.starts_with(PREFIX)).collect();
        assert!(prefixed.is_empty(), "the contract has these as names of stored types: {prefixed:?}");
    }

    /// schemars numbers types of the same name. A number says nothing: such a type gets a name by `schemars(rename)`.
    #[test]
    fn every_stored_type_has_a_name_of_its_own() {
        let schemas = schemas();
        let numbered: Vec<&String> = schemas.keys().filter(|name| name.ends_with(|last: char| last.is_ascii_digit())).collect();
        assert!(schemas.len() > 50 && numbered.is_empty(), "{numbered:?} of {}", schemas.len());
    }
}
