//! The comparison of all pictures with their annotations: a line per picture, a summary, and `compare.csv`.

use super::annotation::Annotations;
use anyhow::Context;
use carved_core::profile::{Comparison, Profile};
use carved_core::statistics::median;
use carved_store::durable;
use std::path::Path;

/// Name of the table in the folder of the results.
pub(super) const TABLE: &str = "compare.csv";
const COLUMNS: [&str; 15] = [
    "picture",
    "annotation",
    "outline",
    "iou",
    "edge_error_mean_px",
    "edge_error_abs_mean_px",
    "edge_error_abs_p95_px",
    "false_area_px",
    "missed_area_px",
    "humps",
    "largest_hump_area_px",
    "area_px",
    "annotation_area_px",
    "fins_found_share",
    "error",
];

/// A picture and how its profile compares.
pub(super) struct Row {
    picture: String,
    /// The file, and the kind of its outline if it was read.
    annotation: Option<(String, Option<&'static str>)>,
    outcome: Outcome,
}

enum Outcome {
    Compared {
        comparison: Comparison,
        fins_found: Option<f64>,
    },
    NoProfile(String),
    /// No file has one of these names.
    NoAnnotation(String),
    /// The annotation cannot be used.
    Unusable(String),
}

/// Compares the profile of a picture, or the reason why there is none.
pub(super) fn row(picture: &Path, profile: Result<&Profile, &str>, annotations: &Annotations) -> Row {
    let name = picture.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let files = annotations.of(picture);
    let mut annotation = files.map(|files| (files.outline.display().to_string(), None));
    let outcome = match (profile, files) {
        (Err(why), _) => Outcome::NoProfile(why.to_owned()),
        (Ok(_), None) => Outcome::NoAnnotation(Annotations::names(picture)),
        (Ok(profile), Some(files)) => {
            let compared = files.read([profile.mask.width(), profile.mask.height()]).and_then(|annotated| {
                annotation = annotation.take().map(|(file, _)| (file, Some(annotated.from)));
                let comparison = annotated.annotation.compare(&profile.mask, &profile.edge)?;
                let fins_found = annotated.body.map(|body| annotated.annotation.fins_found(&body, &profile.mask)).transpose()?.flatten();
                Ok(Outcome::Compared { comparison, fins_found })
            });
            compared.unwrap_or_else(|e| Outcome::Unusable(format!("{e:#}")))
        }
    };
    Row { picture: name, annotation, outcome }
}

impl Row {
    /// Whether there is a profile and no annotation that it could be compared with.
    pub fn lacks_annotation(&self) -> bool {
        matches!(self.outcome, Outcome::NoAnnotation(_) | Outcome::Unusable(_))
    }

    fn error(&self) -> Option<String> {
        match &self.outcome {
            Outcome::Compared { .. } => None,
            Outcome::NoProfile(why) => Some(format!("no profile: {why}")),
            Outcome::NoAnnotation(names) => Some(format!("no annotation; --compare has none of {names}")),
            Outcome::Unusable(why) => Some(format!("annotation not usable: {why}")),
        }
    }

