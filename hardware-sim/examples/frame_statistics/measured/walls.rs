//! The walls of the capillary: two dark lines along the image.

use super::{Plane, quantile};

/// Steepest line that is looked for: 2.3 degrees.
const STEEPEST: f64 = 0.04;
const SLOPES: i32 = 80;
/// Bands of columns that are compared. The body may cover three quarters of them.
const BANDS: usize = 48;
const FREE: f64 = 0.8;
/// Smallest depth of a wall line.
const FAINTEST: f64 = 0.12;

/// Narrowest bore. The two lines of one wall are nearer to each other.
const NARROWEST_PX: f64 = 40.0;

/// Both walls. Rows are given in the middle column of the image.
#[derive(Debug, Clone)]
pub struct Walls {
    /// Rows per column.
    pub slope: f64,
    pub middle_u: f64,
    /// Upper and lower line.
    pub lines: [Line; 2],
}

/// The line of one wall. Two lines that blend count as one.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Row of its darkest point.
    pub row: f64,
    /// Light that it absorbs at its darkest point, 0 to 1.
    pub depth: f64,
    pub fwhm_px: f64,
}

impl Walls {
    pub fn found(plane: &Plane) -> Option<Self> {
        let middle_u = (plane.width as f64 - 1.0) / 2.0;
        let bands = banded(plane);
        let sharpness = |profile: &[f64]| profile.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2)).sum::<f64>();
        let best = (-SLOPES..=SLOPES)
            .map(|i| STEEPEST * f64::from(i) / f64::from(SLOPES))
            .map(|slope| (slope, sharpness(&profile(&bands, slope, middle_u, plane.height, mean))))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (slope, _) = best;
        let lines = pair(&profile(&bands, slope, middle_u, plane.height, |levels| quantile(levels, FREE)))?;
        Some(Self { slope, middle_u, lines })
    }

    /// Row of a line at a column: 0 is the upper, 1 the lower wall.
    pub fn row(&self, which: usize, u: f64) -> f64 {
        self.lines[which].row + self.slope * (u - self.middle_u)
    }

    /// Distance of a pixel from the nearer wall line. It is positive in the bore.
    pub fn inside_px(&self, u: usize, v: usize) -> f64 {
        (v as f64 - self.row(0, u as f64)).min(self.row(1, u as f64) - v as f64)
    }

    pub fn bore_px(&self) -> f64 {
        self.lines[1].row - self.lines[0].row
    }
}

/// The middle column of a band, and the median of each row over the band, relative to the light of the band.
type Band = (f64, Vec<f64>);

fn banded(plane: &Plane) -> Vec<Band> {
    let wide = (plane.width / BANDS).max(1);
    (0..BANDS.min(plane.width))
        .map(|band| {
            let columns: Vec<usize> = (band * wide..((band + 1) * wide).min(plane.width)).collect();
            let rows: Vec<f64> =
                (0..plane.height).map(|v| quantile(&columns.iter().map(|&u| plane.at(u, v)).collect::<Vec<_>>(), 0.5)).collect();
            let light = quantile(&rows, 0.85).max(1.0);
            let middle = columns.iter().sum::<usize>() as f64 / columns.len().max(1) as f64;
            (middle, rows.into_iter().map(|level| level / light).collect())
        })
        .collect()
}

fn mean(levels: &[f64]) -> f64 {
    levels.iter().sum::<f64>() / levels.len().max(1) as f64
}

/// Level of each row along lines of this slope: `of` the levels of all bands.
fn profile(bands: &[Band], slope: f64, middle_u: f64, height: usize, of: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let last = (height - 1) as f64;
    (0..height)
        .map(|v| {
            let levels: Vec<f64> = bands
                .iter()
                .map(|(u, rows)| {
                    let at = (v as f64 + slope * (u - middle_u)).clamp(0.0, last);
                    let low = (at as usize).min(height - 2);
                    rows[low] + (rows[low + 1] - rows[low]) * (at - low as f64)
                })
                .collect();
            of(&levels)
        })
        .collect()
}

/// The two deepest lines that are apart from each other.
fn pair(profile: &[f64]) -> Option<[Line; 2]> {
    let height = profile.len();
    let mut lines: Vec<Line> = (3..height.saturating_sub(3))
        .filter(|&v| (v - 3..=v + 3).all(|w| profile[v] <= profile[w]) && profile[v] < profile[v - 3].max(profile[v + 3]))
        .filter_map(|v| line(profile, v))
        .filter(|line| line.depth > FAINTEST)
        .collect();
    lines.sort_by(|a, b| b.depth.total_cmp(&a.depth));
    let first = *lines.first()?;
    let second = *lines.iter().skip(1).find(|line| (line.row - first.row).abs() > NARROWEST_PX)?;
    Some(if first.row < second.row { [first, second] } else { [second, first] })
}

/// The line whose darkest row is `v`.
fn line(profile: &[f64], v: usize) -> Option<Line> {
    let beside = |from: i64, to: i64| {
        let rows: Vec<f64> = (from..=to).filter_map(|w| usize::try_from(w).ok()).filter_map(|w| profile.get(w).copied()).collect();
        (!rows.is_empty()).then(|| quantile(&rows, 0.5))
    };
    let v_row = v as i64;
    let sides = [beside(v_row - 20, v_row - 14), beside(v_row + 14, v_row + 20)];
    let light = match sides {
        [Some(a), Some(b)] => f64::midpoint(a, b),
        [Some(a), None] | [None, Some(a)] => a,
        [None, None] => return None,
    };
    let (above, here, below) = (profile[v - 1], profile[v], profile[v + 1]);
    let curve = above - 2.0 * here + below;
    let shift = if curve > 1e-9 { (above - below) / (2.0 * curve) } else { 0.0 };
    let half = f64::midpoint(light, here);
    let crossing = |step: i64| {
        (1..18).find_map(|i| {
            let (from, to) = (v_row + step * (i - 1), v_row + step * i);
            let (a, b) = (*profile.get(usize::try_from(from).ok()?)?, *profile.get(usize::try_from(to).ok()?)?);
            (b >= half).then(|| (i - 1) as f64 + (half - a) / (b - a).max(1e-9))
        })
    };
    Some(Line { row: v as f64 + shift.clamp(-0.5, 0.5), depth: 1.0 - here / light, fwhm_px: crossing(-1)? + crossing(1)? })
}
