//! The limits of a method, and the defaults that the shipped file names.

use carved_core::quality::gate::GateSettings;
use carved_core::quality::{EarlyStopSettings, QualitySettings};
use carved_records::Method;
use serde::Deserialize;
use serde::de::DeserializeOwned;

const SHIPPED: &str = include_str!("../../config/simulated.toml");

/// What stands commented out below a table's name.
fn shipped<T: DeserializeOwned>(table: &str) -> T {
    let (_, block) = SHIPPED.split_once(&format!("# [methods.standard.{table}]")).unwrap();
    let keys: String = block.lines().skip(1).take_while(|l| !l.starts_with("# [")).map(|l| format!("{}\n", &l[2..])).collect();
    toml::from_str(&keys).unwrap()
}

#[test]
fn the_defaults_are_those_that_the_shipped_file_names() {
    assert_eq!(shipped::<QualitySettings>("quality"), QualitySettings::default());
    assert_eq!(shipped::<GateSettings>("quality.gate"), GateSettings::default());
    assert_eq!(shipped::<EarlyStopSettings>("early_stop"), EarlyStopSettings::default());
    let breaches = [QualitySettings::default().check(), GateSettings::default().check(), EarlyStopSettings::default().check()];
    assert!(breaches.iter().all(Vec::is_empty), "{breaches:?}");
}

/// The keys of all numbers in a table, as paths.
fn numbers(value: &toml::Value, path: &mut Vec<String>, found: &mut Vec<Vec<String>>) {
    let mut below = |key: String, value: &toml::Value| {
        path.push(key);
        numbers(value, path, found);
        path.pop();
    };
    match value {
        toml::Value::Table(table) => table.iter().for_each(|(key, value)| below(key.clone(), value)),
        toml::Value::Array(list) => list.iter().enumerate().for_each(|(at, value)| below(at.to_string(), value)),
        toml::Value::Integer(_) | toml::Value::Float(_) => found.push(path.clone()),
        _ => {}
    }
}

fn at<'a>(value: &'a mut toml::Value, path: &[String]) -> &'a mut toml::Value {
    path.iter().fold(value, |value, key| match value {
        toml::Value::Array(list) => &mut list[key.parse::<usize>().unwrap()],
        other => other.get_mut(key).unwrap(),
    })
}

/// Where 0 has a meaning: nothing is allowed, nothing is done, or nothing is known to be off.
const MAY_BE_ZERO: [&str; 32] = [
    "epsilon",
    "segment.black_below",
    "segment.closing_px",
    "segment.edge.stiffness",
    "segment.fringe.bar",
    "segment.fringe.kink",
    "segment.fringe.least",
    "segment.fringe.most",
    "segment.fringe.opaque_sigma",
    "segment.fringe.reach_bore",
    "segment.join_gap_bore",
    "segment.level_set.edge",
    "segment.level_set.region",
    "segment.level_set.steps",
    "segment.max_saturated_share",
    "segment.opening_px",
    "segment.speck_bore2",
    "segment.wall_margin_px",
    "segment.walls.max_sag_share",
    "segment.walls.max_tilt_deg",
    "surface.fairing_iterations",
    "surface.fairing_lambda",
    "calibration.edge_sd_px",
    "calibration.scale_sd_percent",
    "policy.retries",
    "quality.closure_across_px",
    "quality.closure_along_px",
    "quality.closure_overlap",
    "quality.closure_turn_deg",
    "quality.gate.cusum_slack_sd",
    "quality.overlap_percent",
    "quality.usable_percent",
];

