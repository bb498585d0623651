//! Fins too faint for single views: found where the views together show a border.
//!
//! ```text
//!   known edges ── evidence of all views in each slice ── best chains along the capillary ── accepted or not
//!        ▲                                                                                      │
//!        └───────────────────── edges with the accepted pieces ─────────────────────────────────┘
//! ```
//! A fin that is found is followed beyond its ends, and takes its part of the evidence with it: only what stands
//! out of it is searched in the next round.

use super::amend::each_column;
use super::body::smoothed;
use super::extend::extended;
use super::follow::{State, followed};
use super::pool::{DIRECTIONS, Evidence, FEW, Grid, Sight};
use super::taper::tapered;
use super::{Fin, FinSlice, FinView};
use crate::profile::FinBorders;
use crate::statistics::upper_median;
use std::f64::consts::{PI, TAU};

/// Slices from one that is searched to the next. A slice is one px of the capillary.
const STEP: usize = 4;
/// From twice as many views on, only every second is pooled, and so on. Noise averages out over more views, but specks and errors of the
/// background that turn with the glass do not, and the bars of the search belong to so many views.
const VIEWS_MOST: usize = 28;
/// Most rounds of search and amendment.
const ROUNDS: usize = 7;
/// Angle within which a slice has one fin only, rad.
const APART: f64 = 30.0 / 180.0 * PI;
/// Length of a run over which the evidence is averaged, px, and the least mean that it must reach somewhere.
const RUN_PX: f64 = 60.0;
const RUN_LEAST: f64 = 3.0;
/// Least mean response of a half-view to every run of a fin that is followed beyond its end. The best way through noise reaches 1.1.
const RUN_RESPONSE_ON: f64 = 1.2;
/// Shortest piece, px.
const SHORTEST_PX: f64 = 45.0;
/// What a piece must gain over chance, and a piece that goes on where a fin is known.
const GAIN: f32 = 45.0;
const GAIN_ON: f32 = 18.0;
/// Least share of the half-views whose edges make a known curve a fin.
const KNOWN_LEAST: f64 = 0.13;
/// How near the end of a known fin is where a piece goes on: along the capillary, px, and in direction, rad.
const ON_PX: f64 = 30.0;
const ON_ANGLE: f64 = 20.0 / 180.0 * PI;
/// Shortest fin that is followed beyond its ends, px. The free edges of pectoral fins are shorter and end where they are seen to end.
const FOLLOWED_PX: usize = 80;
/// Least median response of a half-view to a piece. Where only few show it, each must show more.
const RESPONSE_LEAST: f64 = 0.95;
const RESPONSE_LEAST_FEW: f64 = 1.8;
const RESPONSE_CLEAR: f64 = 2.5;
/// Share of the half-views below which a piece may be one of a pectoral fin.
const FEW_CLEAR: f64 = 0.27;
/// A pectoral fin is short, and only few views show it, but very clearly: its least gain and length, px. At the ends of the body, this
/// many px, its own rounding looks like that.
const GAIN_CLEAR: f32 = 20.0;
const SHORTEST_CLEAR_PX: f64 = 24.0;
const BODY_END_PX: usize = 48;
/// Two of them at the same place on opposite sides of the body need no such gain: noise and specks hardly give a pair. Largest angle by which the
/// sides differ from opposite ones, rad.
const PAIRED_ANGLE: f64 = 30.0 / 180.0 * PI;
/// From the place of the filter's step to the middle of the border's line, px.
const LINE_PX: f64 = 0.65;
/// Slices beside a piece whose evidence it changes, too: a view sees them in the same columns.
const NEAR: usize = 2;
/// Slices over which a piece is averaged.
const SIGMA: f64 = 2.25;

/// A chain without a gap: the slice of its first state, and its states.
#[derive(Debug, Clone)]
struct Piece {
    first: usize,
    states: Vec<State>,
}

impl Piece {
    fn stations(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.states.len()
    }

