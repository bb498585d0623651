//! The capillary's walls: four nearly straight, nearly parallel lines.
//!
//! ```text
//!   outside (bright)
//!   ================  upper.outer     each wall shows as one dark line or two, straight across the whole frame;
//!   ----------------  upper.inner     the specimen shows as dark too, but not straight, and hides a wall where it touches
//!   bore
//!   ----------------  lower.inner
//!   ================  lower.outer
//! ```
//! The frame is cut into vertical strips. Each strip votes for the rows at which it is darker than both sides within a wall's
//! thickness. The votes are summed along every tilt in range, and a vote has the same weight for any darkness, so that an eye
//! weighs no more than a wall. The lines found are then placed to a fraction of a pixel by a robust straight fit through the
//! strips' half-levels.

use super::MARGIN_PX;
use crate::profile::Picture;
use crate::profile::ProfileError;
use crate::profile::raster::plane::{quantile, sum_of, sum_of_pairs};
use crate::profile::settings::WallSettings;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A nearly straight line `v = v_mid + slope (u - u_mid) + bend (u - u_mid)^2` in pixel coordinates. Lenses and pulled glass
/// bend walls by a few px over a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Middle column of the frame, px.
    pub u_mid: f64,
    /// Row in that column, px.
    pub v_mid: f64,
    /// Slope, px per px.
    pub slope: f64,
    /// Bend, per px.
    pub bend: f64,
}

impl Line {
    /// Row in column `u`, px.
    pub fn at(&self, u: f64) -> f64 {
        let from_mid = u - self.u_mid;
        self.v_mid + from_mid * (self.slope + self.bend * from_mid)
    }

    /// The same line shifted to another row of the middle column.
    fn through(&self, v_mid: f64) -> Self {
        Self { v_mid, ..*self }
    }
}

/// One wall, by the middles of its dark lines. Both are the same line where the wall shows as one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    /// The line on the side away from the bore.
    pub outer: Line,
    /// The line on the side of the bore: the inner face of the glass, beyond which no specimen can be.
    pub inner: Line,
}

/// Both walls of the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Walls {
    /// The upper wall.
    pub upper: Wall,
    /// The lower wall.
    pub lower: Wall,
}

impl Walls {
    /// Tilt of the bore, deg. Positive when its right end is lower.
    pub fn tilt_deg(&self) -> f64 {
        f64::midpoint(self.upper.inner.slope, self.lower.inner.slope).atan().to_degrees()
    }

    /// Height of the bore in column `u`, px.
    pub fn bore_px(&self, u: f64) -> f64 {
        self.lower.inner.at(u) - self.upper.inner.at(u)
    }

    /// The rows of a picture of this size from the outer line of one wall to that of the other, with a margin.
    pub(in crate::profile) fn rows(&self, width: usize, height: usize) -> Range<usize> {
        let columns = [0.0, width as f64 / 2.0, width as f64];
        let first = columns.map(|u| self.upper.outer.at(u)).into_iter().fold(f64::INFINITY, f64::min) - MARGIN_PX as f64;
        let last = columns.map(|u| self.lower.outer.at(u)).into_iter().fold(0.0, f64::max) + MARGIN_PX as f64;
        first.max(0.0) as usize..(last.ceil() as usize).min(height)
    }

    /// Row of the bore's middle in column `u`, px.
    pub fn middle_v(&self, u: f64) -> f64 {
        f64::midpoint(self.upper.inner.at(u), self.lower.inner.at(u))
    }
}

/// Mean grey of vertical strips, row by row.
#[derive(Debug, Default)]
struct Strips {
    /// Column of each strip's middle.
    centres_u: Vec<f64>,
    /// `rows[strip][v]`.
    rows: Vec<Vec<f32>>,
    /// The sum of the colours along one row of the picture, green twice.
    greys: Vec<u16>,
}

