//! The plots of a report, as SVG.
//!
//! ```text
//!  plate ────────── a square per well, coloured by a number that counts; wells without a number are crossed; a dot is a flag
//!  distributions ── a row per group: its wells, mean and 95 % interval; behind them the interval of 95 % of reference larvae
//!  response ─────── wells over the logarithm of the dose, dose 0 at the left, the fitted curve and the EC50 with their intervals
//! ```

use crate::tables::statistics::{CurvePoint, DoseSeries, Interval, WellCondition, WellGroup};
use carved_records::{PlateFormat, well_name};
use plotters::coord::ranged1d::{KeyPointHint, Ranged};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::collections::BTreeMap;
use std::error::Error;

pub(super) type Drawn = Result<String, Box<dyn Error + Send + Sync>>;

pub(super) const FONT: &str = "sans-serif";
/// Colours that people with red-green blindness can distinguish (Okabe and Ito).
pub(super) const WELL: RGBColor = RGBColor(0, 114, 178);
pub(super) const FLAGGED: RGBColor = RGBColor(213, 94, 0);
pub(super) const REFERENCE: RGBColor = RGBColor(0, 158, 115);
pub(super) const GREY: RGBColor = RGBColor(110, 110, 110);

/// A number of a well on a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WellNumber {
    pub value: Option<f64>,
    pub flagged: bool,
    /// Whether the number is a lower bound.
    pub is_bound: bool,
    /// Whether a person has left the well out.
    pub is_excluded: bool,
}

impl WellNumber {
    /// The number, if the colours show it.
    fn coloured(&self) -> Option<f64> {
        self.value.filter(|_| !self.is_bound && !self.is_excluded)
    }
}

/// The text of a number with three digits.
pub fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (2 - value.abs().log10().floor() as i32).clamp(0, 6) };
    format!("{value:.*}", digits as usize)
}

fn anchored(size: u32, colour: RGBColor, h: HPos, v: VPos) -> TextStyle<'static> {
    (FONT, size).into_font().color(&colour).pos(Pos::new(h, v))
}

/// A plate by a number of its wells.
///
/// # Errors
/// The plot library's.
pub fn plate(wells: &BTreeMap<String, WellNumber>, format: PlateFormat, unit: &str) -> Drawn {
    let PlateFormat { rows, columns } = format;
    let (cell, left, top) = (if columns > 12 { 34 } else { 56 }, 26, 22);
    let size = (left + cell * columns as i32 + 110, top + cell * rows as i32 + 8);
    let numbers: Vec<f64> = wells.values().filter_map(WellNumber::coloured).collect();
    let [low, high] = numbers.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], &v| [l.min(v), h.max(v)]);
    let share = |value: f64| if high > low { (value - low) / (high - low) } else { 0.5 };
    let colour = |value: f64| ViridisRGB.get_color(share(value));
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (size.0 as u32, size.1 as u32)).into_drawing_area();
        let middle = |size, colour| anchored(size, colour, HPos::Center, VPos::Center);
        for column in 0..columns as i32 {
            root.draw(&Text::new((column + 1).to_string(), (left + cell * column + cell / 2, top / 2), middle(13, GREY)))?;
        }
        for row in 0..rows as i32 {
            let name = well_name(row as u32, 0);
            let letters = name.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
            root.draw(&Text::new(letters, (left / 2, top + cell * row + cell / 2), middle(13, GREY)))?;
        }
        for row in 0..rows {
            for column in 0..columns {
                let corner = (left + cell * column as i32 + 1, top + cell * row as i32 + 1);
                let other = (corner.0 + cell - 2, corner.1 + cell - 2);
                let well = wells.get(&well_name(row, column));
                root.draw(&Rectangle::new([corner, other], RGBColor(205, 205, 205).stroke_width(1)))?;
                // One that is not in the plan has neither.
                if let Some(value) = well.and_then(|well| well.value) {
                    let coloured = well.and_then(WellNumber::coloured);
                    if coloured.is_some() {
                        root.draw(&Rectangle::new([corner, other], colour(value).filled()))?;
                    }
                    let text = if coloured.is_some_and(|value| share(value) <= 0.6) { WHITE } else { BLACK };
                    let size = if cell > 40 { 14 } else { 10 };
                    let words = format!("{}{}", if well.is_some_and(|well| well.is_bound) { "≥ " } else { "" }, short(value));
                    root.draw(&Text::new(words, (corner.0 + cell / 2, corner.1 + cell / 2), middle(size, text)))?;
                } else if well.is_some() {
                    root.draw(&PathElement::new([corner, other], RGBColor(205, 205, 205)))?;
                }
                if well.is_some_and(|well| well.flagged) {
                    root.draw(&Circle::new((other.0 - 7, corner.1 + 7), 4, FLAGGED.filled()))?;
                    root.draw(&Circle::new((other.0 - 7, corner.1 + 7), 4, WHITE.stroke_width(1)))?;
                }
            }
        }
        scale(&root, left + cell * columns as i32 + 18, top, cell * rows as i32, [low, high], unit)?;
        root.present()?;
    }
    Ok(svg)
}