    fn ends(&self) -> [(usize, State); 2] {
        let last = self.states.len() - 1;
        [(self.first, self.states[0]), (self.first + last, self.states[last])]
    }
}

/// The directions in which fins are known or were refused, by slice.
struct Blocked(Vec<Vec<bool>>);

impl Blocked {
    fn around(&mut self, at: usize, angle: f64) {
        for (a, blocked) in self.0[at].iter_mut().enumerate() {
            *blocked |= apart(direction(a), angle) < APART;
        }
    }

    fn piece(&mut self, piece: &Piece) {
        piece.stations().zip(&piece.states).for_each(|(at, &(a, _))| self.around(at, direction(a)));
    }

    fn fin(&mut self, fin: &Fin, grid: &Grid) {
        for at in 0..grid.stations.len() {
            if let Some(angle) = angle_of(fin, grid, at) {
                self.around(at, angle);
            }
        }
    }
}

fn direction(a: usize) -> f64 {
    a as f64 * TAU / DIRECTIONS as f64
}

fn apart(a: f64, b: f64) -> f64 {
    ((a - b + PI).rem_euclid(TAU) - PI).abs()
}

/// Direction in which a station's centre sees a fin. `None` beyond the fin's ends.
fn angle_of(fin: &Fin, grid: &Grid, at: usize) -> Option<f64> {
    let station = &grid.stations[at];
    let points = &fin.points_um;
    let after = points.partition_point(|p| p[0] < station.x_um - 1e-6);
    let point = points.get(after).filter(|p| after > 0 || p[0] < station.x_um + 1e-6)?;
    Some(seen_from(station.centre_um, point))
}

fn seen_from([y, z]: [f64; 2], point: &[f64; 3]) -> f64 {
    (point[2] - z).atan2(point[1] - y)
}

/// Whether the end of a piece lies where a fin ends.
fn goes_on(piece: &Piece, fin: &Fin, grid: &Grid, px_um: f64) -> bool {
    let (Some(first), Some(last)) = (fin.points_um.first(), fin.points_um.last()) else { return false };
    piece.ends().iter().zip([last, first]).any(|((at, (a, _)), end)| {
        let station = &grid.stations[*at];
        (end[0] - station.x_um).abs() < ON_PX * px_um && apart(seen_from(station.centre_um, end), direction(*a)) < ON_ANGLE
    })
}

/// The fins that only the views together show, besides the `known` ones, which are continued.
pub(super) fn find(views: &[FinView], slices: &[FinSlice], known: Vec<Fin>, px_um: f64) -> Vec<Fin> {
    let Some(mut search) = Search::new(views, slices, &known, px_um) else { return known };
    for _ in 0..ROUNDS {
        let scores: Vec<&[f32]> = search.evidence.iter().map(|e| e.score.as_slice()).collect();
        let pieces = pieces(&followed(&scores, &search.blocked.0, search.grid.radii));
        let is_last = pieces.is_empty();
        for piece in pieces {
            search.judge(&piece);
        }
        for fin in 0..search.fins.len() {
            search.follow_on(fin, false);
            search.follow_on(fin, true);
        }
        if is_last {
            break;
        }
    }
    search.add_unexplained();
    let found = search.fins;
    (0..found.len()).map(|k| tapered(&found, k, slices, px_um)).collect()
}

/// A search with what it has found so far.
struct Search<'a> {
    sights: Vec<Sight<'a>>,
    slices: &'a [FinSlice],
    grid: Grid,
    evidence: Vec<Evidence>,
    blocked: Blocked,
    fins: Vec<Fin>,
    /// Known curves of few edges. The views together may show them better, and elsewhere.
    weak: Vec<Fin>,
    /// Pieces that few half-views show very clearly, each of which is a fin if another one lies on the opposite side, and whether they were added.
    clear: Vec<(Piece, bool)>,
    px_um: f64,
}

