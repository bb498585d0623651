//! Generates the reference page of the configuration, `docs/configuration.md`.

use super::keys::{Key, is_table, keys, variants};
use serde_json::Value;
use std::collections::BTreeSet;

const HEAD: &str = "\
<!-- Generated from the settings' types: `make contract` writes this file. Do not edit it. -->

# Configuration

The configuration of an instrument is one TOML file. [`config/`](../config) has one for each make of controller, with
the keys that a lab changes. This page has every key. `carved config schema` prints the same as a JSON schema for
editors; `carved config check FILE` lists everything that is wrong with a file.

A key that the program does not know is refused, and so is a value out of its range. Both ends of a range are allowed.
The level of a key says who sets it:

| level | who sets it |
|---|---|
| operator | the lab, at installation: addresses, ports, folders, optics, rig |
| method | the scientist, for each method: views, voxels, limits, policies |
| expert | somebody who knows the internals: segmentation, calibration, surface, timeouts. Validate the numbers again after a change |

**required** in the column of defaults means that a table needs the key, if the table is there. A dash means that the
key may be left out and then has no value.
";

/// The reference page of this schema.
pub fn reference_page(schema: &Value) -> String {
    let keys = keys(schema);
    let mut page = HEAD.to_owned();
    let levels = ["operator", "method", "expert"].map(|level| {
        let count = keys.iter().filter(|key| key.level() == level).count();
        format!("{count} {level}")
    });
    page += &format!("\nThere are {} keys: {}.\n", keys.len(), levels.join(", "));
    let mut section = None;
    for key in &keys {
        let (table, own) = table_and_key(schema, key);
        if section != Some((table.clone(), key.driver)) {
            page += &heading(schema, &table, key.driver);
            section = Some((table, key.driver));
        }
        page += &row(key, &own);
    }
    page
}

/// The path of the table, and the key in it. A key of an inline table is written with a dot.
fn table_and_key<'a>(schema: &Value, key: &Key<'a>) -> (Vec<&'a str>, String) {
    let tables = &key.path[..key.path.len() - 1];
    let depth = (1..=tables.len()).take_while(|&depth| is_table(node_of(schema, &tables[..depth], key.driver))).count();
    (key.path[..depth].to_vec(), key.path[depth..].join("."))
}

/// The node of a table. Below a table with a driver: the node for this driver.
fn node_of<'a>(schema: &'a Value, table: &[&str], driver: Option<&str>) -> &'a Value {
    table.iter().fold(schema, |node, name| {
        let node = variant(node, driver).unwrap_or(node);
        if *name == Key::NAME { &node["additionalProperties"] } else { &node["properties"][name] }
    })
}

/// The variant of a table for this driver. `None` without a driver.
fn variant<'a>(node: &'a Value, driver: Option<&str>) -> Option<&'a Value> {
    driver.and_then(|driver| variants(node).find(|variant| variant["properties"]["driver"]["const"] == driver))
}

fn heading(schema: &Value, table: &[&str], driver: Option<&str>) -> String {
    let node = node_of(schema, table, driver);
    let name = if table.is_empty() { "Outside of tables".to_owned() } else { format!("`[{}]`", table.join(".")) };
    let name = driver.map_or(name.clone(), |driver| format!("{name} with `driver = \"{driver}\"`"));
    let about = text(&variant(node, driver).unwrap_or(node)["description"]);
    let left_out = node.get("default").map_or(String::new(), |table| format!(" If the table is left out, it is `{}`.", toml_of(table)));
    let about = if table.is_empty() { String::new() } else { format!("{}\n\n", wrapped(&format!("{about}{left_out}"))) };
    format!("\n## {name}\n\n{about}| key | unit or value | default | range | level | meaning |\n|---|---|---|---|---|---|\n")
}