/// The scale of the colours.
fn scale<B: DrawingBackend>(
    root: &DrawingArea<B, plotters::coord::Shift>,
    x: i32,
    top: i32,
    height: i32,
    [low, high]: [f64; 2],
    unit: &str,
) -> Result<(), Box<dyn Error + Send + Sync>>
where
    B::ErrorType: 'static,
{
    if low > high {
        return Ok(());
    }
    let (from, to) = (top + 22, top + height - 4);
    for y in from..to {
        let share = 1.0 - f64::from(y - from) / f64::from((to - from).max(1));
        root.draw(&Rectangle::new([(x, y), (x + 14, y + 1)], ViridisRGB.get_color(share).filled()))?;
    }
    let left = |v| anchored(12, BLACK, HPos::Left, v);
    root.draw(&Text::new(unit.to_owned(), (x, top), left(VPos::Top)))?;
    for (value, y) in [(high, from), (f64::midpoint(low, high), i32::midpoint(from, to)), (low, to)] {
        root.draw(&Text::new(short(value), (x + 20, y), left(VPos::Center)))?;
    }
    Ok(())
}

/// The axis for the values of groups, divided by `scale`, with room around them: the same for all plots of one quantity. The confidence
/// intervals of means are not part of it: that of two wells may be many times as long as all values.
pub fn span(groups: &[&WellGroup], scale: f64) -> [f64; 2] {
    let values = groups.iter().flat_map(|group| {
        let references = group.reference.iter().flat_map(|r| [r.interval_95.low, r.interval_95.high]);
        group.values.iter().map(|v| v.value).chain(references).map(|v| v / scale)
    });
    room(values)
}

/// Names of groups.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Names {
    /// What all groups have in common: age, strain, treatment. Empty where this is nothing.
    pub common: String,
    /// What tells each group from the others.
    pub own: Vec<String>,
}

impl Names {
    /// The names of groups in their order.
    pub fn of(groups: &[&WellCondition]) -> Self {
        let parts: Vec<[Option<String>; 4]> = groups.iter().map(|condition| condition.parts()).collect();
        // The first part tells the dose. It stays, so that no name is empty.
        let is_common = |k: usize| k > 0 && parts.iter().all(|of| of[k] == parts[0][k]);
        let joined = |of: &[Option<String>; 4], common: bool| {
            let kept = of.iter().enumerate().filter(|(k, _)| is_common(*k) == common).filter_map(|(_, part)| part.clone());
            kept.collect::<Vec<_>>().join(", ")
        };
        Self {
            common: parts.first().map_or_else(String::new, |of| joined(of, true)),
            own: parts.iter().map(|of| joined(of, false)).collect(),
        }
    }
}

/// Height of a group, and width of a letter of its name, px.
const ROW: i32 = 22;
const LETTER: i32 = 6;