impl<'a> Search<'a> {
    /// `None` where a view does not tell its borders, or where there is nothing to search.
    fn new(views: &'a [FinView<'a>], slices: &'a [FinSlice], known: &[Fin], px_um: f64) -> Option<Self> {
        let sight = |view: &'a FinView<'a>| {
            let (borders, body) = (view.borders?, view.body?);
            let row = |u: usize| body.get(u).map_or([f64::NAN; 2], |e| [e.upper, e.lower]);
            Some(Sight { borders, lookup: view.projection.lookup(), edges: (0..borders.width()).map(row).collect() })
        };
        let step = (views.len() / VIEWS_MOST).max(1);
        let mut sights: Vec<Sight> = views.iter().step_by(step).map(sight).collect::<Option<_>>()?;
        let of_views = |of: &dyn Fn(&FinBorders) -> f64| upper_median(sights.iter().map(|s| of(s.borders)).collect());
        let (margin_px, bore_um) = (of_views(&FinBorders::margin_px), of_views(&FinBorders::bore_px) / 2.0 * px_um);
        let mut grid = Grid::new(slices, STEP, bore_um, margin_px, px_um);
        if grid.radii == 0 || sights.is_empty() {
            return None;
        }
        let least = KNOWN_LEAST * 2.0 * views.len() as f64;
        let (fins, weak): (Vec<Fin>, Vec<Fin>) = known.iter().cloned().partition(|fin| fin.edges as f64 >= least);
        let mut blocked = Blocked(vec![vec![false; DIRECTIONS]; grid.stations.len()]);
        for fin in &fins {
            amend(&mut sights, fin, &grid);
            blocked.fin(fin, &grid);
        }
        let evidence = grid.without_excess(&sights);
        Some(Self { sights, slices, grid, evidence, blocked, fins, weak, clear: Vec::new(), px_um })
    }

    /// Accepts or refuses a piece. Neither is asked for again. Of a piece that owes what it shows to a small part, only that part is judged: the rest
    /// may be noise.
    fn judge(&mut self, piece: &Piece) {
        let (whole, on) = (self.shown(piece), self.goes_on(piece));
        let core = clear_core(piece, &self.evidence, self.grid.radii).filter(|core| {
            let core = self.shown(core);
            let is_all = on.is_none() && whole.gain - core.gain < GAIN_ON && core.is_fin(false);
            core.is_clear() && (is_all || !whole.is_fin(on.is_some()))
        });
        let (piece, on) = core.as_ref().map_or((piece, on), |core| (core, self.goes_on(core)));
        self.blocked.piece(piece);
        let shown = self.shown(piece);
        let paired = |(other, is_added): &(Piece, bool)| are_paired(piece, other) && (*is_added || self.shown(other).is_clear());
        let other = self.clear.iter().position(|other| shown.is_clear() && paired(other));
        let is_fin = shown.is_fin(on.is_some()) || other.is_some();
        if is_fin {
            self.add(piece, on);
        }
        if let Some(at) = other
            && !std::mem::replace(&mut self.clear[at].1, true)
        {
            let other = self.clear[at].0.clone();
            self.add(&other, self.goes_on(&other));
        }
        if shown.is_clear() {
            self.clear.push((piece.clone(), is_fin));
        }
    }

    fn shown(&self, piece: &Piece) -> Shown {
        Shown::of(piece, &self.evidence, self.sights.len(), self.grid.radii)
    }

    /// The fin beyond whose end a piece goes on.
    fn goes_on(&self, piece: &Piece) -> Option<usize> {
        let is_followed = |fin: &Fin| fin.points_um.len() >= FOLLOWED_PX;
        self.fins.iter().position(|fin| is_followed(fin) && goes_on(piece, fin, &self.grid, self.px_um))
    }

    /// Adds the curves of few edges beside which no fin was found.
    fn add_unexplained(&mut self) {
        for weak in std::mem::take(&mut self.weak) {
            let angles: Vec<_> = (0..self.grid.stations.len()).filter_map(|at| Some((at, angle_of(&weak, &self.grid, at)?))).collect();
            let near = |&&(at, angle): &&(usize, f64)| {
                self.fins.iter().filter_map(|fin| angle_of(fin, &self.grid, at)).any(|other| apart(other, angle) < APART)
            };
            if 2 * angles.iter().filter(near).count() < angles.len() {
                self.fins.push(weak);
            }
        }
    }

    /// Follows a known fin beyond one of its ends.
    fn follow_on(&mut self, fin: usize, right: bool) {
        let (grid, points) = (&self.grid, &self.fins[fin].points_um);
        let Some(end) = (if right { points.last() } else { points.first() }) else { return };
        if points.len() < FOLLOWED_PX {
            return;
        }
        let before = |x_um: f64| grid.stations.partition_point(|station| station.x_um < x_um);
        // The last station of the fin.
        let Some(at) = (if right { before(end[0] + 1e-6).checked_sub(1) } else { Some(before(end[0] - 1e-6)) }) else { return };
        let Some(station) = grid.stations.get(at) else { return };
        let [y, z] = station.centre_um;
        let turns = seen_from([y, z], end).rem_euclid(TAU) / TAU;
        let radius_px = (end[1] - y).hypot(end[2] - z) / self.px_um - LINE_PX;
        let from = ((turns * DIRECTIONS as f64).round() as usize % DIRECTIONS, radius_px.round().max(0.0) as usize);
        let mut others = Blocked(vec![vec![false; DIRECTIONS]; grid.stations.len()]);
        self.fins.iter().enumerate().filter(|(other, _)| *other != fin).for_each(|(_, other)| others.fin(other, grid));
        let ahead = |at: usize| (&self.evidence[at], others.0[at].as_slice());
        let mut states = if right {
            extended(from, &(at + 1..grid.stations.len()).map(ahead).collect::<Vec<_>>(), grid.radii)
        } else {
            extended(from, &(0..at).rev().map(ahead).collect::<Vec<_>>(), grid.radii)
        };
        // A long way collects what it needs from noise. It ends where a run of it shows no more than noise does.
        let shown = |(k, &(a, r)): (usize, &State)| self.evidence[if right { at + 1 + k } else { at - 1 - k }].response(a * grid.radii + r);
        let responses: Vec<f64> = states.iter().enumerate().map(shown).collect();
        states.truncate(before_noise(&responses));
        if states.is_empty() {
            return;
        }
        let first = if right {
            at + 1
        } else {
            states.reverse();
            at - states.len()
        };
        let piece = Piece { first, states };
        self.blocked.piece(&piece);
        self.add(&piece, Some(fin));
    }

    /// Adds a piece to a fin or as a new one. Its evidence is then explained.
    fn add(&mut self, piece: &Piece, to: Option<usize>) {
        let more = shaped(piece, &self.evidence, &self.grid, self.slices);
        let at = to.unwrap_or(self.fins.len());
        match to {
            Some(to) => self.fins[to] = joined(&self.fins[to], &more),
            None => self.fins.push(more),
        }
        amend(&mut self.sights, &self.fins[at], &self.grid);
        let near = piece.first.saturating_sub(NEAR)..(piece.stations().end + NEAR).min(self.grid.stations.len());
        let first = near.start;
        for (k, again) in self.grid.all(near, &self.sights).into_iter().enumerate() {
            self.evidence[first + k] = again;
        }
    }
}

