//! Every key of a configuration: its range is enforced, and its documentation is complete and committed.

use crate::common::run;
use carved::config::{Config, Key, keys, reference_page, schema};
use carved_devices::rotation::DRIVERS;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use toml::Value as Toml;

const REFRESH: &str = "CARVED_UPDATE_CONFIGURATION=1 cargo test --test commands reference_page";

/// Numbers without a range, each with the reason.
const WITHOUT_RANGE: &[(&str, &str)] = &[
    ("acquisition.sense", "it is 1 or -1: the schema lists both words, and the next test tries others"),
    ("methods.standard.version", "it is a name that the lab chooses, and nothing is computed with it"),
    ("translation.sense", "as acquisition.sense"),
];

/// The driver of a sound configuration that has this key.
fn driver_of<'a>(key: &Key<'a>) -> &'a str {
    match (key.path[0], key.driver) {
        ("rotation", Some(driver)) => driver,
        ("views", _) => "folder",
        _ => "grbl",
    }
}

/// A sound configuration with a table of every kind that goes with this driver of the rotation, or of the views.
fn whole(rotation: &str) -> toml::Table {
    let file = match rotation {
        "vast_bridge" => "vast-bridge".into(),
        other => format!("vast-{other}"),
    };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("config/{file}.toml"));
    let mut table: toml::Table = std::fs::read_to_string(path).unwrap().parse().unwrap();
    if rotation == "folder" {
        return table;
    }
    assert_eq!(table["rotation"]["driver"].as_str(), Some(rotation));
    let mut second = table["camera"].clone();
    second["pixel_format"] = "Mono8".into();
    table.insert("camera_second".into(), second);
    let extra: toml::Table =
        "[optics_second]\naround_deg = 90.0\ndistance_um = 60000.0\nkx_px_per_um = 0.18\nky_px_per_um = 0.18\nux_px = 511.5\n\
         uy_px = 511.5\n[calibration]\n[notify]\nurl = \"http://127.0.0.1:9/\"\n"
            .parse()
            .unwrap();
    table.extend(extra);
    if rotation == "grbl" {
        let extra: toml::Table =
            "[translation]\naxis = \"Y\"\nsteps_per_um = [64, 3]\num_per_unit = 10\nmax_rate_units_per_min = 60000.0\n\
             acceleration_units_per_s2 = 5000.0\nlimits_um = [-19000.0, 0.0]\nposition_um = -4990.0\n[sampler]\ndriver = \"trigger\"\n"
                .parse()
                .unwrap();
        table.extend(extra);
    }
    table
}

fn dotted(key: &Key) -> String {
    key.path.iter().map(|name| if *name == Key::NAME { "standard" } else { name }).collect::<Vec<_>>().join(".")
}

/// The required keys of an output.
fn output_at_a_pin(key: &Key) -> toml::Table {
    let pin = if key.driver == Some("grbl") { "\"mist_coolant\"" } else { "1" };
    format!("pin = {pin}\non = \"views\"").parse().unwrap()
}

/// What is wrong with the configuration where `key` has this value, or nothing.
fn refusal(key: &Key, value: Toml) -> String {
    let mut table = whole(driver_of(key));
    let path = dotted(key);
    let mut at = &mut table;
    let names: Vec<&str> = path.split('.').collect();
    for (depth, name) in names[..names.len() - 1].iter().enumerate() {
        let inner = at.entry((*name).to_owned()).or_insert_with(|| Toml::Table(toml::Table::new()));
        if !inner.is_table() {
            *inner = Toml::Table(toml::Table::new());
        }
        at = inner.as_table_mut().unwrap_or_else(|| panic!("{path}: no table at {depth}"));
    }
    // A box and a pair of divisors are given whole.
    match path.as_str() {
        "rotation.clock_divisors.pulse" | "rotation.clock_divisors.ramp" => {
            at.extend("pulse = 1\nramp = 1".parse::<toml::Table>().unwrap());
        }
        "rotation.outputs.standard.pin" | "rotation.outputs.standard.settle_ms" => at.extend(output_at_a_pin(key)),
        "methods.standard.box_um.min" | "methods.standard.box_um.max" => {
            at.extend("min = [-2500.0, -500.0, -500.0]\nmax = [2500.0, 500.0, 500.0]".parse::<toml::Table>().unwrap());
        }
        _ => {}
    }
    at.insert(names[names.len() - 1].to_owned(), value);
    let text = toml::to_string(&table).unwrap();
    Config::parse(&text, Path::new("whole.toml")).map_or_else(|error| error.to_string(), |_| String::new())
}

