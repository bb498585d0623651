//! Control charts of beads: a measured diameter after the other, with the limits that hold for it.
//!
//! ```text
//!  gates of the rig ─── gates: mean diameter, limits of the gate's own chart, by the date ─┐
//!  beads of the runs ── individuals: diameter, mean ± 2.66 mean moving ranges ──────────────┴─► Series ── draw ── SVG
//! ```

use super::plots::{Drawn, FLAGGED, FONT, GREY, REFERENCE, WELL, room};
use carved_store::gates::GateFile;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Limits of an individuals chart in mean moving ranges: three standard deviations (Montgomery, Introduction to Statistical Quality
/// Control: 3 / d2 with d2 = 1.128 for ranges of two).
const RANGES: f64 = 2.66;
/// Fewest beads that give limits: fewer give limits that are much too wide or too narrow.
const FEWEST: usize = 6;
/// Names under the axis at most.
const NAMES: usize = 24;

/// One point of a chart.
#[derive(Debug, Clone, PartialEq)]
struct Point {
    name: String,
    value: f64,
    limits: Option<[f64; 2]>,
    is_marked: bool,
}

/// The points of one chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What the chart is of.
    pub title: String,
    points: Vec<Point>,
    /// The line in the middle.
    centre: f64,
}

/// A bead of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Bead {
    /// Where it was measured.
    pub name: String,
    pub diameter_um: f64,
    pub is_flagged: bool,
}

impl Series {
    /// The gates of each rig, oldest first, with the nominal diameter in the middle.
    pub fn gates(gates: &[GateFile]) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        for gate in gates.iter().map(|file| &file.found) {
            let nominal = gate.settings.nominal_um;
            let title = format!("Bead gates of {}, nominal diameter {nominal} µm", gate.rig);
            let chart = gate.gate.charts.iter().find(|chart| chart.name == "diameter_um");
            let point = Point {
                name: gate.measured.strftime("%Y-%m-%d").to_string(),
                value: gate.gate.numbers.diameter_um.mean,
                limits: chart.map(|chart| chart.limits),
                is_marked: !gate.gate.verdict.passes(),
            };
            match all.iter_mut().find(|series| series.title == title) {
                Some(series) => series.points.push(point),
                None => all.push(Self { title, points: vec![point], centre: nominal }),
            }
        }
        all
    }

    /// Beads in the order in which they were measured, with the mean in the middle. `None` for a single one.
    pub fn individuals(beads: &[Bead]) -> Option<Self> {
        let n = beads.len();
        if n < 2 {
            return None;
        }
        let centre = beads.iter().map(|bead| bead.diameter_um).sum::<f64>() / n as f64;
        let range = beads.windows(2).map(|pair| (pair[1].diameter_um - pair[0].diameter_um).abs()).sum::<f64>() / (n - 1) as f64;
        let limits = (n >= FEWEST).then_some([centre - RANGES * range, centre + RANGES * range]);
        let point = |bead: &Bead| Point { name: bead.name.clone(), value: bead.diameter_um, limits, is_marked: bead.is_flagged };
        Some(Self { title: "Beads of these runs".into(), points: beads.iter().map(point).collect(), centre })
    }

    /// Whether any point has limits.
    pub fn has_limits(&self) -> bool {
        self.points.iter().any(|point| point.limits.is_some())
    }

    /// The chart as SVG.
    ///
    /// # Errors
    /// The plot library's.
    pub fn draw(&self) -> Drawn {
        let n = self.points.len();
        let [low, high] = room(self.points.iter().flat_map(|p| p.limits.into_iter().flatten().chain([p.value])).chain([self.centre]));
        let width = (120 + 34 * n).clamp(460, 1120) as u32;
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, (width, 300)).into_drawing_area();
            let ends = -0.5..n as f64 - 0.5;
            let mut chart =
                ChartBuilder::on(&root).margin(8).x_label_area_size(84).y_label_area_size(64).build_cartesian_2d(ends, low..high)?;
            let mut mesh = chart.configure_mesh();
            mesh.disable_x_mesh().disable_x_axis().light_line_style(TRANSPARENT).y_desc("diameter, µm").label_style((FONT, 13)).draw()?;
            for (i, point) in self.points.iter().enumerate() {
                let x = i as f64;
                if let Some([from, to]) = point.limits {
                    chart.draw_series([Rectangle::new([(x - 0.5, from), (x + 0.5, to)], REFERENCE.mix(0.16).filled())])?;
                }
            }
            chart.draw_series([PathElement::new([(-0.5, self.centre), (n as f64 - 0.5, self.centre)], GREY.stroke_width(1))])?;
            let values = self.points.iter().enumerate().map(|(i, point)| (i as f64, point.value));
            chart.draw_series(LineSeries::new(values, WELL.stroke_width(1)))?;
            for (i, point) in self.points.iter().enumerate() {
                let is_out = point.is_marked || point.limits.is_some_and(|[from, to]| !(from..=to).contains(&point.value));
                let colour = if is_out { FLAGGED } else { WELL };
                chart.draw_series([Circle::new((i as f64, point.value), 4, colour.filled())])?;
            }
            let style = (FONT, 11).into_font().transform(FontTransform::Rotate90).color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center));
            for (i, point) in self.points.iter().enumerate().step_by(n.div_ceil(NAMES).max(1)) {
                let (x, y) = chart.backend_coord(&(i as f64, low));
                root.draw(&Text::new(point.name.clone(), (x, y + 6), style.clone()))?;
            }
            root.present()?;
        }
        Ok(svg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beads(diameters: &[f64]) -> Vec<Bead> {
        diameters.iter().map(|&d| Bead { name: format!("{d}"), diameter_um: d, is_flagged: false }).collect()
    }

    #[test]
    fn limits_come_from_the_moving_range_and_a_bead_beyond_them_is_marked() {
        let series = Series::individuals(&beads(&[500.0, 501.0, 500.0, 501.0, 500.0, 501.0, 500.0, 509.0])).unwrap();
        // Moving ranges: six of 1 and one of 9.
        let (centre, range) = (4012.0 / 8.0, 15.0 / 7.0);
        let [low, high] = series.points[0].limits.unwrap();
        assert!((low - (centre - 2.66 * range)).abs() < 1e-9 && (high - (centre + 2.66 * range)).abs() < 1e-9);
        let svg = series.draw().unwrap();
        let orange = "#D55E00";
        assert_eq!(svg.matches(orange).count(), 1, "509 is over {high}");
        assert!(svg.contains(">509</text>") || svg.contains("\n509\n"), "{svg}");
    }

    #[test]
    fn few_beads_have_no_limits_and_a_single_one_no_chart() {
        assert!(!Series::individuals(&beads(&[500.0, 501.0, 502.0])).unwrap().has_limits());
        assert_eq!(Series::individuals(&beads(&[500.0])), None);
    }
}