/// A paragraph in lines of at most 120 characters.
fn wrapped(paragraph: &str) -> String {
    const WIDTH: usize = 120;
    let mut lines = vec![String::new()];
    for word in paragraph.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + 1 + word.chars().count() <= WIDTH => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines.join("\n")
}

/// A description on one line, for a cell of a table.
fn text(description: &Value) -> String {
    description.as_str().unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

fn row(key: &Key, name: &str) -> String {
    let node = key.node;
    let default = match node.get("default") {
        Some(value) => format!("`{}`", toml_of(value)),
        None if key.is_required => "**required**".into(),
        None => "-".into(),
    };
    let range = key.range().map_or("-".into(), |[least, most]| format!("{least} to {most}"));
    format!("| `{name}` | {} | {default} | {range} | {} | {} |\n", value(key, name), key.level(), meaning(key, name))
}

/// A default in TOML syntax.
fn toml_of(value: &Value) -> String {
    match value {
        Value::Array(list) => format!("[{}]", list.iter().map(toml_of).collect::<Vec<_>>().join(", ")),
        Value::Object(table) => {
            let keys: Vec<String> = table.iter().map(|(key, value)| format!("{key} = {}", toml_of(value))).collect();
            format!("{{ {} }}", keys.join(", "))
        }
        other => other.to_string(),
    }
}

/// The literal values of a key, with their meanings.
fn words(key: &Key, name: &str) -> Vec<(String, String)> {
    if name == "driver" {
        let drivers = variants(key.node).filter_map(|variant| Some((variant["properties"]["driver"]["const"].as_str()?, variant)));
        return drivers.map(|(driver, variant)| (format!("`\"{driver}\"`"), text(&variant["description"]))).collect();
    }
    let listed = |node: &Value| -> Vec<(String, String)> {
        node["enum"].as_array().into_iter().flatten().map(|word| (format!("`{word}`"), String::new())).collect()
    };
    let said = variants(key.node).flat_map(|variant| match variant.get("const") {
        Some(word) => vec![(format!("`{word}`"), text(&variant["description"]))],
        None => listed(variant),
    });
    listed(key.node).into_iter().chain(said).collect()
}

/// The unit of a number, or the kind of another value.
fn value(key: &Key, name: &str) -> String {
    let node = key.node;
    let count = node["minItems"].as_u64().map_or("list of".into(), |count| format!("{count} numbers,"));
    match (key.unit(), node["type"].as_str()) {
        (Some(unit), Some("array")) => format!("{count} {unit}"),
        (Some(unit), _) => unit.to_owned(),
        (None, Some("array")) if node["items"]["type"] == "array" => "list of pairs of texts".into(),
        (None, Some("array")) => "list of texts".into(),
        (None, _) => {
            let words: Vec<String> = words(key, name).into_iter().map(|(word, _)| word).collect();
            let kinds: BTreeSet<&str> = std::iter::once(node).chain(variants(node)).filter_map(kind).collect();
            let kinds = kinds.into_iter().map(str::to_owned);
            words.into_iter().chain(kinds).collect::<Vec<_>>().join(" or ")
        }
    }
}

/// The kind of a value. `None` for a literal value or a driver.
fn kind(node: &Value) -> Option<&'static str> {
    if node.get("const").is_some() || node.get("enum").is_some() || node["properties"]["driver"].is_object() {
        return None;
    }
    match node["type"].as_str()? {
        "boolean" => Some("`true` or `false`"),
        "string" => Some("text"),
        "object" => Some("table"),
        _ => Some("number"),
    }
}

fn meaning(key: &Key, name: &str) -> String {
    let explained = words(key, name).into_iter().filter(|(_, about)| !about.is_empty());
    let words: Vec<String> = explained.map(|(word, about)| format!("{word}: {about}")).collect();
    let about = if name == "driver" { "Which keys the table has.".to_owned() } else { text(&key.node["description"]) };
    match words.as_slice() {
        [] => about,
        words => format!("{about} {}", words.join(" ")).trim().to_owned(),
    }
}
