//! Plots as SVG: points and lines over axes with few labels.
//!
//! ```text
//!   title                 □ a  □ b        the plotted numbers are in the tables of the document, too:
//!   ^        o  o                         a plot is only an illustration
//!   |  o---o
//!   +-----------> label
//! ```

use carved_core::statistics::mean;
use quick_xml::escape::partial_escape;
use std::f64::consts::TAU;

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 52.0;
/// Colours that people with red-green blindness can distinguish (Okabe and Ito).
const COLOURS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Points joined by lines.
    Line,
    Dashed,
    Dots,
}

#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend. Empty: not in the legend.
    pub name: String,
    /// Series with the same number have the same colour.
    pub colour: usize,
    pub points: Vec<[f64; 2]>,
    /// Half lengths of the bars at the points. Empty: no bars.
    pub bars: Vec<f64>,
    pub style: Style,
}

impl Series {
    pub fn new(style: Style, colour: usize, name: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), colour, points, bars: Vec::new(), style }
    }
}

/// Points of the ellipse that contains `share` of a normal distribution with the mean and covariance of the pairs.
pub fn ellipse(pairs: &[[f64; 2]], share: f64) -> Vec<[f64; 2]> {
    let [a, b, c] = super::statistics::covariance(pairs);
    let mean = [0, 1].map(|i| mean(&pairs.iter().map(|p| p[i]).collect::<Vec<_>>()));
    // The sum of the squares of two normal numbers is exponential.
    let reach = (-2.0 * (1.0 - share).ln()).sqrt();
    // Cholesky factor of the covariance.
    let (l11, l21) = (a.sqrt(), if a > 0.0 { c / a.sqrt() } else { 0.0 });
    let l22 = (b - l21 * l21).max(0.0).sqrt();
    (0..=72)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / 72.0).sin_cos();
            [mean[0] + reach * l11 * cos, mean[1] + reach * (l21 * cos + l22 * sin)]
        })
        .collect()
}

/// Positions of three to six ticks, whose distance is 1, 2, 2.5 or 5 times a power of ten.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let rough = (high - low) / 6.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0].map(|s| s * power).into_iter().find(|s| *s >= rough).unwrap_or(10.0 * power);
    let (first, last) = ((low / step).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last).map(|i| i as f64 * step).collect()
}

fn span(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values.filter(|v| v.is_finite()).fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
    if low > high {
        return [0.0, 1.0];
    }
    let room = (0.06 * (high - low)).max(1e-9 * high.abs()).max(1e-12);
    [low - room, high + room]
}

/// Converts numbers to positions on the page.
struct Scale {
    x: [f64; 2],
    y: [f64; 2],
}

impl Scale {
    /// The scale for all points with their bars.
    fn of(series: &[Series]) -> Self {
        let x = span(series.iter().flat_map(|s| s.points.iter().map(|p| p[0])));
        let y = span(series.iter().flat_map(|s| {
            s.points.iter().enumerate().flat_map(|(i, p)| {
                let bar = s.bars.get(i).copied().unwrap_or(0.0);
                [p[1] - bar, p[1] + bar]
            })
        }));
        Self { x, y }
    }

    fn x(&self, v: f64) -> f64 {
        LEFT + (v - self.x[0]) / (self.x[1] - self.x[0]) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, v: f64) -> f64 {
        HEIGHT - BOTTOM - (v - self.y[0]) / (self.y[1] - self.y[0]) * (HEIGHT - TOP - BOTTOM)
    }
}

