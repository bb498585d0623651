//! The keys of a configuration, read from its schema.

use serde_json::Value;

/// A key of the configuration.
#[derive(Debug, Clone)]
pub struct Key<'a> {
    /// The tables and the key. [`Key::NAME`] stands for a name that the file chooses.
    pub path: Vec<&'a str>,
    /// The `driver` of the table that has this key. `None` if the table has no driver.
    pub driver: Option<&'a str>,
    /// The node of the schema that describes the key.
    pub node: &'a Value,
    /// Whether the key is required if its table is given.
    pub is_required: bool,
}

impl Key<'_> {
    /// Placeholder in a path for a name that the file chooses.
    pub const NAME: &'static str = "NAME";

    /// Whether its value is a number or a list of numbers.
    pub fn is_number(&self) -> bool {
        number(self.node).is_some()
    }

    /// The range of its numbers. `None` if they have none.
    pub fn range(&self) -> Option<[f64; 2]> {
        let node = number(self.node)?;
        Some([node["minimum"].as_f64()?, node["maximum"].as_f64()?])
    }

    /// The unit of its numbers. `None` if they have none.
    pub fn unit(&self) -> Option<&str> {
        number(self.node)?["x-unit"].as_str()
    }

    /// Who sets the key: `operator`, `method` or `expert`.
    pub fn level(&self) -> &str {
        self.node["x-level"].as_str().unwrap_or_default()
    }
}

/// The node that describes the numbers of a key.
fn number(node: &Value) -> Option<&Value> {
    let node = if node["type"] == "array" { &node["items"] } else { node };
    let mut described = std::iter::once(node).chain(variants(node));
    described.find(|node| node["type"] == "number" || node["type"] == "integer")
}

/// All keys of the schema. In each table the keys come before the inner tables, both in alphabetical order.
pub fn keys(schema: &Value) -> Vec<Key<'_>> {
    let mut found = Vec::new();
    below(schema, &Key { path: Vec::new(), driver: None, node: schema, is_required: true }, &mut found);
    found
}

/// The alternatives of a value.
pub(super) fn variants(node: &Value) -> impl Iterator<Item = &Value> {
    ["oneOf", "anyOf"].into_iter().filter_map(|choice| node[choice].as_array()).flatten()
}

/// Whether the node is a table with its own keys.
pub(super) fn is_table(node: &Value) -> bool {
    let is_tagged = variants(node).any(|variant| variant["properties"]["driver"].is_object());
    node["properties"].is_object() || node["additionalProperties"].is_object() || is_tagged
}

fn below<'a>(node: &'a Value, at: &Key<'a>, found: &mut Vec<Key<'a>>) {
    let key = |name: &'a str, node: &'a Value, is_required: bool| {
        let path = at.path.iter().copied().chain([name]).collect();
        Key { path, driver: at.driver, node, is_required }
    };
    let is_required = |name: &str| node["required"].as_array().is_some_and(|names| names.iter().any(|given| given == name));
    let (tables, own): (Vec<_>, Vec<_>) = node["properties"].as_object().into_iter().flatten().partition(|(_, child)| is_table(child));
    for (name, child) in own.into_iter().chain(tables) {
        // The key `driver` was added with the tagged table.
        if name != "driver" || child.get("const").is_none() {
            below(child, &key(name, child, is_required(name)), found);
        }
    }
    if node["additionalProperties"].is_object() {
        below(&node["additionalProperties"], &key(Key::NAME, node, true), found);
    }
    let mut tagged = variants(node).filter_map(|variant| Some((variant["properties"]["driver"]["const"].as_str()?, variant))).peekable();
    if tagged.peek().is_some() {
        found.push(key("driver", node, true));
        for (driver, variant) in tagged {
            below(variant, &Key { driver: Some(driver), ..at.clone() }, found);
        }
    } else if !is_table(node) {
        found.push(at.clone());
        // The value may also be a table with one of several keys.
        for variant in variants(node) {
            for (name, child) in variant["properties"].as_object().into_iter().flatten() {
                below(child, &key(name, child, false), found);
            }
        }
    }
}
