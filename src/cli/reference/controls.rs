//! Control larvae from recordings and tables.

use anyhow::{Context, bail};
use carved_core::flag::StoredFlag;
use carved_core::measure::references::{Control, EYES, EyeNumbers, VOXEL, estimates};
use carved_records::Mode;
use carved_records::plate_map::{UNCLOSED_QUOTE, unclosed_quote};
use carved_store::{MeasurementFile, Recording, RecordingReader};
use serde::Deserialize;
use std::path::Path;

/// Labels for larvae whose recording or row has none.
#[derive(Debug, Default, clap::Args)]
pub struct Words {
    /// Treatment of the larvae, for example `fixed`.
    #[arg(long)]
    treatment: Option<String>,
    #[arg(long)]
    strain: Option<String>,
    /// A further label that separates these larvae from others: a batch, a clutch.
    #[arg(long)]
    cohort: Option<String>,
}

/// One row of a table. Only the age and one of the two numbers are required.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    dpf: f64,
    #[serde(default)]
    volume_um3: Option<f64>,
    #[serde(default)]
    area_um2: Option<f64>,
    #[serde(default)]
    eye_volume_um3: Option<f64>,
    #[serde(default)]
    eye_distance_um: Option<f64>,
    #[serde(default)]
    treatment: Option<String>,
    #[serde(default)]
    strain: Option<String>,
    #[serde(default, alias = "group")]
    cohort: Option<String>,
    #[serde(default)]
    asd: Option<u32>,
    #[serde(default)]
    voxel_um: Option<f64>,
    #[serde(default)]
    epsilon: Option<f64>,
    #[serde(default)]
    estimator: Option<String>,
}

/// A line of a table that begins with this character is a comment.
const COMMENT: u8 = b'#';

/// The rows of a CSV file.
pub fn of_table(path: &Path, words: &Words) -> anyhow::Result<Vec<Control>> {
    rows(&carved_files::read(path).with_context(|| format!("{}: cannot read the table", path.display()))?, path, words)
}

/// The rows of the text of a CSV file. `path` names it in messages.
pub fn rows(text: &[u8], path: &Path, words: &Words) -> anyhow::Result<Vec<Control>> {
    let text = text.strip_prefix("\u{feff}".as_bytes()).unwrap_or(text);
    if let Some(line) = unclosed_quote(text, b',', Some(COMMENT)) {
        bail!("{}, line {line}: {UNCLOSED_QUOTE}", path.display());
    }
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(COMMENT)).from_reader(text);
    let mut controls = Vec::new();
    let mut line = reader.position().line();
    let headers = reader.headers().with_context(|| path.display().to_string())?.clone();
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).with_context(|| path.display().to_string())? {
        line = record.position().map_or(line, csv::Position::line);
        let at = || format!("{}, line {line}", path.display());
        let row: Row = record.deserialize(Some(&headers)).with_context(at)?;
        let numbers = [
            ("volume_um3", row.volume_um3),
            ("area_um2", row.area_um2),
            ("eye_volume_um3", row.eye_volume_um3),
            ("eye_distance_um", row.eye_distance_um),
        ];
        for (key, value) in numbers {
            if let Some(value) = value.filter(|v| !v.is_finite() || *v <= 0.0) {
                bail!("{}: {key} = {value}; expected a number above 0", at());
            }
        }
        controls.extend(row.controls(words));
    }
    Ok(controls)
}

impl Row {
    fn controls(self, words: &Words) -> Vec<Control> {
        let (eye_volume_um3, eye_distance_um) = (self.eye_volume_um3, self.eye_distance_um);
        let has_eyes = eye_volume_um3.is_some() || eye_distance_um.is_some();
        let has_others = self.volume_um3.is_some() || self.area_um2.is_some();
        let larva = Control {
            dpf: self.dpf,
            treatment: self.treatment.or_else(|| words.treatment.clone()),
            strain: self.strain.or_else(|| words.strain.clone()),
            cohort: self.cohort.or_else(|| words.cohort.clone()),
            asd: self.asd,
            voxel_um: self.voxel_um,
            epsilon: self.epsilon,
            estimator: self.estimator.unwrap_or_else(|| VOXEL.to_owned()),
            simulated: false,
            volume_um3: self.volume_um3,
            area_um2: self.area_um2,
            eye_volume_um3: None,
            eye_distance_um: None,
        };
        let eyes = has_eyes.then(|| of_eyes(larva.clone(), eye_volume_um3, eye_distance_um));
        // A row of nothing is refused as a group without numbers.
        Some(larva).filter(|_| has_others || !has_eyes).into_iter().chain(eyes).collect()
    }
}

/// One control per estimator from the larva of a recording, or the reason why it is no control.
pub fn of_recording(reader: &RecordingReader, words: &Words, with_flagged: bool) -> anyhow::Result<Result<Vec<Control>, String>> {
    let recording = reader.recording();
    let Some(dpf) = recording.specimen.age_of_larva() else {
        return Ok(Err("no larva whose age is known: its plate map gives no `dpf`, or says `bead`".into()));
    };
    let file = reader.measurement()?;
    if !with_flagged && !file.record.flags.is_empty() {
        return Ok(Err(format!("flagged {}; --with-flagged takes it all the same", StoredFlag::joined(&file.record.flags, ", "))));
    }
    Ok(Ok(of_larva(recording, &file, dpf, words)))
}

fn of_larva(recording: &Recording, file: &MeasurementFile, dpf: f64, words: &Words) -> Vec<Control> {
    let m = &file.record.measurement;
    let control = |e: carved_core::measure::references::Estimate| Control {
        dpf,
        treatment: words.treatment.clone(),
        strain: words.strain.clone(),
        cohort: words.cohort.clone(),
        asd: Some(recording.method.asd),
        voxel_um: Some(m.voxel_size_um),
        epsilon: Some(m.epsilon),
        estimator: e.estimator.to_owned(),
        simulated: recording.mode == Mode::Simulated,
        volume_um3: Some(e.volume_um3),
        area_um2: Some(e.area_um2),
        eye_volume_um3: None,
        eye_distance_um: None,
    };
    let mut controls: Vec<Control> = estimates(m).into_iter().map(control).collect();
    let eyes = file.record.eyes.as_ref().and_then(EyeNumbers::of);
    if let Some((eyes, larva)) = eyes.zip(controls.first().cloned()) {
        controls.push(of_eyes(larva, Some(eyes.volume_um3), Some(eyes.distance_um)));
    }
    controls
}

/// The eyes of a larva: a control of their own, because not every larva has both.
fn of_eyes(larva: Control, eye_volume_um3: Option<f64>, eye_distance_um: Option<f64>) -> Control {
    Control { estimator: EYES.to_owned(), volume_um3: None, area_um2: None, eye_volume_um3, eye_distance_um, ..larva }
}