/// Each number of a method has a range: nothing that is negative, no number or absurd passes, and 0 only where it has a meaning.
#[test]
fn no_number_of_a_method_is_taken_unchecked() {
    let sound: Method = toml::from_str("asd = 21\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 10.0\n").unwrap();
    assert_eq!(sound.check(), Vec::<String>::new());
    let whole = toml::Value::try_from(&sound).unwrap();
    let mut paths = Vec::new();
    numbers(&whole, &mut Vec::new(), &mut paths);
    assert!(paths.len() > 80, "{} numbers are not all of a method", paths.len());
    let refused = |path: &[String], value: toml::Value| {
        let mut changed = whole.clone();
        *at(&mut changed, path) = value;
        // What is not read is refused by its reader.
        Method::deserialize(changed).map_or(true, |method| !method.check().is_empty())
    };
    let mut passed = Vec::new();
    for path in &paths {
        let key = path.join(".");
        // The rig's steps say what `asd` may be, and the box may lie anywhere.
        if key == "asd" {
            continue;
        }
        let is_integer = at(&mut whole.clone(), path).is_integer();
        let mut tried: Vec<(&str, toml::Value)> = vec![("NaN", f64::NAN.into()), ("1e300", 1e300.into())];
        if is_integer {
            tried.push(("i64::MAX", i64::MAX.into()));
        }
        if !key.starts_with("box_um") {
            tried.push(("-1", if is_integer { (-1).into() } else { (-1.0).into() }));
            if !MAY_BE_ZERO.contains(&key.as_str()) {
                tried.push(("0", if is_integer { 0.into() } else { 0.0.into() }));
            }
        }
        passed.extend(tried.into_iter().filter(|(_, value)| !refused(path, value.clone())).map(|(said, _)| format!("{key} = {said}")));
    }
    assert!(passed.is_empty(), "taken: {passed:#?}");
    let unused: Vec<&str> = MAY_BE_ZERO.iter().copied().filter(|key| !paths.iter().any(|p| p.join(".") == *key)).collect();
    assert!(unused.is_empty(), "no such keys: {unused:?}");
}

#[test]
fn a_prior_of_nothing_is_refused_with_its_range() {
    let text = SHIPPED.replacen("[methods.standard]\n", "[methods.standard]\ncalibration = { alpha_sd_deg = 0 }\n", 1);
    let refused = crate::config::Config::parse(&text, std::path::Path::new("x.toml")).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("methods.standard.calibration.alpha_sd_deg = 0; expected 0.001 to 1 deg"), "{refused}");
}

#[test]
fn a_version_is_a_word_or_a_number_and_is_recorded() {
    let method = |line: &str| -> Result<Method, toml::de::Error> {
        toml::from_str(&format!("{line}\nasd = 21\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 10.0\n"))
    };
    let version = |line: &str| method(line).unwrap().version;
    assert_eq!((version("version = 3"), version("version = \"b-2\""), version("")), (Some("3".into()), Some("b-2".into()), None));
    assert!(method("version = [1]").is_err());
    let recorded = serde_json::to_string(&method("version = 3").unwrap()).unwrap();
    assert!(recorded.contains("\"version\":\"3\""), "{recorded}");
    assert_eq!(serde_json::from_str::<Method>(&recorded).unwrap().version.as_deref(), Some("3"));
}

#[test]
fn a_sequential_turn_does_not_end_early_and_limits_have_ranges() {
    let config = |change: &str| {
        let text = SHIPPED.replacen("[methods.standard]\n", &format!("[methods.standard]\n{change}\n"), 1);
        crate::config::Config::parse(&text, std::path::Path::new("x.toml")).map(|_| ()).map_err(|e| e.to_string())
    };
    assert_eq!(config("quality = { residual_px = 2.0 }"), Ok(()));
    let refused = config("early_stop = { enabled = true, min_views = 2 }").unwrap_err();
    assert!(refused.contains("early_stop.enabled = true, with order = \"sequential\"") && refused.contains("min_views = 2"), "{refused}");
    let refused = config("quality = { closure_turn_deg = -1.0, gate = { beads_least = 2 } }").unwrap_err();
    assert!(refused.contains("quality.closure_turn_deg = -1") && refused.contains("quality.gate.beads_least = 2"), "{refused}");
}
