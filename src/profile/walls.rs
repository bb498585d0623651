//! The capillary's walls: four straight, nearly parallel lines.
//!
//! ```text
//!   outside (bright)
//!   ================  upper.outer     each wall shows as one dark line or two, straight across the whole frame;
//!   ----------------  upper.inner     the specimen shows as dark too, but not straight, and hides a wall where it touches
//!   bore
//!   ----------------  lower.inner
//!   ================  lower.outer
//! ```
//! The frame is cut into vertical strips. Each strip votes for the rows at which it is darker than both sides within a
//! wall's thickness; the votes are summed along every tilt in range, and a vote counts the same however dark it is, so that
//! an eye weighs no more than a wall. The lines found are then placed to a fraction of a pixel by a robust straight fit
//! through the strips' half-levels.

use super::Picture;
use super::segment::ProfileError;
use super::settings::WallSettings;
use serde::{Deserialize, Serialize};

/// A straight line `v = v_at_0 + slope * u` in pixel coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Line {
    pub v_at_0: f64,
    pub slope: f64,
}

impl Line {
    pub fn at(&self, u: f64) -> f64 {
        self.v_at_0 + self.slope * u
    }
}

/// One wall by the middles of its dark lines; both are the same line where the wall shows as one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    /// The line away from the bore.
    pub outer: Line,
    /// The line along the bore: the glass' inner face, beyond which no specimen can be.
    pub inner: Line,
}

/// Both walls of the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Walls {
    pub upper: Wall,
    pub lower: Wall,
}

impl Walls {
    /// Tilt of the bore, positive when its right end is lower, degrees.
    pub fn tilt_deg(&self) -> f64 {
        f64::midpoint(self.upper.inner.slope, self.lower.inner.slope).atan().to_degrees()
    }

    /// Height of the bore in column `u`, px.
    pub fn bore_px(&self, u: f64) -> f64 {
        self.lower.inner.at(u) - self.upper.inner.at(u)
    }

    /// The bore's middle in column `u`: row in px.
    pub fn middle_v(&self, u: f64) -> f64 {
        f64::midpoint(self.upper.inner.at(u), self.lower.inner.at(u))
    }
}

/// Mean grey of vertical strips, row by row.
struct Strips {
    /// Column of each strip's middle.
    centres_u: Vec<f64>,
    /// `rows[strip][v]`.
    rows: Vec<Vec<f32>>,
}

impl Strips {
    fn of(picture: &Picture) -> Self {
        let (w, h) = (picture.width(), picture.height());
        let count = (w / 16).clamp(4, 48).min(w);
        let bounds: Vec<usize> = (0..=count).map(|k| k * w / count).collect();
        let mut rows = vec![vec![0.0f32; h]; count];
        let [red, green, blue] = picture.planes();
        for v in 0..h {
            for (k, strip) in rows.iter_mut().enumerate() {
                let span = v * w + bounds[k]..v * w + bounds[k + 1];
                let sum = |plane: &[u8]| plane[span.clone()].iter().map(|&p| u32::from(p)).sum::<u32>();
                let grey = sum(red) + 2 * sum(green) + sum(blue);
                strip[v] = grey as f32 / (4 * span.len()) as f32;
            }
        }
        let centres_u = bounds.windows(2).map(|b| (b[0] + b[1] - 1) as f64 / 2.0).collect();
        Self { centres_u, rows }
    }

    /// How much darker each row is than the brightest row within `reach` above and the brightest within `reach` below.
    fn dips(&self, reach: usize) -> Vec<Vec<f32>> {
        let brightest = |rows: &[f32]| rows.iter().copied().fold(f32::MIN, f32::max);
        let dips_of = |rows: &Vec<f32>| {
            let h = rows.len();
            (0..h)
                .map(|v| {
                    let above = brightest(&rows[v.saturating_sub(reach)..=v]);
                    let below = brightest(&rows[v..(v + reach + 1).min(h)]);
                    above.min(below) - rows[v]
                })
                .collect()
        };
        self.rows.iter().map(dips_of).collect()
    }
}

/// A straight dark line that enough strips voted for: its row in the middle column, and its share of strips.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    v: f64,
    support: f64,
}

