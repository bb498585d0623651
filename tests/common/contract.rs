//! Compares an answer with its schema in the served contract, more strictly than the contract itself: a property that the schema does not
//! list is a mistake, so that a schema which lacks one is found.

use super::Daemon;
use serde_json::{Value, json};

/// The contract that a daemon serves.
pub struct Contract(Value);

impl Contract {
    pub fn of(daemon: &Daemon) -> Self {
        Self(daemon.get("/openapi.json"))
    }

    /// Differences of `value` from the component `name`, each with its JSON pointer.
    pub fn mistakes(&self, name: &str, value: &Value) -> Vec<String> {
        self.compare(&json!({ "$ref": format!("#/components/schemas/{name}") }), value, "")
    }

    fn compare(&self, schema: &Value, value: &Value, at: &str) -> Vec<String> {
        // `true` allows everything.
        let Some(keywords) = schema.as_object() else {
            assert_eq!(*schema, true, "{at}: {schema} is no schema that this comparison knows");
            return Vec::new();
        };
        let mut mistakes = Vec::new();
        for (keyword, wanted) in keywords {
            let holds = match keyword.as_str() {
                "$ref" => {
                    let target = wanted.as_str().and_then(|reference| self.0.pointer(reference.strip_prefix('#')?));
                    mistakes.extend(self.compare(target.unwrap_or_else(|| panic!("{wanted} leads nowhere")), value, at));
                    true
                }
                "anyOf" | "oneOf" => {
                    let of_each: Vec<_> = wanted.as_array().unwrap().iter().map(|one| self.compare(one, value, at)).collect();
                    // Of a value that fits none, the differences from the nearest one.
                    mistakes.extend(of_each.into_iter().min_by_key(Vec::len).unwrap());
                    true
                }
                "type" => wanted.as_array().map_or_else(|| is_a(wanted, value), |any| any.iter().any(|one| is_a(one, value))),
                "enum" => wanted.as_array().unwrap().contains(value),
                "const" => wanted == value,
                "minimum" => value.as_f64().is_none_or(|number| number >= wanted.as_f64().unwrap()),
                "maximum" => value.as_f64().is_none_or(|number| number <= wanted.as_f64().unwrap()),
                "minItems" => value.as_array().is_none_or(|items| items.len() as u64 >= wanted.as_u64().unwrap()),
                "maxItems" => value.as_array().is_none_or(|items| items.len() as u64 <= wanted.as_u64().unwrap()),
                "items" => {
                    for (i, item) in value.as_array().into_iter().flatten().enumerate() {
                        mistakes.extend(self.compare(wanted, item, &format!("{at}/{i}")));
                    }
                    true
                }
                "properties" => {
                    for (key, found) in value.as_object().into_iter().flatten() {
                        match wanted.get(key) {
                            Some(property) => mistakes.extend(self.compare(property, found, &format!("{at}/{key}"))),
                            None => mistakes.push(format!("{at}/{key} is not in the schema")),
                        }
                    }
                    true
                }
                "required" => {
                    let missing = |name: &&Value| value.as_object().is_some_and(|fields| !fields.contains_key(name.as_str().unwrap()));
                    mistakes.extend(wanted.as_array().unwrap().iter().filter(missing).map(|name| format!("{at}: {name} is missing")));
                    true
                }
                "additionalProperties" if *wanted == false => true,
                // A map: every value has this type.
                "additionalProperties" => {
                    for (key, found) in value.as_object().into_iter().flatten() {
                        mistakes.extend(self.compare(wanted, found, &format!("{at}/{key}")));
                    }
                    true
                }
                "description" | "format" | "x-unit" => true,
                other => panic!("{at}: this comparison does not know the keyword {other}"),
            };
            if !holds {
                mistakes.push(format!("{at}: {value} is against {keyword} = {wanted}"));
            }
        }
        mistakes
    }
}

fn is_a(name: &Value, value: &Value) -> bool {
    match name.as_str().unwrap() {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("{other} is no type"),
    }
}

/// Asserts that the answer about a specimen follows the contract, and contains the files as they are stored.
pub fn specimen_follows_it(daemon: &Daemon, run: &str, well: &str) {
    let contract = Contract::of(daemon);
    let answer = daemon.get(&format!("/v1/runs/{run}/specimens/{well}"));
    assert_eq!(contract.mistakes("SpecimenDetail", &answer), Vec::<String>::new(), "{well}");
    let folder = daemon.data.join("runs").join(run).join(well);
    assert_eq!(answer["recording"], super::json(&folder.join("recording.json")), "{well}");
    let measured = folder.join("measurement.json");
    assert_eq!(answer["measurement"], if measured.is_file() { super::json(&measured) } else { Value::Null }, "{well}");
    // In each object of the documents, a property that no type has and one of another type are mistakes.
    for document in ["recording", "measurement"].into_iter().filter(|name| answer[*name].is_object()) {
        for pointer in objects(&answer[document], &format!("/{document}")) {
            let changed = |change: &dyn Fn(&mut serde_json::Map<String, Value>)| {
                let mut changed = answer.clone();
                change(changed.pointer_mut(&pointer).unwrap().as_object_mut().unwrap());
                contract.mistakes("SpecimenDetail", &changed)
            };
            let unknown = changed(&|fields| drop(fields.insert("no_such_field".into(), 1.into())));
            assert!(!unknown.is_empty(), "{well}: a field that no type has is no mistake in {pointer}");
            let mistyped = changed(&|fields| *fields.values_mut().next().unwrap() = json!([{ "of": "another type" }]));
            assert!(!mistyped.is_empty(), "{well}: another type of the first field is no mistake in {pointer}");
        }
    }
}

/// The pointers of the objects in a document. Of an array only the first item; of the truth, which has no schema, nothing.
fn objects(value: &Value, at: &str) -> Vec<String> {
    match value {
        Value::Array(items) => items.first().map(|first| objects(first, &format!("{at}/0"))).unwrap_or_default(),
        Value::Object(fields) => {
            let inner =
                fields.iter().filter(|(name, _)| *name != "truth").flat_map(|(name, field)| objects(field, &format!("{at}/{name}")));
            inner.chain([at.to_owned()]).collect()
        }
        _ => Vec::new(),
    }
}