/// The wells of groups, one row each, all values divided by `unit.0`.
///
/// # Errors
/// The plot library's.
pub fn distributions(groups: &[&WellGroup], names: &[String], [low, high]: [f64; 2], unit: (f64, &str)) -> Drawn {
    let (scale, label) = unit;
    let names: Vec<String> = names.iter().map(|name| short_name(name)).collect();
    let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0) as i32;
    let (left, n) = (LETTER * longest + 16, groups.len());
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (760, (ROW * n as i32 + 62) as u32)).into_drawing_area();
        let ends = -0.5..n as f64 - 0.5;
        let mut chart =
            ChartBuilder::on(&root).margin(8).x_label_area_size(46).y_label_area_size(left).build_cartesian_2d(low..high, ends)?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .disable_y_axis()
            .light_line_style(TRANSPARENT)
            .x_desc(label)
            .label_style((FONT, 13))
            .draw()?;
        for (i, (group, name)) in groups.iter().zip(names).enumerate() {
            // The first group is at the top.
            let y = (n - 1 - i) as f64;
            if let Some(Interval { low: from, high: to }) = group.reference.as_ref().map(|r| r.interval_95) {
                chart.draw_series([Rectangle::new([(from / scale, y - 0.42), (to / scale, y + 0.42)], REFERENCE.mix(0.16).filled())])?;
            }
            let wells = group.values.len();
            for (k, well) in group.values.iter().enumerate() {
                // One below the other in the order of the plate, so that wells do not hide each other.
                let at = y + if wells > 1 { 0.5 * (0.5 - k as f64 / (wells - 1) as f64) } else { 0.0 };
                let colour = if well.flagged { FLAGGED } else { WELL };
                chart.draw_series([Circle::new((well.value / scale, at), 3, colour.mix(0.75).filled())])?;
            }
            let mean = group.mean / scale;
            chart.draw_series([PathElement::new([(mean, y - 0.34), (mean, y + 0.34)], BLACK.stroke_width(2))])?;
            if let Some([from, to]) = group.mean_interval_95.map(|i| i.map(|v| v / scale)) {
                let ends = [from.max(low), to.min(high)];
                chart.draw_series([PathElement::new(ends.map(|end| (end, y)), BLACK.stroke_width(2))])?;
                for (end, is_longer, back) in [(ends[0], from < low, 7), (ends[1], to > high, -7)] {
                    let (u, v) = chart.backend_coord(&(end, y));
                    if is_longer {
                        root.draw(&Polygon::new([(u, v), (u + back, v - 4), (u + back, v + 4)], BLACK.filled()))?;
                    }
                }
            }
            let (u, v) = chart.backend_coord(&(low, y));
            root.draw(&Text::new(name, (u - 8, v), anchored(12, BLACK, HPos::Right, VPos::Center)))?;
        }
        root.present()?;
    }
    Ok(svg)
}

/// Whether the interval of a mean is longer than the axis.
pub fn is_longer(group: &WellGroup, [low, high]: [f64; 2], scale: f64) -> bool {
    group.mean_interval_95.is_some_and(|i| i.low / scale < low || i.high / scale > high)
}

/// The name of a group, short enough for its place. It is cut in its middle, because its end tells doses apart.
fn short_name(name: &str) -> String {
    const LETTERS: usize = 40;
    const BEFORE: usize = 16;
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= LETTERS {
        return name.to_owned();
    }
    let (before, after) = (&letters[..BEFORE], &letters[letters.len() - (LETTERS - BEFORE - 1)..]);
    before.iter().chain(&['…']).chain(after).collect()
}

/// An interval with room around the values.
pub(super) fn room(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values.filter(|v| v.is_finite()).fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
    if low > high {
        return [0.0, 1.0];
    }
    let room = (0.08 * (high - low)).max(1e-3 * high.abs()).max(1e-12);
    [low - room, high + room]
}