/// The pieces of a chain.
fn pieces(chain: &[Option<State>]) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = Vec::new();
    for (at, state) in chain.iter().enumerate() {
        let Some(state) = *state else { continue };
        match pieces.last_mut().filter(|piece| piece.stations().end == at) {
            Some(piece) => piece.states.push(state),
            None => pieces.push(Piece { first: at, states: vec![state] }),
        }
    }
    pieces
}

/// What the evidence says of a piece.
struct Shown {
    /// Evidence beyond that of chance.
    gain: f32,
    /// Median response of a half-view.
    response: f64,
    /// Share of the half-views that show it, in the median of its stations.
    share: f64,
    /// Highest mean of what is pooled over a run.
    highest: f64,
    length_px: f64,
    /// Whether it lies away from the ends of the body.
    is_off_ends: bool,
}

impl Shown {
    fn of(piece: &Piece, evidence: &[Evidence], views: usize, radii: usize) -> Self {
        let along = |of: &dyn Fn(&Evidence, usize) -> f64| -> Vec<f64> {
            piece.stations().zip(&piece.states).map(|(at, &(a, r))| of(&evidence[at], a * radii + r)).collect()
        };
        let end = BODY_END_PX / STEP;
        Self {
            gain: piece.stations().zip(&piece.states).map(|(at, &(a, r))| evidence[at].score[a * radii + r]).sum(),
            response: upper_median(along(&Evidence::response)),
            share: upper_median(along(&|e, i| f64::from(e.views[i]))) / (2.0 * views as f64),
            highest: run_means(&along(&|e, i| f64::from(e.pooled[i]))).into_iter().fold(f64::NEG_INFINITY, f64::max),
            length_px: (piece.states.len() * STEP) as f64,
            is_off_ends: piece.first > end && piece.stations().end + end < evidence.len(),
        }
    }