impl Strips {
    fn read(&mut self, picture: &Picture) {
        let (w, h) = (picture.width(), picture.height());
        let count = (w / 16).clamp(4, 48).min(w);
        let bound = |k: usize| k * w / count;
        self.rows.resize(count, Vec::new());
        self.rows.iter_mut().for_each(|rows| rows.resize(h, 0.0));
        let [red, green, blue] = picture.planes();
        for v in 0..h {
            let row = v * w..(v + 1) * w;
            let colours = red[row.clone()].iter().zip(&green[row.clone()]).zip(&blue[row]);
            self.greys.clear();
            self.greys.extend(colours.map(|((r, g), b)| u16::from(*r) + 2 * u16::from(*g) + u16::from(*b)));
            for (k, strip) in self.rows.iter_mut().enumerate() {
                let span = &self.greys[bound(k)..bound(k + 1)];
                strip[v] = span.iter().map(|&grey| u32::from(grey)).sum::<u32>() as f32 / (4 * span.len()) as f32;
            }
        }
        self.centres_u.clear();
        self.centres_u.extend((0..count).map(|k| (bound(k) + bound(k + 1) - 1) as f64 / 2.0));
    }

    /// Blurs the strips across the capillary by a Gaussian of about 2 px.
    fn blur(&mut self, scratch: &mut Vec<f32>) {
        for rows in &mut self.rows {
            for _ in 0..8 {
                scratch.clear();
                scratch.extend_from_slice(rows);
                let last = rows.len() - 1;
                for (v, row) in rows.iter_mut().enumerate() {
                    *row = (scratch[v.saturating_sub(1)] + 2.0 * scratch[v] + scratch[(v + 1).min(last)]) / 4.0;
                }
            }
        }
    }

    /// How much darker each row is than the brightest row within `reach` above and the brightest within `reach` below.
    /// `brightest` is memory.
    fn dips(&self, reach: usize, brightest: &mut [Vec<f32>; 2], dips: &mut Vec<Vec<f32>>) {
        let [longest, wider] = brightest;
        dips.resize(self.rows.len(), Vec::new());
        for (rows, dips) in self.rows.iter().zip(dips) {
            let h = rows.len();
            // `longest[v]` is the brightest of the last `window` rows up to `v`. Two windows together make a longer one.
            longest.clear();
            longest.extend_from_slice(rows);
            longest.resize(h + reach, f32::MIN);
            let mut window = 1;
            while window < reach + 1 {
                let shift = window.min(reach + 1 - window);
                wider.clear();
                wider.extend_from_slice(&longest[..shift]);
                wider.extend(longest[shift..].iter().zip(&*longest).map(|(a, b)| if a > b { *a } else { *b }));
                std::mem::swap(longest, wider);
                window += shift;
            }
            dips.clear();
            let sides = longest[..h].iter().zip(&longest[reach..]);
            dips.extend(sides.zip(rows).map(|((above, below), own)| if above < below { above - own } else { below - own }));
        }
    }
}

/// A straight dark line with enough votes: its row in the middle column, and its share of the strips.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    v: f64,
    support: f64,
}

/// Share of the strips that agree on the straight course of each wall, by one of its lines. Walls in soft, small real frames have
/// 0.53 and more, sharp ones 0.8 and more; the edges of a specimen in a picture without walls mostly have 0.4 or less.
const LEAST_STRAIGHT_SHARE: f64 = 0.45;
/// Lines nearer to the picture's upper or lower end cannot be placed.
const BORDER_PX: f64 = 4.0;

/// Finds walls. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(in crate::profile) struct WallFinder {
    strips: Strips,
    /// By strip, as its rows.
    dips: Vec<Vec<f32>>,
    /// The dips of each strip that count: row and weight.
    weights: Vec<Vec<(usize, f32)>>,
    votes: Votes,
    lines: Vec<Candidate>,
    scratch: Scratch,
}

/// Memory of placing lines.
#[derive(Debug, Default)]
struct Scratch {
    /// Where the strips show a line.
    points: Vec<(f64, f64)>,
    /// Grey values of the glass by depth, and those of one depth by strip.
    greys: Vec<f32>,
    across: Vec<f32>,
    brightest: [Vec<f32>; 2],
    consensus: Consensus,
}