/// The value as the key has it: a number, or a list in which the last number is the value.
fn written(key: &Key, number: f64) -> Toml {
    let node = key.node;
    let is_list = node["type"] == "array";
    let is_integer = node["type"] == "integer" || node["items"]["type"] == "integer";
    let of = |number: f64| if is_integer { Toml::Integer(number as i64) } else { Toml::Float(number) };
    if !is_list {
        return of(number);
    }
    let count = node["minItems"].as_u64().unwrap() as usize;
    assert_eq!(node["maxItems"], count, "{}", dotted(key));
    // The others are in the range as well.
    let [least, most] = key.range().unwrap();
    let other = 1.0_f64.clamp(least, most);
    (1..count).map(|_| of(other)).chain([of(number)]).collect::<Vec<_>>().into()
}

/// Whether the value is refused by the type of its key.
fn is_not_read(said: &str, path: &str) -> bool {
    said.contains(&format!("{path}: ")) || said.contains(&format!("{path}["))
}

#[test]
fn every_sound_base_of_these_tests_is_accepted() {
    for rotation in DRIVERS.iter().map(|entry| entry.name).chain(["folder"]) {
        Config::parse(&toml::to_string(&whole(rotation)).unwrap(), Path::new("whole.toml")).unwrap();
    }
}