    /// Whether few half-views show it very clearly, as they do a pectoral fin.
    fn is_clear(&self) -> bool {
        self.share < FEW_CLEAR && self.is_off_ends && self.response > RESPONSE_CLEAR && self.length_px >= SHORTEST_CLEAR_PX
    }

    /// Whether it is a fin. One that goes on where a fin is known needs less.
    fn is_fin(&self, goes_on: bool) -> bool {
        let least = match (self.share < FEW, goes_on) {
            (false, _) => RESPONSE_LEAST,
            (true, true) => RESPONSE_LEAST_FEW,
            (true, false) => RESPONSE_CLEAR,
        };
        let gain = if goes_on { GAIN_ON } else { GAIN };
        let is_long = self.highest >= RUN_LEAST && self.length_px >= SHORTEST_PX;
        (self.is_clear() && self.gain > GAIN_CLEAR) || (self.response >= least && self.gain >= gain && is_long)
    }
}

/// Whether two pieces lie beside each other on opposite sides.
fn are_paired(one: &Piece, other: &Piece) -> bool {
    let (a, b) = (one.stations(), other.stations());
    let shared = a.end.min(b.end).saturating_sub(a.start.max(b.start));
    let middle = |piece: &Piece| direction(piece.states[piece.states.len() / 2].0);
    2 * shared >= a.len().min(b.len()) && apart(middle(one) + PI, middle(other)) < PAIRED_ANGLE
}

/// The longest part of a piece that shows itself clearly, where that is not the whole.
fn clear_core(piece: &Piece, evidence: &[Evidence], radii: usize) -> Option<Piece> {
    let responses: Vec<f64> = piece.stations().zip(&piece.states).map(|(at, &(a, r))| evidence[at].response(a * radii + r)).collect();
    let clear: Vec<bool> = run_means(&responses).into_iter().map(|mean| mean > RESPONSE_CLEAR).collect();
    let runs = (0..clear.len()).collect::<Vec<_>>();
    let longest = runs.chunk_by(|a, b| clear[*a] == clear[*b]).filter(|run| clear[run[0]]).max_by_key(|run| run.len())?;
    (2 * longest.len() < piece.states.len())
        .then(|| Piece { first: piece.first + longest[0], states: piece.states[longest[0]..=longest[longest.len() - 1]].to_vec() })
}

/// Number of responses before the first whose run shows no more than noise does.
fn before_noise(responses: &[f64]) -> usize {
    run_means(responses).iter().take_while(|&&mean| mean >= RUN_RESPONSE_ON).count()
}