    fn record(&self) -> [String; COLUMNS.len()] {
        let (file, from) = self.annotation.as_ref().map_or(("", None), |(file, from)| (file.as_str(), *from));
        let numbers = match &self.outcome {
            Outcome::Compared { comparison: c, fins_found } => {
                let short = |x: Option<f64>| x.map(|x| format!("{x:.4}")).unwrap_or_default();
                [
                    short(Some(c.iou)),
                    short(c.edge.map(|e| e.mean_px)),
                    short(c.edge.map(|e| e.mean_abs_px)),
                    short(c.edge.map(|e| e.p95_abs_px)),
                    c.false_px.to_string(),
                    c.missed_px.to_string(),
                    c.humps.to_string(),
                    c.largest_hump_px.to_string(),
                    c.area_px.to_string(),
                    c.annotation_area_px.to_string(),
                    short(*fins_found),
                ]
            }
            _ => Default::default(),
        };
        let [iou, mean, mean_abs, p95, false_px, missed, humps, hump, area, annotated, fins] = numbers;
        let text = |text: &str| text.to_owned();
        let outline = text(from.unwrap_or_default());
        let error = self.error().unwrap_or_default();
        [text(&self.picture), text(file), outline, iou, mean, mean_abs, p95, false_px, missed, humps, hump, area, annotated, fins, error]
    }
}

/// Writes the table into the folder of the results.
pub(super) fn write(rows: &[Row], out: &Path) -> anyhow::Result<()> {
    let file = out.join(TABLE);
    let name = || format!("{} cannot be written", file.display());
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(COLUMNS).with_context(name)?;
    for row in rows {
        table.write_record(row.record()).with_context(name)?;
    }
    durable::write(&file, &table.into_inner().with_context(name)?).with_context(name)
}

/// The lines for the user: one per picture, and the summary.
pub(super) fn lines(rows: &[Row]) -> Vec<String> {
    let width = rows.iter().map(|row| row.picture.chars().count()).max().unwrap_or(0).max("picture".len());
    let mut lines = vec![format!(
        "{:width$}  {:>6}  {:>8}  {:>8}  {:>8}  {:>8}  {:>9}  {:>5}  {:>10}  {:>5}",
        "picture", "IoU", "edge px", "|edge|", "95 %", "false px", "missed px", "humps", "largest px", "fins"
    )];
    for row in rows {
        let name = &row.picture;
        lines.push(match (&row.outcome, row.error()) {
            (Outcome::Compared { comparison: c, fins_found }, _) => {
                let px =
                    |of: Option<f64>, sign: bool| of.map_or("-".to_owned(), |x| if sign { format!("{x:+.2}") } else { format!("{x:.2}") });
                format!(
                    "{name:width$}  {:>6.4}  {:>8}  {:>8}  {:>8}  {:>8}  {:>9}  {:>5}  {:>10}  {:>5}",
                    c.iou,
                    px(c.edge.map(|e| e.mean_px), true),
                    px(c.edge.map(|e| e.mean_abs_px), false),
                    px(c.edge.map(|e| e.p95_abs_px), false),
                    c.false_px,
                    c.missed_px,
                    c.humps,
                    c.largest_hump_px,
                    px(*fins_found, false),
                )
            }
            (_, error) => format!("{name:width$}  not compared: {}", error.unwrap_or_default()),
        });
    }
    lines.extend(summary(rows));
    lines
}

fn summary(rows: &[Row]) -> Vec<String> {
    let compared: Vec<(&str, &Comparison, Option<f64>)> = rows
        .iter()
        .filter_map(|row| match &row.outcome {
            Outcome::Compared { comparison, fins_found } => Some((row.picture.as_str(), comparison, *fins_found)),
            _ => None,
        })
        .collect();
    let count = |is: fn(&Outcome) -> bool| rows.iter().filter(|row| is(&row.outcome)).count();
    let mut lines = vec![format!(
        "{} of {} pictures compared; {} without a profile, {} without an annotation, {} with an annotation that cannot be used",
        compared.len(),
        rows.len(),
        count(|o| matches!(o, Outcome::NoProfile(_))),
        count(|o| matches!(o, Outcome::NoAnnotation(_))),
        count(|o| matches!(o, Outcome::Unusable(_))),
    )];
    // The worst value of a figure is the one farthest from `best`.
    let mut figure = |name: &str, digits: usize, best: f64, of: &dyn Fn(&Comparison, Option<f64>) -> Option<f64>| {
        let mut values: Vec<(f64, &str)> = compared.iter().filter_map(|(picture, c, fins)| Some((of(c, *fins)?, *picture))).collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some((worst, picture)) = values.iter().copied().max_by(|a, b| (a.0 - best).abs().total_cmp(&(b.0 - best).abs())) else {
            return;
        };
        let median = median(values.iter().map(|(value, _)| *value).collect()).unwrap_or(worst);
        lines.push(format!("{name}: median {median:.digits$}, worst {worst:.digits$} ({picture})"));
    };
    figure("IoU", 4, 1.0, &|c, _| Some(c.iou));
    figure("edge error, mean, px (positive: too large)", 2, 0.0, &|c, _| Some(c.edge?.mean_px));
    figure("edge error, mean of absolute values, px", 2, 0.0, &|c, _| Some(c.edge?.mean_abs_px));
    figure("edge error, 95th percentile of absolute values, px", 2, 0.0, &|c, _| Some(c.edge?.p95_abs_px));
    figure("false px", 0, 0.0, &|c, _| Some(c.false_px as f64));
    figure("missed px", 0, 0.0, &|c, _| Some(c.missed_px as f64));
    figure("humps", 0, 0.0, &|c, _| Some(c.humps as f64));
    figure("largest hump, px", 0, 0.0, &|c, _| Some(c.largest_hump_px as f64));
    figure("share of the fins that was found", 2, 1.0, &|_, fins| fins);
    lines
}