/// Each number has a range. Just outside of both its ends it is refused with its full path, and both ends are in the range.
#[test]
fn every_number_has_a_range_that_is_enforced() {
    let schema = schema();
    let found = keys(&schema);
    let numbers: Vec<&Key> = found.iter().filter(|key| key.is_number()).collect();
    assert_eq!(numbers.len(), count_numbers(&schema), "the list of keys leaves numbers of the schema out");
    let mut wrong = Vec::new();
    let mut without = BTreeSet::new();
    for key in numbers {
        let path = dotted(key);
        let (Some([least, most]), Some(_)) = (key.range(), key.unit()) else {
            without.insert(path);
            continue;
        };
        let is_integer = key.node["type"] == "integer" || key.node["items"]["type"] == "integer";
        let step = |end: f64| if is_integer { 1.0 } else { 1e-6 * if end == 0.0 { most - least } else { end.abs() } };
        let outside = [least - step(least), most + step(most)];
        let numbers = outside.iter().copied().chain((!is_integer).then_some(f64::NAN));
        for number in numbers {
            let said = refusal(key, written(key, number));
            let of_range = said.contains(&format!("{path} = ")) && said.contains(&format!("; expected {least} to {most} "));
            // A whole number may already be none of its type: it is named as well.
            let of_type = is_integer && is_not_read(&said, &path);
            if !(of_range || of_type) {
                wrong.push(format!("{path} = {number} is not refused by its name: {said:?}"));
            }
        }
        for number in [least, most] {
            let said = refusal(key, written(key, number));
            if said.contains(&format!("{path} = {number}; expected {least} to {most}")) || is_not_read(&said, &path) {
                wrong.push(format!("{path} = {number}, an end of its range, is refused: {said}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert_eq!(without, WITHOUT_RANGE.iter().map(|(path, _)| (*path).to_owned()).collect(), "numbers without a range");
}

/// Counted without the list of keys.
fn count_numbers(node: &Value) -> usize {
    let own = usize::from(node["type"] == "number" || node["type"] == "integer" && node.get("const").is_none());
    let below = match node {
        Value::Object(found) => found.iter().filter(|(name, _)| *name != "default").map(|(_, child)| count_numbers(child)).sum(),
        Value::Array(list) => list.iter().map(count_numbers).sum(),
        _ => 0,
    };
    own + below
}

#[test]
fn a_sense_is_1_or_minus_1() {
    let schema = schema();
    for key in keys(&schema).iter().filter(|key| key.path.last() == Some(&"sense")) {
        assert_eq!(key.node["enum"], serde_json::json!([1, -1]));
        for (sense, refused) in [(1, false), (-1, false), (0, true), (2, true)] {
            let said = refusal(key, Toml::Integer(sense));
            assert_eq!(said.contains(&format!("{}: ", dotted(key))) && said.contains("must be 1 or -1"), refused, "{sense}: {said}");
        }
    }
}

#[test]
fn every_key_has_a_meaning_and_a_level() {
    let schema = schema();
    let lacking: Vec<String> = keys(&schema)
        .iter()
        .filter(|key| {
            !["operator", "method", "expert"].contains(&key.level()) || key.node["description"].as_str().is_none_or(str::is_empty)
        })
        .map(dotted)
        .collect();
    assert_eq!(lacking, Vec::<String>::new());
}

/// What the schema states as a default is what the program takes where the key is left out.
#[test]
fn what_is_left_out_has_the_default_of_the_schema() {
    let schema = schema();
    let parsed = |table: &toml::Table| format!("{:?}", Config::parse(&toml::to_string(table).unwrap(), Path::new("whole.toml")).unwrap());
    let mut tried = 0;
    for key in keys(&schema) {
        let Some(default) = key.node.get("default") else { continue };
        let mut table = whole(driver_of(&key));
        let mut at = &mut table;
        let path = dotted(&key);
        let (tables, name) = path.rsplit_once('.').unwrap();
        for table in tables.split('.') {
            at = at.entry(table.to_owned()).or_insert_with(|| Toml::Table(toml::Table::new())).as_table_mut().unwrap();
        }
        if path == "rotation.outputs.standard.settle_ms" {
            at.extend(output_at_a_pin(&key));
        }
        at.remove(name);
        let left_out = parsed(&table);
        let mut at = &mut table;
        for name in tables.split('.') {
            at = at[name].as_table_mut().unwrap();
        }
        at.insert(name.to_owned(), Toml::try_from(default).unwrap());
        assert_eq!(parsed(&table), left_out, "{path} = {default}");
        tried += 1;
    }
    assert!(tried > 100, "{tried} keys with a default are not all");
}

#[test]
fn the_command_prints_the_schema_and_the_page() {
    let schema = schema();
    let output = run(&["config", "schema"]);
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(output.status.success() && printed == schema);
    assert_eq!(printed["$schema"], "https://json-schema.org/draft/2020-12/schema");
    let settle = &printed["properties"]["acquisition"]["properties"]["settle_ms"];
    assert_eq!((&settle["minimum"], &settle["maximum"], &settle["x-unit"]), (&0.into(), &10_000.into(), &"ms".into()));
    let page = run(&["config", "schema", "--markdown"]);
    assert_eq!(String::from_utf8(page.stdout).unwrap().trim_end(), reference_page(&schema).trim_end());
}

#[test]
fn the_committed_reference_page_is_the_generated_one() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/configuration.md");
    let generated = reference_page(&schema());
    if std::env::var_os("CARVED_UPDATE_CONFIGURATION").is_some_and(|value| value == "1") {
        std::fs::write(&file, generated).unwrap();
        return;
    }
    let committed = std::fs::read_to_string(&file).unwrap_or_else(|why| panic!("{}: {why}. Write it: {REFRESH}", file.display()));
    let differs = committed.lines().zip(generated.lines()).find(|(committed, generated)| committed != generated);
    assert!(
        committed == generated,
        "docs/configuration.md is not the generated page. First difference: {differs:?}\nRefresh it: {REFRESH}"
    );
}