/// The means of the runs around each state of a piece.
fn run_means(values: &[f64]) -> Vec<f64> {
    let reach = (RUN_PX / STEP as f64 / 2.0) as usize;
    let mean = |i: usize| {
        let near = &values[i.saturating_sub(reach)..(i + reach + 1).min(values.len())];
        near.iter().sum::<f64>() / near.len() as f64
    };
    (0..values.len()).map(mean).collect()
}

/// The free edge of a fin along a piece, smoothed, with a point in every slice.
fn shaped(piece: &Piece, evidence: &[Evidence], grid: &Grid, slices: &[FinSlice]) -> Fin {
    let offsets: Vec<[f64; 2]> = piece
        .stations()
        .zip(&piece.states)
        .map(|(at, &(a, r))| {
            let (p, [y, z]) = (grid.point(at, a, r as f64 + LINE_PX), grid.stations[at].centre_um);
            [p[0] - y, p[1] - z]
        })
        .collect();
    let smooth = [0, 1].map(|k| smoothed(&offsets.iter().map(|p| p[k]).collect::<Vec<_>>(), SIGMA));
    let node = |i: usize| {
        let [y, z] = grid.stations[piece.first + i].centre_um;
        [y + smooth[0][i], z + smooth[1][i]]
    };
    let last = piece.states.len() - 1;
    let points_um = (0..=last * STEP)
        .map(|k| {
            let (i, part) = (k / STEP, (k % STEP) as f64 / STEP as f64);
            let (a, b) = (node(i), node((i + 1).min(last)));
            [slices[piece.first * STEP + k].x_um, a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]
        })
        .collect();
    let views = |(at, &(a, r)): (usize, &State)| f64::from(evidence[at].views[a * grid.radii + r]);
    Fin { points_um, edges: upper_median(piece.stations().zip(&piece.states).map(views).collect()) as usize }
}

/// Two parts of a fin as one, with a point in every slice. Between the parts it is straight.
fn joined(one: &Fin, other: &Fin) -> Fin {
    let begin = |fin: &Fin| fin.points_um.first().map_or(0.0, |p| p[0]);
    let (left, right) = if begin(one) <= begin(other) { (one, other) } else { (other, one) };
    let mut points_um = left.points_um.clone();
    let end = points_um.last().map_or(f64::NEG_INFINITY, |p| p[0]);
    points_um.extend(right.points_um.iter().filter(|p| p[0] > end));
    Fin { points_um, edges: one.edges.max(other.edges) }
}