impl WallFinder {
    /// # Errors
    /// [`ProfileError::NoWalls`] with the number of straight dark lines that were found; [`ProfileError::OnItsSide`] where they
    /// run from top to bottom; [`ProfileError::CrookedWalls`] where the lines found are too crooked for walls.
    pub fn find(&mut self, picture: &Picture, settings: &WallSettings) -> Result<Walls, ProfileError> {
        /// Across a narrow bore an eye may look like a line; along a capillary both walls have at least this share.
        const CLEAR_SUPPORT: f64 = 0.8;
        let found = self.search(picture, settings);
        if found.is_err() {
            let clear = WallSettings { min_support: settings.min_support.max(CLEAR_SUPPORT), ..settings.clone() };
            if self.search(&picture.transposed(), &clear).is_ok() {
                return Err(ProfileError::OnItsSide);
            }
        }
        found
    }

    fn search(&mut self, picture: &Picture, settings: &WallSettings) -> Result<Walls, ProfileError> {
        self.strips.read(picture);
        let found = self.choose(picture, settings);
        if !matches!(found, Err(ProfileError::CrookedWalls { .. })) {
            return found;
        }
        // Of two lines that nearly blend, each strip may show another one as the darker. Blurred further they are one.
        self.strips.blur(&mut self.scratch.greys);
        self.choose(picture, settings).or(found)
    }

    /// The four lines that the strips vote for.
    fn choose(&mut self, picture: &Picture, settings: &WallSettings) -> Result<Walls, ProfileError> {
        let reach = (settings.line_reach_share * picture.height() as f64).round().max(4.0) as usize;
        self.strips.dips(reach, &mut self.scratch.brightest, &mut self.dips);
        // A dip of half the least depth does not count; one of the least depth or more counts 1.
        let half = settings.min_depth / 2.0;
        self.weights.resize(self.dips.len(), Vec::new());
        for (weights, dips) in self.weights.iter_mut().zip(&self.dips) {
            weights.clear();
            weights.extend(dips.iter().enumerate().filter(|(_, d)| **d > half).map(|(v, d)| (v, ((d - half) / half).min(1.0))));
        }
        let height = picture.height();
        let mid_u = (picture.width() - 1) as f64 / 2.0;
        self.votes.cast(&self.strips, &self.dips, &self.weights, mid_u, settings);
        candidates(&self.votes, settings, &mut self.lines);
        let no_walls = || ProfileError::NoWalls { lines: self.lines.len(), needed_support: settings.min_support };
        let ([upper_outer, upper_inner], [lower_inner, lower_outer]) = pair(&self.lines, height, settings).ok_or_else(no_walls)?;
        let (strips, scratch) = (&self.strips, &mut self.scratch);
        let mut place = |v: f64| place_line(strips, &self.dips, self.votes.course.through(v), settings, scratch);
        let [(upper_outer, a), (upper_inner, b)] = [upper_outer, upper_inner].map(&mut place);
        let [(lower_inner, c), (lower_outer, d)] = [lower_inner, lower_outer].map(place);
        // One of its lines is enough for a wall: dirt or the specimen may hide the other.
        let straight_share = a.max(b).min(c.max(d));
        if straight_share < LEAST_STRAIGHT_SHARE {
            return Err(ProfileError::CrookedWalls { straight_share, needed_share: LEAST_STRAIGHT_SHARE });
        }
        let walls =
            Walls { upper: Wall { outer: upper_outer, inner: upper_inner }, lower: Wall { outer: lower_outer, inner: lower_inner } };
        let walls = past_dark_glass(walls, strips, settings, scratch);
        let last = (picture.width() - 1) as f64;
        let open = [0.0, last / 2.0, last].iter().all(|&u| walls.bore_px(u) >= settings.min_bore_share * height as f64);
        if open { Ok(walls) } else { Err(no_walls()) }
    }
}

/// The votes of the strips for each row of the middle column, along one tilt and bend.
#[derive(Debug)]
struct Votes {
    course: Line,
    /// Share of strips that are dark there.
    support: Vec<f32>,
    /// Mean depth of the dips. Each counts by its logarithm, so that an eye weighs little more than a wall, and so that the middle of a
    /// broad wall is still darker than its flanks. It is 0 where too few strips voted.
    depth: Vec<f32>,
    asked: Vec<bool>,
}

impl Default for Votes {
    fn default() -> Self {
        let course = Line { u_mid: 0.0, v_mid: 0.0, slope: 0.0, bend: 0.0 };
        Self { course, support: Vec::new(), depth: Vec::new(), asked: Vec::new() }
    }
}