/// The wells of a compound over its doses, and its curve, all values divided by `unit.0`.
///
/// # Errors
/// The plot library's.
pub fn response(response: &DoseSeries, unit: (f64, &str)) -> Drawn {
    let (scale, label) = unit;
    let above: Vec<f64> = response.points.iter().map(|p| p.dose).filter(|&d| d > 0.0).collect();
    let [least, most] = above.iter().fold([f64::INFINITY, 0.0], |[l, h]: [f64; 2], &d| [l.min(d), h.max(d)]);
    // Dose 0 has no logarithm: it stands a decade to the left of the others.
    let zero = least.log10() - 1.0;
    let ends = if response.points.iter().any(|p| p.dose <= 0.0) { zero - 0.2 } else { least.log10() - 0.2 }..most.log10() + 0.2;
    let [low, high] = room(response.points.iter().map(|p| p.value / scale));
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (460, 320)).into_drawing_area();
        let mut chart =
            ChartBuilder::on(&root).margin(8).x_label_area_size(44).y_label_area_size(64).build_cartesian_2d(Decades(ends), low..high)?;
        let dose = |log: &f64| if *log <= zero + 0.5 { "0".to_owned() } else { short_dose(10f64.powf(*log)) };
        let compound = response.condition.compound.clone().unwrap_or_default();
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT)
            .x_label_formatter(&dose)
            .x_desc(format!("{compound}, {}", response.concentration_unit))
            .y_desc(label);
        mesh.label_style((FONT, 13)).draw()?;
        if let Some(curve) = &response.curve {
            let [from, to] = curve.ec50_interval_95.map(|d| d.log10().clamp(least.log10() - 0.2, most.log10() + 0.2));
            chart.draw_series([Rectangle::new([(from, low), (to, high)], GREY.mix(0.15).filled())])?;
            let end = |of: fn(&CurvePoint) -> f64| curve.line.iter().map(move |p| (p.dose.log10(), (of(p) / scale).clamp(low, high)));
            let band: Vec<_> = end(|p| p.interval_95.high).chain(end(|p| p.interval_95.low).rev()).collect();
            chart.draw_series([Polygon::new(band, WELL.mix(0.2).filled())])?;
            chart.draw_series(LineSeries::new(end(|p| p.value), BLACK.stroke_width(2)))?;
            let ec50 = curve.ec50.log10();
            if (least.log10()..=most.log10()).contains(&ec50) {
                chart.draw_series([PathElement::new([(ec50, low), (ec50, high)], GREY.stroke_width(1))])?;
            }
        }
        let at = |dose: f64| if dose > 0.0 { dose.log10() } else { zero };
        chart.draw_series(response.points.iter().map(|p| Circle::new((at(p.dose), p.value / scale), 3, WELL.mix(0.75).filled())))?;
        root.present()?;
    }
    Ok(svg)
}

fn short_dose(dose: f64) -> String {
    if (1e-3..1e4).contains(&dose) { format!("{}", (dose * 1e6).round() / 1e6) } else { format!("{dose:.0e}") }
}

/// An axis of logarithms with a label at each decade.
#[derive(Clone)]
struct Decades(std::ops::Range<f64>);

impl Ranged for Decades {
    type FormatOption = plotters::coord::ranged1d::NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value - self.0.start) / (self.0.end - self.0.start);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        (self.0.start.ceil() as i32..=self.0.end.floor() as i32).map(f64::from).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.0.clone()
    }
}