/// Moves the known edges of each view out to a fin.
fn amend(sights: &mut [Sight], fin: &Fin, grid: &Grid) {
    let centre = |x_um: f64| {
        let after = grid.stations.partition_point(|station| station.x_um < x_um);
        grid.stations.get(after).or(grid.stations.last()).map_or([0.0; 2], |station| station.centre_um)
    };
    for Sight { lookup, edges, .. } in sights {
        each_column(&fin.points_um, lookup, edges.len(), &centre, |u, v, middle| {
            let lower = v >= middle;
            let edge = &mut edges[u][usize::from(lower)];
            if edge.is_nan() || (v > *edge) == lower {
                *edge = v;
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::body::Known;
    use super::*;
    use crate::calibration::{Support, TurnView};
    use crate::geometry::Camera;
    use crate::profile::{Columns, Polygon, Window};
    use std::f64::consts::FRAC_PI_2;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 160;
    /// Size of a px on the axis, um.
    const PX_UM: f64 = 5.0;
    const BODY_PX: f64 = 30.0;
    /// Radius and direction of the sheet's free edge, and the columns between which it stands.
    const EDGE_PX: f64 = 46.0;
    const DIRECTION: f64 = 0.9;
    const FROM_TO: (f64, f64) = (70.0, 250.0);

    fn camera() -> Camera {
        let (f, k) = (60_000.0, 1.0 / PX_UM);
        let (ux, uy) = ((WIDTH - 1) as f64 / 2.0, (HEIGHT - 1) as f64 / 2.0);
        Camera {
            f,
            kx: k,
            ky: k,
            ux,
            uy,
            s: 0.0,
            alpha: 0.0,
            gamma: 0.0,
            phi: FRAC_PI_2,
            width: WIDTH as u32,
            height: HEIGHT as u32,
            glass: None,
        }
    }

    /// The fins that so many views find on a cylinder with sheets in these directions between two columns, whose borders take `contrast` standard
    /// deviations of a pixel's noise.
    fn found(count: usize, contrast: f64, sheets: &[f64], from_to: (f64, f64)) -> Vec<Fin> {
        let camera = camera();
        let mut state = 7u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 31)
        };
        let mut noise = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let (top, bottom) = (camera.uy - BODY_PX, camera.uy + BODY_PX);
        let right = WIDTH as f64;
        let body = Polygon { vertices: vec![[-1.0, top], [right, top], [right, bottom], [-1.0, bottom]] };
        let body = Columns::from_outlines(&[body], WIDTH, HEIGHT);
        let tip = |direction: f64| [EDGE_PX * direction.cos() * PX_UM, EDGE_PX * direction.sin() * PX_UM];
        let views: Vec<_> = (0..count)
            .map(|i| {
                let omega = TAU * i as f64 / count as f64;
                let projection = camera.projection(omega);
                let row = |&direction: &f64| projection.project([0.0, tip(direction)[0], tip(direction)[1]]).unwrap().1 - camera.uy;
                let edges_px: Vec<f64> = sheets.iter().map(row).collect();
                let lightness: Vec<f32> = (0..WIDTH * HEIGHT)
                    .map(|k| {
                        let (u, v) = ((k % WIDTH) as f64, (k / WIDTH) as f64 - camera.uy);
                        let fin = |edge_px: &f64| {
                            let within = (from_to.0..from_to.1).contains(&u) && v * edge_px > 0.0;
                            let inwards = edge_px.abs() - v.abs();
                            if !within || inwards < -1.5 {
                                0.0
                            } else if inwards < 1.0 {
                                1.0
                            } else {
                                0.5
                            }
                        };
                        let fin = edges_px.iter().map(fin).fold(0.0, f64::max);
                        let level = if v.abs() < BODY_PX { 40.0 } else { contrast * fin };
                        (level + noise()) as f32
                    })
                    .collect();
                let window = Window { lightness: &lightness, width: WIDTH, top: 0, mark: 5.0, blur_px: Some(1.0) };
                (omega, projection, FinBorders::beside(&window, &body, |_| [0.0, (HEIGHT - 1) as f64]))
            })
            .collect();
        let views: Vec<FinView> = views
            .iter()
            .map(|&(omega, projection, ref borders)| {
                let turn = TurnView { columns: &body, omega, dy_px: 0.0 };
                FinView { turn, body: Some(&body), borders: Some(borders), projection }
            })
            .collect();
        let slice = |u: usize| {
            let body = Support { coefficients: vec![BODY_PX * PX_UM, 0.0, 0.0] };
            FinSlice { x_um: (u as f64 - camera.ux) * PX_UM, known: Known::Body, body, points_um: Vec::new() }
        };
        find(&views, &(0..WIDTH).map(slice).collect::<Vec<_>>(), Vec::new(), PX_UM)
    }

    #[test]
    fn a_fin_ends_before_a_long_run_of_noise() {
        let run = (RUN_PX / STEP as f64) as usize;
        let responses = |shown: usize| -> Vec<f64> { (0..10 * run).map(|k| if k < shown { 2.5 } else { 1.0 }).collect() };
        assert_eq!(before_noise(&responses(0)), 0);
        let end = before_noise(&responses(3 * run));
        assert!((3 * run..4 * run).contains(&end), "{end}");
        assert_eq!(before_noise(&responses(10 * run)), 10 * run);
    }

    /// A line of 0.45 of a pixel's noise gives each view about 1.9 standard deviations, which no single view would believe.
    #[test]
    fn a_sheet_that_no_single_view_shows_is_found_within_a_px() {
        let fins = found(21, 0.45, &[DIRECTION], FROM_TO);
        assert_eq!(fins.len(), 1, "{:?}", fins.iter().map(|f| (f.points_um[0], f.edges)).collect::<Vec<_>>());
        let px = |x_um: f64| x_um / PX_UM + camera().ux;
        let (first, last) = (px(fins[0].points_um[0][0]), px(fins[0].points_um[fins[0].points_um.len() - 1][0]));
        assert!((first - FROM_TO.0).abs() < 24.0 && (last - FROM_TO.1).abs() < 24.0, "columns {first:.0} to {last:.0}");
        let inner = fins[0].points_um.iter().filter(|p| (FROM_TO.0 + 12.0..FROM_TO.1 - 12.0).contains(&px(p[0])));
        let radii: Vec<f64> = inner.map(|p| (p[1] * DIRECTION.cos() + p[2] * DIRECTION.sin()) / PX_UM).collect();
        let mean = radii.iter().sum::<f64>() / radii.len() as f64;
        let sd = (radii.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / radii.len() as f64).sqrt();
        assert!((mean - EDGE_PX).abs() < 1.0 && sd < 1.0, "radius {mean:.2} +- {sd:.2}");
    }

    #[test]
    fn without_a_sheet_none_is_found() {
        let fins = found(21, 0.0, &[], FROM_TO);
        assert!(fins.is_empty(), "{:?}", fins.iter().map(|f| (f.points_um[0], f.edges)).collect::<Vec<_>>());
    }

    /// Of 12 views, four to six half-views show a pectoral fin.
    #[test]
    fn few_views_show_a_pair_of_short_fins() {
        let fins = found(12, 0.8, &[DIRECTION, DIRECTION + PI], (140.0, 166.0));
        let sides: Vec<f64> = fins.iter().map(|fin| fin.points_um[fin.points_um.len() / 2]).map(|[_, y, z]| z.atan2(y)).collect();
        assert!(fins.len() == 2 && apart(sides[0] + PI, sides[1]) < 0.2, "{sides:?}");
    }

    #[test]
    fn a_pair_lies_beside_each_other_on_opposite_sides() {
        let piece = |first: usize, degrees: usize| Piece { first, states: vec![(degrees * DIRECTIONS / 360, 20); 10] };
        assert!(are_paired(&piece(40, 90), &piece(43, 268)));
        assert!(!are_paired(&piece(40, 90), &piece(40, 92)));
        assert!(!are_paired(&piece(40, 90), &piece(40, 220)));
        assert!(!are_paired(&piece(40, 90), &piece(46, 270)));
    }

    /// A short clear fin with a long run of noise that joins it: the fin alone is judged.
    #[test]
    fn what_joins_a_clear_piece_is_not_part_of_it() {
        let evidence = |shown: bool| Evidence {
            pooled: vec![if shown { 7.0 } else { 2.6 }; DIRECTIONS],
            views: vec![4; DIRECTIONS],
            score: vec![0.1; DIRECTIONS],
        };
        let piece = Piece { first: 0, states: vec![(3, 0); 60] };
        let of = |from: usize, to: usize| {
            let core = clear_core(&piece, &(0..60).map(|at| evidence((from..to).contains(&at))).collect::<Vec<_>>(), 1)?;
            Some(core.stations())
        };
        let core = of(40, 54).unwrap();
        assert!(core.start.abs_diff(40) <= 5 && core.end.abs_diff(54) <= 5, "{core:?}");
        assert_eq!((of(0, 0), of(0, 60)), (None, None));
    }
}