pub fn svg(title: &str, x_label: &str, y_label: &str, series: &[Series]) -> String {
    let scale = Scale::of(series);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n<text x=\"{LEFT}\" y=\"16\" font-size=\"14\">{}</text>\n",
        partial_escape(title)
    );
    out += &axes(&scale, x_label, y_label);
    let mut legend = LEFT;
    for s in series {
        out += &drawn(s, &scale);
        if s.name.is_empty() {
            continue;
        }
        out += &format!(
            "<rect x=\"{legend:.1}\" y=\"25\" width=\"10\" height=\"10\" fill=\"{}\"/><text x=\"{:.1}\" y=\"34\">{}</text>\n",
            colour(s),
            legend + 14.0,
            partial_escape(&s.name)
        );
        legend += 30.0 + 6.8 * s.name.chars().count() as f64;
    }
    out + "</svg>\n"
}

fn axes(scale: &Scale, x_label: &str, y_label: &str) -> String {
    let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
    let mut out = String::new();
    for t in ticks(scale.x[0], scale.x[1]) {
        let at = scale.x(t);
        out += &format!(
            "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"#e4e4e4\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n",
            bottom + 16.0,
            number(t)
        );
    }
    for t in ticks(scale.y[0], scale.y[1]) {
        let at = scale.y(t);
        out += &format!(
            "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#e4e4e4\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\n",
            LEFT - 6.0,
            at + 4.0,
            number(t)
        );
    }
    out += &format!("<path d=\"M{LEFT} {TOP}V{bottom}H{right}\" fill=\"none\" stroke=\"black\"/>\n");
    out += &format!(
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n",
        f64::midpoint(LEFT, right),
        HEIGHT - 14.0,
        partial_escape(x_label)
    );
    let middle = f64::midpoint(TOP, bottom);
    out + &format!("<text transform=\"translate(16 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n", partial_escape(y_label))
}

fn colour(series: &Series) -> &'static str {
    COLOURS[series.colour % COLOURS.len()]
}

/// Points or lines, and bars.
fn drawn(s: &Series, scale: &Scale) -> String {
    let (colour, mut out) = (colour(s), String::new());
    if s.style == Style::Dots {
        for p in &s.points {
            let (x, y) = (scale.x(p[0]), scale.y(p[1]));
            out += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{colour}\" fill-opacity=\"0.7\"/>\n");
        }
    } else {
        let dashes = if s.style == Style::Dashed { " stroke-dasharray=\"5 4\"" } else { "" };
        let points: Vec<String> = s.points.iter().map(|p| format!("{:.1},{:.1}", scale.x(p[0]), scale.y(p[1]))).collect();
        out += &format!("<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"{dashes}/>\n", points.join(" "));
    }
    for (p, bar) in s.points.iter().zip(&s.bars) {
        let (low, high) = (scale.y(p[1] - bar), scale.y(p[1] + bar));
        out += &format!("<path d=\"M{:.1} {low:.1}V{high:.1}\" stroke=\"{colour}\"/>\n", scale.x(p[0]));
    }
    out
}

/// The number without trailing digits that mean nothing.
fn number(v: f64) -> String {
    let text = format!("{v:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks(0.0, 84.0).iter().map(|t| number(*t)).collect::<Vec<_>>(), ["0", "20", "40", "60", "80"]);
        assert_eq!(ticks(-0.11, 0.11).iter().map(|t| number(*t)).collect::<Vec<_>>(), ["-0.1", "-0.05", "0", "0.05", "0.1"]);
    }

    #[test]
    fn the_ellipse_of_a_line_is_flat_and_names_are_escaped() {
        let flat = ellipse(&[[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]], 0.95);
        assert!(flat.iter().all(|p| (p[1] - 2.0 * p[0]).abs() < 1e-9), "{flat:?}");
        // exp(-1/2) of a normal distribution is outside the ellipse of one standard deviation.
        let one = ellipse(&[[0.0, 0.0], [2.0, 0.0], [1.0, 1.0]], 1.0 - (-0.5f64).exp());
        assert!((one[0][0] - 2.0).abs() < 1e-9, "{:?}", one[0]);
        assert!(svg("a < b & c", "x", "y", &[Series::new(Style::Dots, 0, "s", vec![[0.0, 1.0]])]).contains("a &lt; b &amp; c"));
    }
}
