//! The methods paragraph of runs: what was done, by which version, with every parameter.

use crate::tables::method_hash;
use carved_records::{Method, Mode, SpecimenKind, ViewOrder};
use carved_store::{Software, StoredRun};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// How a run was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Methods {
    pub run: String,
    /// Sentences for a paper.
    pub paragraph: String,
    /// Every setting of the method and of the rig.
    pub parameters: Vec<Parameter>,
}

/// One setting.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its keys, joined by points.
    pub path: String,
    pub value: Value,
}

/// Units of the camera of the rig. The keys of all other settings have their unit in their name.
const UNITS: [(&str, &str); 11] = [
    ("alpha", "rad"),
    ("f", "um"),
    ("gamma", "rad"),
    ("height", "px"),
    ("kx", "px/um"),
    ("ky", "px/um"),
    ("phi", "rad"),
    ("s", "px"),
    ("ux", "px"),
    ("uy", "px"),
    ("width", "px"),
];

impl Parameter {
    /// The unit that its name does not have.
    fn unit(&self) -> &'static str {
        let key = self.path.strip_prefix("rig.camera.");
        UNITS.iter().find(|(name, _)| key == Some(name)).map_or("", |(_, unit)| unit)
    }

    /// The value for a reader: numbers with six digits, text as it is.
    pub fn words(&self) -> String {
        fn words(value: &Value) -> String {
            match value {
                Value::Null => "none".to_owned(),
                Value::Bool(true) => "yes".to_owned(),
                Value::Bool(false) => "no".to_owned(),
                Value::String(text) => text.clone(),
                Value::Array(values) => values.iter().map(words).collect::<Vec<_>>().join(", "),
                // Rounded to six digits, and written without the zeros behind them.
                Value::Number(number) => {
                    let rounded = number.as_f64().and_then(|x| format!("{x:.5e}").parse::<f64>().ok());
                    rounded.map_or_else(|| number.to_string(), |x| x.to_string())
                }
                Value::Object(_) => value.to_string(),
            }
        }
        format!("{} {}", words(&self.value), self.unit()).trim_end().to_owned()
    }
}

/// What the recordings of a run have in common, each value once.
#[derive(Default)]
struct Recorded {
    software: BTreeSet<String>,
    rigs: BTreeSet<String>,
    /// The method as the recordings have it.
    method: Option<Value>,
    rig: Option<Value>,
    larvae: usize,
    beads: usize,
    fallback: usize,
    /// Specimens by flag.
    flags: BTreeMap<String, usize>,
    /// Specimens with flags.
    flagged: usize,
    /// Specimens that needed several attempts, and the most attempts that one needed.
    repeated: usize,
    most_attempts: usize,
    /// The limits that the specimens were compared with, by name: each limit with its unit once.
    limits: BTreeMap<String, BTreeSet<String>>,
}

impl Methods {
    /// The methods of a run, without those of wells that cannot be read.
    pub fn of(run: &StoredRun) -> Self {
        let recorded = Recorded::of(run);
        let method = recorded.method.clone().unwrap_or_else(|| serde_json::to_value(&run.record().method).unwrap_or_default());
        let mut parameters = Vec::new();
        flatten("method", &method, &mut parameters);
        if let Some(rig) = &recorded.rig {
            flatten("rig", rig, &mut parameters);
        }
        Self { run: run.record().id.clone(), paragraph: paragraph(run, &recorded, &method_hash(&method)), parameters }
    }

    /// The paragraph and the parameters as Markdown.
    pub fn markdown(&self) -> String {
        let rows: String = self.parameters.iter().map(|p| format!("{}\n", row(p))).collect();
        format!("## {}\n\n{}\n\n| parameter | value |\n|---|---|\n{rows}", self.run, self.paragraph)
    }
}

/// A line of the table: the value as the file has it, so that it can be used again.
fn row(parameter: &Parameter) -> String {
    let Parameter { path, value } = parameter;
    format!("| `{path}` | {} |", format!("`{value}` {}", parameter.unit()).trim_end())
}

