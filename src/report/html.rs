//! The report of runs: one HTML file with everything inside, to read on a screen and to print.
//!
//! ```text
//!  head ─ plates ─ groups ─ controls ─ dose response ─ quality ─ beads ─ specimens ─ methods ─ table
//! ```

use super::chart::{Bead, Series};
use super::methods::Methods;
use super::plots::{self, Names};
use super::specimen::{MILLION, Specimen, note_words};
use crate::tables::statistics::{Flagged, QuantityStatistics, Statistics, WellGroup};
use base64::Engine;
use carved_core::flag::StoredFlag;
use carved_pictures::model::BAR_UM;
use carved_records::{Mode, PlateFormat, SpecimenOutcome, WellCounts};
use carved_store::columns::{AFTER, Column, Source};
use carved_store::gates::GateFile;
use carved_store::{RunRecord, Software, StoredRun};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::collections::BTreeMap;

/// Groups in one plot. More do not fit on a page.
const ROWS: usize = 32;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error("a plot cannot be drawn: {0}")]
    Plot(#[from] Box<dyn std::error::Error + Send + Sync>),
}

/// What the report is made of.
struct Report<'r> {
    runs: &'r [StoredRun],
    statistics: Statistics,
    specimens: Vec<Specimen>,
    methods: Vec<Methods>,
    /// Bead gates of the instruments, oldest first.
    gates: &'r [GateFile],
}

/// The report of runs. `gates`: the bead gates of their instruments, oldest first. A well with a file that cannot be read, or was altered, has no numbers, and is named at the top.
///
/// # Errors
/// A plot that cannot be drawn.
pub fn report(runs: &[StoredRun], gates: &[GateFile], flagged: Flagged) -> Result<String, ReportError> {
    let mut specimens = Vec::new();
    for run in runs {
        specimens.extend(Specimen::all(run));
    }
    let methods = runs.iter().map(Methods::of).collect();
    let report = Report { runs, statistics: Statistics::of(runs, flagged), specimens, methods, gates };
    Ok(report.page()?.into_string())
}

fn svg(text: String) -> Markup {
    PreEscaped(text)
}

fn number(value: Option<f64>, scale: f64) -> String {
    value.map_or_else(String::new, |v| plots::short(v / scale))
}

fn with_sd(value: Option<f64>, sd: Option<f64>, scale: f64) -> String {
    match (value, sd) {
        (Some(v), Some(sd)) => format!("{} ± {}", plots::short(v / scale), plots::short(sd / scale)),
        (value, _) => number(value, scale),
    }
}

/// A number of the whole body, which is `at least` this where it is a bound: an interval around a bound would not contain the true one.
fn of_body(s: &Specimen, value: Option<f64>, sd: Option<f64>, scale: f64) -> String {
    match value {
        Some(v) if s.is_bound() => format!("at least {}", plots::short(v / scale)),
        value => with_sd(value, sd, scale),
    }
}

fn outcome(outcome: Option<SpecimenOutcome>) -> String {
    let word = serde_json::to_value(outcome).ok();
    word.as_ref().and_then(|w| w.as_str()).unwrap_or("not done").to_owned()
}

/// The groups of larvae.
fn of_larvae(quantity: &QuantityStatistics) -> Vec<&WellGroup> {
    quantity.groups.iter().filter(|group| group.condition.specimen == "larva").collect()
}

fn names(groups: &[&WellGroup]) -> Names {
    Names::of(&groups.iter().map(|group| &group.condition).collect::<Vec<_>>())
}

/// What a column of the tables means, in words. Its name where there is no such column.
fn meaning(name: &str, is_it: impl Fn(&Column) -> bool) -> &str {
    AFTER.iter().find(|column| is_it(column)).map_or(name, |column| column.meaning)
}

/// A quantity in words.
fn quantity_words(name: &str) -> &str {
    meaning(name, |column| column.name == name)
}