/// Finds the walls.
///
/// # Errors
/// [`ProfileError::NoWalls`] with the number of straight dark lines that were found.
pub(super) fn find(picture: &Picture, settings: &WallSettings) -> Result<Walls, ProfileError> {
    let strips = Strips::of(picture);
    let height = picture.height();
    let reach = (settings.line_reach_share * height as f64).round().max(4.0) as usize;
    let dips = strips.dips(reach);
    let mid_u = (picture.width() - 1) as f64 / 2.0;
    let votes = vote(&strips, &dips, mid_u, settings);
    let (slope, lines) = (votes.slope, candidates(&votes, settings));
    let no_walls = || ProfileError::NoWalls { lines: lines.len(), needed_support: settings.min_support };
    let ([upper_outer, upper_inner], [lower_inner, lower_outer]) = pair(&lines, height, settings).ok_or_else(no_walls)?;
    let rough = |v: f64| Line { v_at_0: v - slope * mid_u, slope };
    let place = |v: f64| place_line(&strips, &dips, rough(v), settings);
    let walls = Walls {
        upper: Wall { outer: place(upper_outer), inner: place(upper_inner) },
        lower: Wall { outer: place(lower_outer), inner: place(lower_inner) },
    };
    let last = (picture.width() - 1) as f64;
    let open = [0.0, last].iter().all(|&u| walls.bore_px(u) >= settings.min_bore_share * height as f64);
    if open { Ok(walls) } else { Err(no_walls()) }
}

/// What the strips say of each row of the middle column, along one tilt.
struct Votes {
    slope: f64,
    /// Share of strips that are dark there.
    support: Vec<f32>,
    /// Mean depth of the dips, each counted up to a limit.
    depth: Vec<f32>,
}

/// Votes along the tilt at which they pile up highest.
fn vote(strips: &Strips, dips: &[Vec<f32>], mid_u: f64, settings: &WallSettings) -> Votes {
    let height = dips[0].len();
    let half_width = mid_u.max(1.0);
    let steps = ((settings.max_tilt_deg.to_radians().tan() * half_width) / 0.5).ceil() as i32;
    // A dip of half the least depth counts nothing, one of the least depth and more counts 1.
    let half = settings.min_depth / 2.0;
    let weights: Vec<Vec<f32>> = dips.iter().map(|dip| dip.iter().map(|d| ((d - half) / half).clamp(0.0, 1.0)).collect()).collect();
    let mut best = (f32::MIN, 0.0, Vec::new());
    for step in -steps..=steps {
        let slope = f64::from(step) * 0.5 / half_width;
        let mut votes = vec![0.0f32; height];
        for (weight, u) in weights.iter().zip(&strips.centres_u) {
            let shift = (slope * (u - mid_u)).round() as isize;
            let (into, from) = ((-shift).max(0) as usize, shift.max(0) as usize);
            for (vote, w) in votes.iter_mut().skip(into).zip(weight.iter().skip(from)) {
                *vote += w;
            }
        }
        let score = votes.iter().map(|v| v * v).sum::<f32>();
        if score > best.0 {
            best = (score, slope, votes);
        }
    }
    let (slope, count) = (best.1, dips.len() as f32);
    let mut depth = vec![0.0f32; height];
    for (dip, u) in dips.iter().zip(&strips.centres_u) {
        let shift = (slope * (u - mid_u)).round() as isize;
        for (v, sum) in depth.iter_mut().enumerate() {
            let from = v as isize + shift;
            if (0..height as isize).contains(&from) {
                *sum += dip[from as usize].min(12.0 * settings.min_depth) / count;
            }
        }
    }
    Votes { slope, support: best.2.iter().map(|v| v / count).collect(), depth }
}

/// Rows that are darkest within 3 px of themselves, where enough strips voted.
fn candidates(votes: &Votes, settings: &WallSettings) -> Vec<Candidate> {
    const APART: usize = 3;
    let (support, depth) = (&votes.support, &votes.depth);
    let mut lines: Vec<Candidate> = Vec::new();
    for v in 0..support.len() {
        let near = v.saturating_sub(APART)..(v + APART + 1).min(support.len());
        let best = near.clone().map(|k| support[k]).fold(0.0, f32::max);
        let darkest = near.clone().all(|k| depth[k] < depth[v] || (depth[k] <= depth[v] && k >= v));
        if darkest && f64::from(best) >= settings.min_support {
            lines.push(Candidate { v: v as f64, support: f64::from(best) });
        }
    }
    lines
}