impl Recorded {
    fn of(run: &StoredRun) -> Self {
        let mut found = Self::default();
        for well in run.wells() {
            let Some(recording) = well.recording else { continue };
            if let Ok(software) = serde_json::from_value::<Software>(recording["software"].clone()) {
                found.software.insert(software.words());
            }
            let text = |key: &str| recording["rig"][key].as_str().unwrap_or("not known").to_owned();
            found.rigs.insert(format!("{} (camera {}; axis {})", text("name"), text("camera_identity"), text("rotation_identity")));
            if let Some(measurement) = &well.measurement {
                *if well.planned.specimen == SpecimenKind::Bead { &mut found.beads } else { &mut found.larvae } += 1;
                found.fallback += usize::from(measurement["measurement"]["estimator"] == "voxel");
                let flags = well.status.as_ref().map(|status| status.flags.as_slice()).unwrap_or_default();
                found.flagged += usize::from(!flags.is_empty());
                for flag in flags {
                    *found.flags.entry(flag.to_string()).or_default() += 1;
                }
                let attempts = well.earlier_attempts + 1;
                found.repeated += usize::from(attempts > 1);
                found.most_attempts = found.most_attempts.max(attempts);
                for check in measurement["quality"]["checks"].as_array().into_iter().flatten() {
                    let Some((name, limit)) = check["name"].as_str().zip(check["limit"].as_f64()) else { continue };
                    let unit = check["unit"].as_str().unwrap_or_default();
                    found.limits.entry(name.to_owned()).or_default().insert(format!("{limit} {unit}"));
                }
            }
            found.method.get_or_insert_with(|| recording["method"].clone());
            found.rig.get_or_insert_with(|| recording["rig"].clone());
        }
        found
    }
}

fn joined(values: &BTreeSet<String>) -> String {
    values.iter().map(String::as_str).collect::<Vec<_>>().join("; ")
}

fn paragraph(run: &StoredRun, recorded: &Recorded, hash: &str) -> String {
    let record = run.record();
    let method = &record.method;
    let mut text = match record.mode {
        Mode::Hardware => String::new(),
        Mode::Simulated => "These are simulated data: the frames were rendered, and no larva was measured. ".to_owned(),
        Mode::Imported => "The frames were imported: they were taken without carved. ".to_owned(),
    };
    let mut add = |sentence: std::fmt::Arguments| {
        let _writing_to_a_string_cannot_fail = write!(text, "{sentence} ");
    };
    let version = method.version.as_ref().map_or(String::new(), |version| format!(", version {version}"));
    let count = |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    let (larva, larvae) = match record.mode {
        Mode::Simulated => ("simulated larva", "simulated larvae"),
        Mode::Hardware | Mode::Imported => ("zebrafish larva", "zebrafish larvae"),
    };
    let specimens = format!("{} and {}", count(recorded.larvae, larva, larvae), count(recorded.beads, "bead", "beads"));
    add(format_args!(
        "Of plate {} (run {}, started {}), {specimens} were measured with carved {}.",
        record.plan.plate_barcode,
        record.id,
        record.started,
        if recorded.software.is_empty() { record.software.words() } else { joined(&recorded.software) },
    ));
    if !recorded.rigs.is_empty() {
        add(format_args!("The rig was {}.", joined(&recorded.rigs)));
    }
    add(format_args!(
        "By the method {}{version} (SHA-256 of its settings {hash}), each specimen was turned about the axis of the capillary, and {}.",
        record.plan.method,
        taking(method, record.mode),
    ));
    let segmentation = serde_json::to_value(method.segment.method).ok().and_then(|m| m.as_str().map(str::to_owned)).unwrap_or_default();
    add(format_args!(
        "The outline of the specimen was found in every frame by the {segmentation} segmentation, at sub-pixel positions; edges were taken to \
         have a common error of {} px.",
        method.calibration.edge_sd_px,
    ));
    if method.calibration.enabled {
        add(format_args!(
            "Axis, roll and tilt of the capillary and the shift of each view were calibrated from the outlines of the turn itself."
        ));
    } else {
        add(format_args!("The views were combined with the camera of the rig as it was configured, without calibration of the turn."));
    }
    add(format_args!(
        "Volume and surface area are estimates of those of the visual hull, by support functions of its slices{}.",
        match recorded.fallback {
            0 => String::new(),
            n => format!("; those of {} are by voxels, because the slices did not allow it", count(n, "specimen", "specimens")),
        }
    ));
    add(format_args!(
        "A hull was also carved from the outlines with voxels of {} um, of which {} % of the views may miss a voxel (Guo et al., Biomed. Opt. Express \
         8, 2611, 2017).",
        method.voxel_um,
        100.0 * method.epsilon,
    ));
    if method.early_stop.enabled {
        add(format_args!("A turn ended early where the volume had settled (rule early_stop)."));
    }
    add(format_args!(
        "Standard deviations cover the views, the calibration, corners of the slices (volume only), fins and the common error of the edges{}.",
        match method.calibration.scale_sd_percent {
            percent if percent > 0.0 => format!(", and the scale of the rig ({percent} %)"),
            _ => "; the error of the scale was not stated and is not included".to_owned(),
        },
    ));
    let measured = recorded.larvae + recorded.beads;
    if !recorded.limits.is_empty() {
        let limits: Vec<String> = recorded.limits.iter().map(|(name, limits)| format!("{name} {}", joined(limits))).collect();
        add(format_args!("Specimens were flagged, not dropped, beyond these limits: {}.", limits.join(", ")));
    }
    if recorded.flagged > 0 {
        let flags: Vec<String> = recorded.flags.iter().map(|(flag, n)| format!("{flag} {n}")).collect();
        add(format_args!("Of {measured} measured specimens, {} had flags: {}.", recorded.flagged, flags.join(", ")));
    } else if measured > 0 {
        add(format_args!("None of {measured} measured specimens had a flag."));
    }
    match recorded.repeated {
        0 if measured > 0 => add(format_args!("Each specimen was measured at the first attempt.")),
        0 => {}
        n => add(format_args!(
            "{} needed several attempts, at most {}; the numbers are those of the last one.",
            count(n, "specimen", "specimens"),
            recorded.most_attempts
        )),
    }
    text.trim_end().to_owned()
}