/// A check in words. That of reference larvae has no column of its own: its value is `reference_volume_z`.
fn check_words(name: &str) -> &str {
    if name == "reference_z" {
        return "distance from the mean of reference larvae";
    }
    meaning(name, |column| matches!(column.source, Source::Check(check, "found") if check == name))
}

impl Report<'_> {
    fn page(&self) -> Result<Markup, ReportError> {
        let names = self.statistics.runs.join(", ");
        Ok(html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width";
                    meta name="generator" content={ "carved " (Software::this().words()) };
                    title { "carved: " (names) }
                    style { (PreEscaped(include_str!("report.css"))) }
                }
                body {
                    (self.head())
                    (self.plates()?)
                    (self.groups()?)
                    (self.controls())
                    (self.responses()?)
                    (self.quality())
                    (self.beads()?)
                    (self.pictures())
                    (self.how())
                    (self.table())
                }
            }
        })
    }

    fn head(&self) -> Markup {
        let line = |run: &RunRecord| {
            let WellCounts { succeeded, flagged, failed, skipped, interrupted, pending, total } = WellCounts::of(&run.wells);
            html! {
                tr {
                    td { (run.id) } td.left { (run.plan.plate_barcode) } td.left { (run.plan.method) } td.left { (run.plan.operator) }
                    td.left { (run.started.get(..16).unwrap_or(&run.started).replace('T', " ")) }
                    td { (total) } td { (succeeded + flagged) } td { (flagged) } td { (failed) } td { (skipped) } td { (interrupted + pending) }
                }
            }
        };
        let simulated = self.runs.iter().any(|run| run.record().mode == Mode::Simulated);
        let imported = self.runs.iter().any(|run| run.record().mode == Mode::Imported);
        html! {
            h1 { "Measurements of zebrafish larvae" }
            @if simulated { p.warning { "Simulated: the frames were rendered. No larva was measured." } }
            @if imported { p.warning { "Imported: the frames were taken without carved." } }
            @for (s, why) in self.specimens.iter().filter_map(|s| Some((s, s.unreadable.as_ref()?))) {
                p.warning { "Left out: " (s.run) " " (s.well) ", because it cannot be read: " (why) }
            }
            table {
                thead { tr {
                    th { "run" } th.left { "plate" } th.left { "method" } th.left { "operator" } th.left { "started (UTC)" } th { "wells" } th { "measured" }
                    th { "of them flagged" } th { "failed" } th { "skipped" } th { "not done" }
                } }
                tbody { @for run in self.runs { (line(run.record())) } }
            }
            p.small {
                "Volumes are in 10⁶ µm³ (1 nl), areas in 10⁶ µm² (1 mm²). ± is one standard deviation of the measurement. "
                @match self.statistics.flagged {
                    Flagged::Sound => { "Statistics leave out numbers that are a bound or doubtful, and contain the others with flags; they are marked." },
                    Flagged::Included => { "Statistics contain the " (self.statistics.specimens_with_flags) " specimen(s) with flags; they are marked." },
                    Flagged::Excluded => { "Statistics leave out the " (self.statistics.specimens_with_flags) " specimen(s) with flags." },
                }
            }
            @if self.statistics.specimens > 0 && !self.statistics.counts_any() {
                p.warning { "No specimen counts: all " (self.statistics.specimens) " have flags for which statistics leave them out. There are no groups." }
            }
        }
    }

    fn plates(&self) -> Result<Markup, ReportError> {
        let mut plates = Vec::new();
        for run in self.runs {
            let id = &run.record().id;
            let of_run = self.specimens.iter().filter(|s| s.run == *id && !s.is_bead);
            let wells: BTreeMap<_, _> = of_run.map(|s| (s.well.clone(), s.on_plate())).collect();
            if !wells.is_empty() {
                let planned = run.record().plan.plate_map.iter().map(|planned| planned.well.as_str());
                let format = PlateFormat::shown(run.record().plan.plate_format, &planned);
                plates.push((format!("Plate {}, run {id}", run.record().plan.plate_barcode), plots::plate(&wells, format, "10⁶ µm³")?));
            }
        }
        let has_beads = self.specimens.iter().any(|s| s.is_bead);
        Ok(html! {
            @for (name, plot) in plates {
                section {
                    h2 { (name) ": volume" }
                    (svg(plot))
                    p.small {
                        "A crossed well has no number. A well without colour is a lower bound (≥) or was left out by a person; neither sets the \
                         scale. An orange dot marks a flag."
                        @if has_beads { " Beads are listed below." }
                    }
                }
            }
        })
    }

    fn quantity(&self, name: &str) -> Option<&QuantityStatistics> {
        self.statistics.quantities.iter().find(|q| q.name == name)
    }

    /// Scale and label of a quantity of larvae.
    fn units() -> [(&'static str, (f64, &'static str)); 6] {
        [
            ("volume_um3", (MILLION, "volume, 10⁶ µm³")),
            ("area_um2", (MILLION, "area, 10⁶ µm²")),
            ("body_length_um", (1000.0, "length, mm")),
            ("eye_volume_um3", (MILLION, "volume of an eye, 10⁶ µm³")),
            ("eye_distance_um", (1.0, "distance of the eyes, µm")),
            ("bladder_volume_um3", (MILLION, "swim bladder, 10⁶ µm³")),
        ]
    }

    fn groups(&self) -> Result<Markup, ReportError> {
        let mut figures = Vec::new();
        let (mut common, mut has_arrows) = (String::new(), false);
        for (name, unit) in Self::units() {
            let Some(quantity) = self.quantity(name) else { continue };
            let of_larvae: Vec<&WellGroup> = of_larvae(quantity);
            let span = plots::span(&of_larvae, unit.0);
            has_arrows |= of_larvae.iter().any(|group| plots::is_longer(group, span, unit.0));
            let names = names(&of_larvae);
            // Parts of nearly the same size: a rest of one or two groups would stand on a page of its own.
            let size = of_larvae.len().div_ceil(of_larvae.len().div_ceil(ROWS).max(1)).max(1);
            for (part, own) in of_larvae.chunks(size).zip(names.own.chunks(size)) {
                figures.push(plots::distributions(part, own, span, unit)?);
            }
            common = names.common;
        }
        let volume = self.quantity("volume_um3");
        Ok(html! {
            @if !figures.is_empty() {
                section {
                    h2 { "Groups" }
                    p.small {
                        @if !common.is_empty() { "All groups: " (common) ". " }
                        "Dots are larvae, those with flags orange. The line is the mean with its 95 % confidence interval. "
                        @if has_arrows { "An arrow marks an interval that is longer than the axis. " }
                        "The green band holds 95 % of reference larvae of the same age, where there are any. It has the estimator of the \
                         references: those of the paper are of the carved hull, which is some 3 % larger than the reported volume."
                    }
                    @if let Some(words) = volume.and_then(QuantityStatistics::left_out_words) { p { "Volume: " (words) "." } }
                    @for figure in figures { div.figure { (svg(figure)) } }
                    @if let Some(volume) = volume { (Self::group_table(volume)) }
                }
            } @else if let Some(words) = volume.and_then(QuantityStatistics::left_out_words) {
                section {
                    h2 { "Groups" }
                    p { (words) ". So there are no groups, no controls and no dose response." }
                }
            }
        })
    }

    fn group_table(volume: &QuantityStatistics) -> Markup {
        let groups = of_larvae(volume);
        let names = names(&groups);
        html! {
            table {
                caption { "Volume of each group, 10⁶ µm³" @if !names.common.is_empty() { ". All groups: " (names.common) } }
                thead { tr { th { "group" } th { "n" } th { "mean" } th { "sd" } th { "95 % interval of the mean" } th { "median" } th { "MAD" } } }
                tbody {
                    @for (group, name) in groups.iter().zip(&names.own) {
                        tr {
                            td { (name) } td { (group.n) } td { (plots::short(group.mean / MILLION)) } td { (number(group.sd, MILLION)) }
                            td { @if let Some(interval) = group.mean_interval_95 { (plots::short(interval.low / MILLION)) " to " (plots::short(interval.high / MILLION)) } }
                            td { (plots::short(group.median / MILLION)) } td { (plots::short(group.mad / MILLION)) }
                        }
                    }
                }
            }
        }
    }

    fn controls(&self) -> Markup {
        let windows = || self.statistics.quantities.iter().flat_map(|q| q.windows.iter().map(move |w| (q, w)));
        html! {
            @if windows().next().is_some() {
                section {
                    h2 { "Controls" }
                    table {
                        thead { tr { th { "quantity" } th.left { "run" } th { "positive" } th { "negative" } th { "Z′" } } }
                        tbody { @for (quantity, window) in windows() {
                            tr {
                                td { (quantity_words(&quantity.name)) } td.left { (window.run) } td { (window.positive) } td { (window.negative) }
                                td { @match window.z_prime { Some(z) => { (format!("{z:.2}")) }, None => { (window.reason.as_deref().unwrap_or_default()) } } }
                            }
                        } }
                    }
                }
            }
        }
    }

    fn responses(&self) -> Result<Markup, ReportError> {
        let mut figures = Vec::new();
        for (name, unit) in Self::units() {
            for response in self.quantity(name).iter().flat_map(|q| &q.responses) {
                let words = match &response.curve {
                    Some(curve) => format!(
                        "EC50 {} {} (95 %: {} to {}){}, Hill slope {} ± {}, n = {}",
                        plots::short(curve.ec50),
                        response.concentration_unit,
                        plots::short(curve.ec50_interval_95.low),
                        plots::short(curve.ec50_interval_95.high),
                        if curve.ec50_is_within_doses { "" } else { ", outside the doses" },
                        plots::short(curve.hill.value),
                        plots::short(curve.hill.sd),
                        response.points.len(),
                    ),
                    None => format!("No curve: {}.", response.reason.as_deref().unwrap_or("it was not fitted")),
                };
                figures.push((plots::response(response, unit)?, format!("{}. {words}", response.condition.words())));
            }
        }
        Ok(html! {
            @if !figures.is_empty() {
                section {
                    h2 { "Dose response" }
                    p.small { "Four-parameter logistic curves by least squares. The bands are 95 % confidence intervals: blue of the mean response at each dose, grey of the EC50. Dose 0 are negative controls." }
                    div.pair { @for (plot, words) in figures { figure { (svg(plot)) figcaption { (words) } } } }
                }
            }
        })
    }

    fn quality(&self) -> Markup {
        // By the name of the check: how many were made, how many are over, the limit.
        let mut checks: BTreeMap<(String, String), (usize, usize, f64, f64)> = BTreeMap::new();
        for check in self.specimens.iter().flat_map(|s| &s.quality.checks) {
            let Some(found) = check.found else { continue };
            let entry = checks.entry((check.name.clone(), check.unit.clone())).or_insert((0, 0, check.limit, 0.0));
            entry.0 += 1;
            entry.1 += usize::from(check.over);
            entry.3 += found.abs();
        }
        let mut flags: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for specimen in &self.specimens {
            for flag in &specimen.flags {
                let well = if self.runs.len() > 1 { format!("{} {}", specimen.run, specimen.well) } else { specimen.well.clone() };
                flags.entry(flag.as_str()).or_default().push(well);
            }
        }
        html! {
            section {
                h2 { "Quality" }
                @if flags.is_empty() { p { "No specimen has a flag." } } @else {
                    table {
                        thead { tr { th { "flag" } th { "specimens" } th.left.wide { "wells" } } }
                        tbody { @for (flag, wells) in &flags { tr { td { (flag) } td { (wells.len()) } td.left { (wells.join(", ")) } } } }
                    }
                }
                @if !checks.is_empty() {
                    table {
                        caption { "Checks of all specimens" }
                        thead { tr { th { "check" } th.left { "unit" } th { "limit" } th { "mean magnitude" } th { "specimens" } th { "over the limit" } } }
                        tbody { @for ((name, unit), (made, over, limit, sum)) in &checks {
                            tr { td { (check_words(name)) } td.left { (unit) } td { (plots::short(*limit)) } td { (plots::short(sum / *made as f64)) } td { (made) } td { (over) } }
                        } }
                    }
                }
            }
        }
    }

    fn beads(&self) -> Result<Markup, ReportError> {
        let mut beads: Vec<&Specimen> = self.specimens.iter().filter(|s| s.is_bead).collect();
        // Times of one format: their order is that of their text.
        beads.sort_by_key(|bead| &bead.started);
        let several = self.runs.len() > 1;
        let measured = |s: &&Specimen| {
            let name = if several { format!("{} {}", s.run, s.well) } else { s.well.clone() };
            Some(Bead { name, diameter_um: s.diameter_um?, is_flagged: !s.flags.is_empty() })
        };
        let diameters: Vec<Bead> = beads.iter().filter_map(measured).collect();
        let series: Vec<Series> = Series::gates(self.gates).into_iter().chain(Series::individuals(&diameters)).collect();
        let charts = series.iter().map(|series| Ok((series, series.draw()?))).collect::<Result<Vec<_>, ReportError>>()?;
        Ok(html! {
            section {
                    h2 { "Beads" }
                    @if self.gates.is_empty() { p { "No bead gate is on file." } }
                    @for (series, chart) in charts {
                        figure {
                            (svg(chart))
                            figcaption {
                                (series.title) "."
                                @if series.has_limits() { " The green band has the control limits: orange is outside of them, or did not pass." }
                                @else { " Too few for control limits." }
                            }
                        }
                    }
                    @if !beads.is_empty() { table {
                        thead { tr { th { "run" } th { "well" } th { "outcome" } th { "diameter, µm" } th { "roundness (rms), µm" } th { "aspect ratio" } th { "flags" } } }
                        tbody { @for bead in beads {
                            tr {
                                td { (bead.run) } td { (bead.well) } td { (outcome(bead.outcome)) } td { (bead.diameter_um.map_or_else(String::new, |d| format!("{d:.2}"))) }
                                td { (bead.sphere_rms_um.map_or_else(String::new, |d| format!("{d:.2}"))) }
                                td { (bead.aspect_ratio.map_or_else(String::new, |a| format!("{a:.4}"))) } td { (StoredFlag::joined(&bead.flags, ", ")) }
                            }
                        } }
                    } }
            }
        })
    }

    fn pictures(&self) -> Markup {
        let card = |s: &Specimen| {
            html! {
                div.card {
                    p.name { b { (s.well) } " " (s.condition.words()) }
                    @for picture in &s.pictures.shown {
                        @let data = base64::engine::general_purpose::STANDARD.encode(&picture.jpeg);
                        img src={ "data:image/jpeg;base64," (data) } alt={ (s.well) ", " (picture.words) } title=(picture.words);
                    }
                    @for sentence in &s.pictures.left_out { p.flags { (sentence) } }
                    @if let Some(volume) = s.volume_um3 { p { (of_body(s, Some(volume), s.volume_sd_um3, MILLION)) " · 10⁶ µm³" } }
                    @else { p { (outcome(s.outcome)) @if let Some(reason) = &s.reason { ": " (reason) } } }
                    @if let [Some(volume), sd] = s.eye_volume_um3 { p { "an eye " (with_sd(Some(volume), sd, MILLION)) " · 10⁶ µm³" } }
                    @if !s.flags.is_empty() { p.flags { (StoredFlag::joined(&s.flags, ", ")) } }
                    @if let Some(note) = &s.note { p.flags { (note_words(note)) } }
                }
            }
        };
        html! {
            section {
                h2 { "Specimens" }
                p.small { "Frames as they were taken, cut to the specimen: a larva from its side and from above. The outline is the one that was measured. Below them the model from the side, from the front \
                    and from above, at one scale; the bar is " (BAR_UM) " µm." }
                @for run in self.runs {
                    @if self.runs.len() > 1 { h3 { (run.record().id) } }
                    div.cards { @for s in self.specimens.iter().filter(|s| s.run == run.record().id) { (card(s)) } }
                }
            }
        }
    }

    fn how(&self) -> Markup {
        html! {
            section {
                h2 { "Methods" }
                @for methods in &self.methods {
                    @if self.methods.len() > 1 { h3 { (methods.run) } }
                    p { (methods.paragraph) }
                    dl.parameters { @for parameter in &methods.parameters { div { dt { (parameter.path) } dd { (parameter.words()) } } } }
                }
                p.small { "Report made by carved " (Software::this().words()) "." }
            }
        }
    }

    fn table(&self) -> Markup {
        let several = self.runs.len() > 1;
        let eyes = |s: &Specimen| match (s.eye_volume_um3, &s.eyes_reason) {
            ([None, _], Some(why)) => format!("not found: {why}"),
            ([volume, sd], _) => with_sd(volume, sd, MILLION),
        };
        let bladder = |s: &Specimen| match (s.bladder_volume_um3, s.bladder_state.as_deref()) {
            ([None, _], Some(state)) => state.replace('_', " "),
            ([volume, sd], _) => with_sd(volume, sd, MILLION),
        };
        let row = |s: &Specimen| {
            html! {
                tr {
                    @if several { td { (s.run) } }
                    td { (s.well) } td.left { (s.condition.words()) } td { (outcome(s.outcome)) }
                    td { (of_body(s, s.volume_um3, s.volume_sd_um3, MILLION)) } td { (of_body(s, s.area_um2, s.area_sd_um2, MILLION)) }
                    td { (of_body(s, s.length_um, None, 1000.0)) }
                    @if s.eyes_reason.is_some() { td.left { (eyes(s)) } } @else { td { (eyes(s)) } }
                    td { (with_sd(s.eye_distance_um[0], s.eye_distance_um[1], 1.0)) }
                    td { (bladder(s)) }
                    @for z in s.z { td { (z.map_or_else(String::new, |z| format!("{z:+.1}"))) } }
                    td { (s.estimator.as_deref().unwrap_or_default()) }
                    td.left { (s.remarks()) }
                    td.hash { (s.measurement_sha256.as_deref().and_then(|hash| hash.get(..12)).unwrap_or_default()) }
                }
            }
        };
        html! {
            section.table {
                h2 { "Table" }
                p.small { "Eye: the mean of both. z: standard deviations from the mean of reference larvae of the same age. At least: part of the larva \
                    was not measured, so that the number is a lower bound without SD and z. The last column begins \
                    the SHA-256 of measurement.json. carved export table writes all columns." }
                table {
                    thead { tr {
                        @if several { th { "run" } }
                        th { "well" } th.left { "condition" } th { "outcome" } th { "volume, 10⁶ µm³" } th { "area, 10⁶ µm²" } th { "length, mm" }
                        th { "volume of an eye, 10⁶ µm³" } th { "distance of the eyes, µm" } th { "swim bladder, 10⁶ µm³" }
                        th { "z volume" } th { "z area" } th { "z eye" } th { "z distance" } th { "estimator" } th.left.reasons { "flags, reason, remark" } th { "numbers" }
                    } }
                    tbody { @for s in &self.specimens { (row(s)) } }
                }
            }
        }
    }
}