/// Chooses the outer and inner line of both walls. The walls are the outermost well-supported lines; a wall's second line is
/// taken at the depth at which the other wall has one too, since glass is as thick above as below.
fn pair(lines: &[Candidate], height: usize, settings: &WallSettings) -> Option<([f64; 2], [f64; 2])> {
    let strongest = lines.iter().map(|l| l.support).fold(0.0, f64::max);
    let strong: Vec<f64> = lines.iter().filter(|l| l.support >= 0.6 * strongest).map(|l| l.v).collect();
    let (&upper, &lower) = (strong.first()?, strong.last()?);
    let outer_px = lower - upper;
    if outer_px < settings.min_bore_share * height as f64 {
        return None;
    }
    let deepest = settings.max_wall_share * outer_px;
    let depths = |of: &dyn Fn(f64) -> f64| -> Vec<f64> { lines.iter().map(|l| of(l.v)).filter(|d| *d > 0.0 && *d <= deepest).collect() };
    let (above, below) = (depths(&|v| v - upper), depths(&|v| lower - v));
    let mut inner = (0.0, 0.0);
    for &a in &above {
        for &b in &below {
            if (a - b).abs() <= (0.15 * a).max(2.0) && a + b > inner.0 + inner.1 {
                inner = (a, b);
            }
        }
    }
    // A specimen may hide the inner line of one wall altogether: the other wall's thickness then stands for both.
    Some(([upper, upper + inner.0], [lower - inner.1, lower]))
}

/// Places the dark line near `rough`: the darkest place of each strip that shows it, then the straight line that most strips
/// agree on.
fn place_line(strips: &Strips, dips: &[Vec<f32>], rough: Line, settings: &WallSettings) -> Line {
    let points: Vec<(f64, f64)> = strips
        .rows
        .iter()
        .zip(dips)
        .zip(&strips.centres_u)
        .filter_map(|((rows, dips), &u)| darkest_near(rows, dips, rough.at(u), settings.min_depth).map(|v| (u, v)))
        .collect();
    consensus(&points, rough.slope).unwrap_or(rough)
}

/// The darkest place within 3 px of `near`, between rows by the parabola through three of them.
fn darkest_near(rows: &[f32], dips: &[f32], near: f64, min_depth: f32) -> Option<f64> {
    let near = near.round();
    if near < 4.0 || near + 5.0 > rows.len() as f64 {
        return None;
    }
    let near = near as usize;
    let darkest = (near - 3..=near + 3).min_by(|&a, &b| rows[a].total_cmp(&rows[b]))?;
    let (a, b, c) = (f64::from(rows[darkest - 1]), f64::from(rows[darkest]), f64::from(rows[darkest + 1]));
    let bend = a - 2.0 * b + c;
    // At the end of the search the dark goes on: that is the specimen's side of the wall, not the wall.
    if dips[darkest] < min_depth || b > a || b > c || bend <= 0.0 {
        return None;
    }
    Some(darkest as f64 + 0.5 * (a - c) / bend)
}

/// The line through two of the points that has the most others within half a pixel, then least squares through those. Only
/// lines within a degree of `slope` count.
fn consensus(points: &[(f64, f64)], slope: f64) -> Option<Line> {
    const AGREE_PX: f64 = 0.7;
    let through = |a: (f64, f64), b: (f64, f64)| {
        let slope = (b.1 - a.1) / (b.0 - a.0);
        Line { v_at_0: a.1 - slope * a.0, slope }
    };
    let closeness = |l: &Line| -> f64 { points.iter().map(|p| (1.0 - ((p.1 - l.at(p.0)) / AGREE_PX).powi(2)).max(0.0)).sum() };
    let mut best: Option<(f64, Line)> = None;
    for (i, &a) in points.iter().enumerate() {
        for &b in &points[i + 1..] {
            let line = through(a, b);
            let score = if (line.slope - slope).abs() < 0.0175 { closeness(&line) } else { 0.0 };
            if score > best.map_or(0.0, |b| b.0) {
                best = Some((score, line));
            }
        }
    }
    let line = best?.1;
    let agreeing: Vec<_> = points.iter().filter(|p| (p.1 - line.at(p.0)).abs() < AGREE_PX).collect();
    let n = agreeing.len() as f64;
    let (mean_u, mean_v) = (agreeing.iter().map(|p| p.0).sum::<f64>() / n, agreeing.iter().map(|p| p.1).sum::<f64>() / n);
    let spread: f64 = agreeing.iter().map(|p| (p.0 - mean_u).powi(2)).sum();
    if agreeing.len() < 3 || spread <= 0.0 {
        return Some(line);
    }
    let slope = agreeing.iter().map(|p| (p.0 - mean_u) * (p.1 - mean_v)).sum::<f64>() / spread;
    Some(Line { v_at_0: mean_v - slope * mean_u, slope })
}