/// Every value of a JSON document with its path.
fn flatten(path: &str, value: &Value, found: &mut Vec<Parameter>) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(key, value)| flatten(&format!("{path}.{key}"), value, found)),
        // A list of numbers is one value.
        other => found.push(Parameter { path: path.to_owned(), value: other.clone() }),
    }
}

/// How the frames of a turn were taken.
fn taking(method: &Method, mode: Mode) -> String {
    let asd = method.asd;
    match (method.order, mode) {
        (ViewOrder::Sweep, _) => format!(
            "{asd} frames of the turn were taken at a constant speed, {:.1} per second; their angles follow from the clock of the camera",
            method.sweep.rate_hz(asd)
        ),
        (_, Mode::Imported) => format!("a frame was taken at each of {asd} evenly spaced angles"),
        _ => format!("a frame was taken at each of {asd} evenly spaced angles, to the nearest step of the motor"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sweep_is_not_described_as_stops() {
        let text = "asd = 84\norder = \"sweep\"\nepsilon = 0.05\nvoxel_um = 6.93\nsweep = { turn_s = 1.4 }";
        let said = taking(&toml::from_str(text).unwrap(), Mode::Hardware);
        assert!(said.contains("84 frames") && said.contains("60.0 per second") && !said.contains("nearest step"), "{said}");
        let stops = taking(&toml::from_str(&text.replace("\"sweep\"", "\"sequential\"")).unwrap(), Mode::Hardware);
        assert!(stops.contains("nearest step of the motor"), "{stops}");
    }

    #[test]
    fn every_value_of_a_document_has_its_path() {
        let mut found = Vec::new();
        flatten(
            "method",
            &serde_json::json!({"asd": 21, "segment": {"walls": {"depth": 8.0}}, "box": [1, 2], "version": null}),
            &mut found,
        );
        let found: Vec<String> = found.iter().map(|Parameter { path, value }| format!("{path}={value}")).collect();
        assert_eq!(found, ["method.asd=21", "method.box=[1,2]", "method.segment.walls.depth=8.0", "method.version=null"]);
    }
    #[test]
    fn a_value_is_exact_in_the_table_and_readable_in_the_report() {
        let of = |path: &str, value: Value| Parameter { path: path.into(), value };
        for (parameter, exact, words) in [
            (of("rig.camera.gamma", 0.004_363_323_129_985_824.into()), "`0.004363323129985824` rad", "0.00436332 rad"),
            (of("rig.camera.width", 1024.into()), "`1024` px", "1024 px"),
            (of("method.voxel_um", 6.93.into()), "`6.93`", "6.93"),
            (of("method.order", "sequential".into()), "`\"sequential\"`", "sequential"),
            (of("rig.steps_per_revolution", serde_json::json!([500, 1])), "`[500,1]`", "500, 1"),
            (of("rig.empty_capillary_sha256", Value::Null), "`null`", "none"),
        ] {
            assert_eq!(row(&parameter), format!("| `{}` | {exact} |", parameter.path));
            assert_eq!(parameter.words(), words);
        }
    }
}