/// A bend is accepted only if it raises the score by this factor, so that objects beside a straight wall do not bend it.
const BENT_BETTER: f32 = 1.05;

impl Votes {
    /// The votes along the tilt and bend with the highest maximum.
    fn cast(&mut self, strips: &Strips, dips: &[Vec<f32>], weights: &[Vec<(usize, f32)>], mid_u: f64, settings: &WallSettings) {
        let height = dips[0].len();
        let half_width = mid_u.max(1.0);
        let steps = ((settings.max_tilt_deg.to_radians().tan() * half_width) / 0.5).ceil() as i32;
        let course = |step: i32, sag_px: f64| Line {
            u_mid: mid_u,
            v_mid: 0.0,
            slope: f64::from(step) * 0.5 / half_width,
            bend: sag_px / (half_width * half_width),
        };
        let votes = &mut self.support;
        votes.clear();
        votes.resize(height, 0.0);
        let mut score = |course: Line| {
            votes.fill(0.0);
            for (weight, &u) in weights.iter().zip(&strips.centres_u) {
                let shift = course.at(u).round() as isize;
                for (v, w) in weight {
                    if let Some(vote) = votes.get_mut(v.wrapping_add_signed(-shift)) {
                        *vote += w;
                    }
                }
            }
            sum_of(votes, |vote| vote * vote)
        };
        let mut best = (f32::MIN, 0, course(0, 0.0));
        for step in -steps..=steps {
            let straight = course(step, 0.0);
            let found = score(straight);
            if found > best.0 {
                best = (found, step, straight);
            }
        }
        let (straight, step) = (best.0, best.1);
        let sags = (settings.max_sag_share * 2.0 * half_width).round() as i32;
        for step in step - 6..=step + 6 {
            for sag in (-sags..=sags).filter(|s| *s != 0) {
                let bent = course(step, f64::from(sag));
                let found = score(bent);
                if found > best.0 && found > BENT_BETTER * straight {
                    best = (found, step, bent);
                }
            }
        }
        let (course, count) = (best.2, dips.len() as f32);
        score(course);
        // With a tolerance for the rounding of the share.
        let least = 0.999 * settings.min_support as f32 * count;
        // The depth is needed where a line may be, and beside it.
        self.asked.clear();
        self.asked.resize(height, false);
        for (v, _) in votes.iter().enumerate().filter(|(_, vote)| **vote >= least) {
            self.asked[v.saturating_sub(2 * APART)..(v + 2 * APART + 1).min(height)].fill(true);
        }
        for vote in votes.iter_mut() {
            *vote /= count;
        }
        self.course = course;
        self.depth.clear();
        self.depth.resize(height, 0.0);
        for (dip, &u) in dips.iter().zip(&strips.centres_u) {
            let shift = course.at(u).round() as isize;
            for ((v, sum), _) in self.depth.iter_mut().enumerate().zip(&self.asked).filter(|(_, asked)| **asked) {
                let from = v as isize + shift;
                if (0..height as isize).contains(&from) {
                    *sum += (1.0 + dip[from as usize] / settings.min_depth).ln() / count;
                }
            }
        }
    }
}

/// Rows within which two lines are one.
const APART: usize = 3;

/// Collects the rows that are the darkest within [`APART`] px and for which enough strips voted.
fn candidates(votes: &Votes, settings: &WallSettings, lines: &mut Vec<Candidate>) {
    let (support, depth) = (&votes.support, &votes.depth);
    lines.clear();
    for v in 0..support.len() {
        let near = v.saturating_sub(APART)..(v + APART + 1).min(support.len());
        let best = near.clone().map(|k| support[k]).fold(0.0, f32::max);
        if f64::from(best) < settings.min_support {
            continue;
        }
        let darkest = near.clone().all(|k| depth[k] < depth[v] || (depth[k] <= depth[v] && k >= v));
        if darkest {
            lines.push(Candidate { v: v as f64, support: f64::from(best) });
        }
    }
}