impl plotters::coord::ranged1d::ValueFormatter<f64> for Decades {
    fn format(value: &f64) -> String {
        short_dose(10f64.powf(*value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tables::statistics::WellValue;

    fn condition(more: &serde_json::Value) -> WellCondition {
        let mut well = serde_json::json!({"well": "A01", "dpf": 5, "strain": "TL"});
        well.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        WellCondition::of(&serde_json::from_value(well).unwrap())
    }

    #[test]
    fn what_groups_have_in_common_is_not_part_of_their_names() {
        let of = |more: &[serde_json::Value]| {
            let conditions: Vec<WellCondition> = more.iter().map(condition).collect();
            let Names { common, own } = Names::of(&conditions.iter().collect::<Vec<_>>());
            (common, own.join(" | "))
        };
        let dosed = |dose: f64| serde_json::json!({"compound": "rapamycin", "concentration": dose, "concentration_unit": "uM"});
        assert_eq!(of(&[dosed(0.1), dosed(1.0)]), ("5 dpf, TL".into(), "rapamycin 0.1 uM | rapamycin 1 uM".into()));
        let older = serde_json::json!({"dpf": 6});
        assert_eq!(of(&[dosed(1.0), older]), ("TL".into(), "rapamycin 1 uM, 5 dpf | larva, 6 dpf".into()));
        assert_eq!(of(&[]), (String::new(), String::new()));
    }

    #[test]
    fn long_names_that_differ_in_their_dose_stay_different() {
        let of = |dose: &str| short_name(&format!("positive control: a compound with a rather long name, sodium salt {dose} uM"));
        assert_eq!(of("0.03"), "positive control…me, sodium salt 0.03 uM");
        assert_ne!(of("0.03"), of("0.1"));
        assert_eq!(short_name("larva"), "larva");
    }

    #[test]
    fn a_long_interval_does_not_stretch_the_axis_and_ends_in_arrows() {
        let group = |values: &[f64], interval: [f64; 2]| -> WellGroup {
            let of = |&value: &f64| WellValue { run: "r".into(), well: "A01".into(), value, flagged: false };
            WellGroup {
                condition: condition(&serde_json::json!({})),
                n: values.len(),
                left_out: 0,
                mean: 2.0,
                sd: Some(0.1),
                mean_interval_95: Some(interval.into()),
                median: 2.0,
                mad: 0.1,
                reference: None,
                values: values.iter().map(of).collect(),
            }
        };
        let (short, long) = (group(&[1.0, 3.0], [1.5, 2.5]), group(&[1.9, 2.1], [-40.0, 44.0]));
        let groups = [&short, &long];
        let axis = span(&groups, 1.0);
        assert!(axis[0] > 0.8 && axis[1] < 3.2, "{axis:?}");
        assert_eq!(groups.map(|group| is_longer(group, axis, 1.0)), [false, true]);
        let svg = distributions(&groups, &["one".into(), "two".into()], axis, (1.0, "length, mm")).unwrap();
        assert_eq!(svg.matches("<polygon").count(), 2, "{svg}");
    }

    #[test]
    fn numbers_are_written_with_three_digits() {
        let found = [307.46, 3.914, 0.5671, 0.0, 1234.5, 0.000_123].map(short);
        assert_eq!(found, ["307", "3.91", "0.567", "0", "1234", "0.000123"]);
    }

    #[test]
    fn a_plot_of_a_plate_has_each_number_and_a_mark_per_flag() {
        let number = |value, flagged| WellNumber { value, flagged, is_bound: false, is_excluded: false };
        let wells = BTreeMap::from([
            ("A01".to_owned(), number(Some(307.0), false)),
            ("A02".to_owned(), number(Some(258.0), true)),
            ("B01".to_owned(), number(None, false)),
        ]);
        let svg = plate(&wells, PlateFormat::shown(None, &wells.keys().map(String::as_str)), "nl").unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("307") && svg.contains("258"), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 2, "one mark, with a border");
    }

    #[test]
    fn a_bound_and_a_well_that_a_person_left_out_have_no_colour_and_do_not_set_the_scale() {
        let number = |value, is_bound, is_excluded| WellNumber { value: Some(value), flagged: false, is_bound, is_excluded };
        let mut wells = BTreeMap::from([("A01".to_owned(), number(307.0, false, false)), ("A02".to_owned(), number(258.0, false, false))]);
        let drawn = |wells: &BTreeMap<String, WellNumber>| plate(wells, PlateFormat { rows: 2, columns: 3 }, "nl").unwrap();
        let filled = |svg: &str| svg.matches("fill=\"#").count() - svg.matches("<text").count();
        let before = drawn(&wells);
        wells.extend([("A03".to_owned(), number(9.0, true, false)), ("B01".to_owned(), number(999.0, false, true))]);
        let svg = drawn(&wells);
        assert!(svg.contains("≥ 9") && svg.contains("999") && svg.matches("282").count() == 1, "{svg}");
        assert_eq!(filled(&svg), filled(&before), "both have text alone");
        // A plate of nothing else has no scale.
        wells.retain(|_, well| well.coloured().is_none());
        let svg = drawn(&wells);
        assert!(svg.contains("≥ 9") && !svg.contains("nl"), "{svg}");
    }
}