/// Chooses the outer and inner line of both walls. The walls are the outermost well-supported lines. A wall's second line is
/// taken at the depth at which the other wall has one too, since the glass has the same thickness above and below.
fn pair(lines: &[Candidate], height: usize, settings: &WallSettings) -> Option<([f64; 2], [f64; 2])> {
    let strongest = lines.iter().map(|l| l.support).fold(0.0, f64::max);
    let mut strong = lines.iter().filter(|l| l.support >= 0.6 * strongest).map(|l| l.v);
    let upper = strong.next()?;
    let lower = strong.next_back().unwrap_or(upper);
    let outer_px = lower - upper;
    if outer_px < settings.min_bore_share * height as f64 {
        return None;
    }
    let deepest = settings.max_wall_share * outer_px;
    let in_glass = |depth: &f64| *depth > 0.0 && *depth <= deepest;
    let mut inner = (0.0, 0.0);
    for a in lines.iter().map(|l| l.v - upper).filter(in_glass) {
        for b in lines.iter().map(|l| lower - l.v).filter(in_glass) {
            if (a - b).abs() <= (0.15 * a).max(2.0) && a + b > inner.0 + inner.1 {
                inner = (a, b);
            }
        }
    }
    // A specimen may hide the inner line of one wall completely. The thickness of the other wall is then used for both.
    Some(([upper, upper + inner.0], [lower - inner.1, lower]))
}

/// Moves the inner lines to the foot of the glass where the glass is dark throughout and shows no lines of its own. At the
/// foot, the brightest strips, which show no specimen there, rise half way to the level of the bore.
fn past_dark_glass(mut walls: Walls, strips: &Strips, settings: &WallSettings, scratch: &mut Scratch) -> Walls {
    /// Half the width of the line, which lies below the foot. Nothing new is found closer than a line's width.
    const LINE_PX: f64 = 1.0;
    const APART_PX: f64 = 2.5;
    let outer_px = walls.lower.outer.v_mid - walls.upper.outer.v_mid;
    let deepest = (settings.max_wall_share * outer_px) as usize;
    let Scratch { greys, across, .. } = scratch;
    let mut foot = |outer: Line, inwards: f64| {
        let grey_at = |depth: usize| {
            across.clear();
            across.extend(strips.rows.iter().zip(&strips.centres_u).filter_map(|(rows, &u)| {
                let v = (outer.at(u) + inwards * depth as f64).round();
                (v >= 0.0).then(|| rows.get(v as usize).copied()).flatten()
            }));
            quantile(across, 0.8)
        };
        greys.clear();
        greys.extend((0..=deepest).map(grey_at));
        let (dark, bright) = greys.iter().fold((f32::MAX, f32::MIN), |(d, b), &g| (d.min(g), b.max(g)));
        greys.iter().rposition(|&g| g < f32::midpoint(dark, bright)).map(|d| d as f64 - LINE_PX)
    };
    let feet = [foot(walls.upper.outer, 1.0), foot(walls.lower.outer, -1.0)];
    for (wall, inwards, own, other) in [(&mut walls.upper, 1.0, feet[0], feet[1]), (&mut walls.lower, -1.0, feet[1], feet[0])] {
        // A specimen all along a wall makes it look thicker. The glass has the same thickness above and below, but a wall's
        // outer line may be missed.
        let Some(depth) = own.map(|own| other.filter(|other| own > 2.0 * other && *other > APART_PX).unwrap_or(own)) else { continue };
        if depth > inwards * (wall.inner.v_mid - wall.outer.v_mid) + APART_PX {
            wall.inner = wall.outer.through(wall.outer.v_mid + inwards * depth);
        }
    }
    walls
}

/// Places the dark line near `rough`: the darkest place of each strip that shows it, then the straight line on which most
/// strips agree. Returns their share too. At the picture's border, where nothing can be placed, all strips are assumed to
/// agree.
fn place_line(strips: &Strips, dips: &[Vec<f32>], rough: Line, settings: &WallSettings, scratch: &mut Scratch) -> (Line, f64) {
    let shown = strips.rows.iter().zip(dips).zip(&strips.centres_u);
    let points = &mut scratch.points;
    points.clear();
    points.extend(shown.filter_map(|((rows, dips), &u)| darkest_near(rows, dips, rough.at(u), settings.min_depth).map(|v| (u, v))));
    match scratch.consensus.find(points, rough) {
        Some(line) => (line, points.len() as f64 / strips.rows.len() as f64),
        None if rough.v_mid < BORDER_PX || rough.v_mid + BORDER_PX + 1.0 > dips[0].len() as f64 => (rough, 1.0),
        None => (rough, 0.0),
    }
}

/// The darkest place within 3 px of `near`, interpolated between rows by a parabola through three of them.
fn darkest_near(rows: &[f32], dips: &[f32], near: f64, min_depth: f32) -> Option<f64> {
    let near = near.round();
    if near < BORDER_PX || near + BORDER_PX + 1.0 > rows.len() as f64 {
        return None;
    }
    let near = near as usize;
    let darkest = (near - 3..=near + 3).min_by(|&a, &b| rows[a].total_cmp(&rows[b]))?;
    let (a, b, c) = (f64::from(rows[darkest - 1]), f64::from(rows[darkest]), f64::from(rows[darkest + 1]));
    let bend = a - 2.0 * b + c;
    // At the end of the search range it is still getting darker: this is the specimen beside the wall, not the wall.
    if dips[darkest] < min_depth || b > a || b > c || bend <= 0.0 {
        return None;
    }
    Some(darkest as f64 + 0.5 * (a - c) / bend)
}

/// The straight line on which most points agree.
#[derive(Debug, Default)]
struct Consensus {
    /// Columns from the middle, and rows less the bend.
    from_mid: Vec<f32>,
    straight: Vec<f32>,
}

impl Consensus {
    /// The line through two of the points, bent as `rough` or slightly more or less, with the most others within `AGREE_PX`; then
    /// least squares through those. Only lines within a degree of `rough` are considered.
    fn find(&mut self, points: &mut Vec<(f64, f64)>, rough: Line) -> Option<Line> {
        const AGREE_PX: f64 = 0.7;
        const SAG_STEPS: i32 = 3;
        let half_width = rough.u_mid.max(1.0);
        let Self { from_mid, straight } = self;
        from_mid.clear();
        from_mid.extend(points.iter().map(|p| (p.0 - rough.u_mid) as f32));
        let mut best: Option<(f32, Line)> = None;
        for sag in -SAG_STEPS..=SAG_STEPS {
            let bend = rough.bend + 0.5 * f64::from(sag) / (half_width * half_width);
            // In units of the agreement from the rough line.
            straight.clear();
            straight.extend(points.iter().map(|p| ((p.1 - Line { bend, ..rough }.at(p.0)) / AGREE_PX) as f32));
            let places = || from_mid.iter().zip(&*straight);
            for (i, (x, y)) in places().enumerate() {
                for (other_x, other_y) in places().skip(i + 1) {
                    let slope = (other_y - y) / (other_x - x);
                    if slope.abs() > (0.0175 / AGREE_PX) as f32 {
                        continue;
                    }
                    let v_mid = y - slope * x;
                    let score = sum_of_pairs(from_mid, straight, |x, y| {
                        let off = y - v_mid - slope * x;
                        (1.0 - off * off).max(0.0)
                    });
                    // A penalty: a wall counts as straight unless the points clearly contradict it.
                    let score = score - 0.3 * sag.abs() as f32;
                    if score > best.map_or(0.0, |b| b.0) {
                        let unit = |of: f32| f64::from(of) * AGREE_PX;
                        best = Some((score, Line { v_mid: rough.v_mid + unit(v_mid), slope: rough.slope + unit(slope), bend, ..rough }));
                    }
                }
            }
        }
        let line = best?.1;
        points.retain(|p| (p.1 - line.at(p.0)).abs() < AGREE_PX);
        Some(straightened(points, line))
    }
}

/// Shifts and tilts a line to the least-squares fit of the points.
fn straightened(points: &[(f64, f64)], line: Line) -> Line {
    let n = points.len() as f64;
    let (mean_u, mean_off) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1 - line.at(p.0)).sum::<f64>() / n);
    let spread: f64 = points.iter().map(|p| (p.0 - mean_u).powi(2)).sum();
    if points.len() < 3 || spread <= 0.0 {
        return line;
    }
    let tilt = points.iter().map(|p| (p.0 - mean_u) * (p.1 - line.at(p.0) - mean_off)).sum::<f64>() / spread;
    Line { v_mid: line.v_mid + mean_off + tilt * (line.u_mid - mean_u), slope: line.slope + tilt, ..line }
}
