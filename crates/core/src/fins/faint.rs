//! Fins too faint for single views: found where the views together show a border.
//!
//! ```text
//!   known edges ── evidence of all views in each slice ── best chains along the capillary ── accepted or not
//!        ▲                                                                                      │
//!        └───────────────────── edges with the accepted pieces ─────────────────────────────────┘
//! ```
//! A fin that is found takes its part of the evidence with it: only what stands out of it is asked for in the next round.

use super::body::smoothed;
use super::follow::followed;
use super::pool::{DIRECTIONS, Evidence, FEW, Grid, Sight};
use super::{Fin, FinView, Standing, SAME_PX};
use super::follow::State;
use crate::profile::{Columns, FinBorders};
use crate::statistics::median;
use std::f64::consts::{PI, TAU};

/// Slices from one that is searched to the next. A slice is one px of the capillary.
const STEP: usize = 4;
/// Most rounds of search and amendment.
const ROUNDS: usize = 7;
/// Angle within which a slice has one fin only, rad.
const APART: f64 = 30.0 / 180.0 * PI;
/// Length of a run over which the evidence is averaged, px, and the least mean that it must reach somewhere.
const RUN_PX: f64 = 60.0;
const RUN_LEAST: f64 = 3.0;
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
/// Least median response of a half-view to a piece. Where only few show it, it must go on from a fin or be very clear.
const RESPONSE_LEAST: f64 = 0.95;
const RESPONSE_LEAST_FEW: f64 = 1.8;
const RESPONSE_CLEAR: f64 = 2.5;
/// From the place of the filter's step to the middle of the border's line, px.
const LINE_PX: f64 = 0.65;
/// Slices over which a piece is averaged.
const SIGMA: f64 = 2.25;

/// A chain without a gap: the slice of its first state, and its states.
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

fn sighted<'a>(view: &FinView<'a>) -> Option<(&'a FinBorders, &'a Columns)> {
    Some((view.borders?, view.body?))
}

/// The fins that only the views together show, besides the `known` ones, which may be continued.
pub(super) fn find(views: &[FinView], slices: &[Standing], known: Vec<Fin>, px_um: f64) -> Vec<Fin> {
    if views.is_empty() || views.iter().any(|view| sighted(view).is_none()) {
        return known;
    }
    let mut sights: Vec<Sight> = views
        .iter()
        .filter_map(|view| {
            let (borders, body) = sighted(view)?;
            let row = |u: usize| body.get(u).map_or([f64::NAN; 2], |e| [e.upper, e.lower]);
            Some(Sight { borders, projection: view.projection, edges: (0..borders.width()).map(row).collect() })
        })
        .collect();
    let of_views = |of: &dyn Fn(&FinBorders) -> f64| median(sights.iter().map(|s| of(s.borders)).collect());
    let (margin_px, bore_um) = (of_views(&FinBorders::margin_px), of_views(&FinBorders::bore_px) / 2.0 * px_um);
    let grid = Grid::new(slices, STEP, bore_um, margin_px, px_um);
    if grid.radii == 0 {
        return known;
    }
    // A curve of few edges is found again if the views together show it, and in its right place.
    let known: Vec<Fin> = known.into_iter().filter(|fin| fin.edges as f64 >= p("WEAK", KNOWN_LEAST) * 2.0 * sights.len() as f64).collect();
    known.iter().for_each(|fin| amend(&mut sights, fin, &grid));
    let stations = grid.stations.len();
    let mut blocked = Blocked(vec![vec![false; DIRECTIONS]; stations]);
    known.iter().for_each(|fin| blocked.fin(fin, &grid));
    let mut evidence: Vec<Evidence> = grid.all(0..stations, &sights).into_iter().map(|(_, e)| e).collect();
    let mut fins = known;
    for _ in 0..ROUNDS {
        let scores: Vec<&[f32]> = evidence.iter().map(|e| e.score.as_slice()).collect();
        let pieces = pieces(&followed(&scores, &blocked.0, grid.radii));
        let searched = pieces.is_empty();
        let mut changed = vec![false; stations];
        for piece in pieces {
            blocked.piece(&piece);
            let on = fins.iter().position(|fin| goes_on(&piece, fin, &grid, px_um));
            if is_accepted(&piece, &evidence, on.is_some(), sights.len(), grid.radii) {
                let fin = shaped(&piece, &evidence, &grid, slices);
                amend(&mut sights, &fin, &grid);
                let near = piece.first.saturating_sub(2)..(piece.stations().end + 2).min(stations);
                changed[near].fill(true);
                match on {
                    Some(on) => fins[on] = joined(&fins[on], fin),
                    None => fins.push(fin),
                }
            }
        }
        for (at, again) in grid.all((0..stations).filter(|&at| changed[at]), &sights) {
            evidence[at] = again;
        }
        // The ends of what is known.
        if p("EXT", 1.0) > 0.0 { for k in 0..fins.len() {
            if (fins[k].points_um.len() as f64) < p("EXTLEN", 80.0) { continue; }
            for right in [false, true] {
                let fin = &fins[k];
                let Some(&end) = (if right { fin.points_um.last() } else { fin.points_um.first() }) else { continue };
                let inner = if right { grid.stations.partition_point(|s| s.x_um <= end[0] + 1e-6).checked_sub(1) } else { Some(grid.stations.partition_point(|s| s.x_um < end[0] - 1e-6)) };
                let Some(inner) = inner.filter(|&at| at < stations) else { continue };
                let order: Vec<usize> = if right { (inner + 1..stations).collect() } else { (0..inner).rev().collect() };
                let [y, z] = grid.stations[inner].centre_um;
                let angle = seen_from([y, z], &end);
                let radius = ((end[1] - y).hypot(end[2] - z) / px_um - LINE_PX).round().max(0.0) as usize;
                let from = ((angle.rem_euclid(TAU) / TAU * DIRECTIONS as f64).round() as usize % DIRECTIONS, radius);
                let mut others = Blocked(vec![vec![false; DIRECTIONS]; stations]);
                fins.iter().enumerate().filter(|(j, _)| *j != k).for_each(|(_, fin)| others.fin(fin, &grid));
                let along: Vec<(&Evidence, &[bool])> = order.iter().map(|&at| (&evidence[at], others.0[at].as_slice())).collect();
                let mut states = super::extend::extended(from, &along, grid.radii, (p("EXTFEW", 0.0) * FEW * 2.0 * sights.len() as f64) as f32);
                if states.is_empty() { continue; }
                if std::env::var("FINDBG").is_ok() { eprintln!("   extend fin {k} right {right} from {inner} {from:?} by {} to {:?}", states.len(), states.last()); }
                let first = if right { inner + 1 } else { states.reverse(); inner - states.len() };
                let piece = Piece { first, states };
                blocked.piece(&piece);
                let more = shaped(&piece, &evidence, &grid, slices);
                fins[k] = joined(fin, more);
                let fin = fins[k].clone();
                amend(&mut sights, &fin, &grid);
                let near = piece.first.saturating_sub(2)..(piece.stations().end + 2).min(stations);
                for (at, again) in grid.all(near, &sights) { evidence[at] = again; }
            }
        } }
        if searched {
            break;
        }
    }
    if p("TAPER", 1.0) > 0.0 {
        for k in 0..fins.len() {
            let mut fin = fins[k].clone();
            let others: Vec<Fin> = fins.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, f)| f.clone()).collect();
            super::taper::taper(&mut fin, &others, slices, px_um);
            fins[k] = fin;
        }
    }
    fins
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

fn is_accepted(piece: &Piece, evidence: &[Evidence], goes_on: bool, views: usize, radii: usize) -> bool {
    let at = |of: &dyn Fn(&Evidence, usize) -> f64| -> Vec<f64> {
        piece.stations().zip(&piece.states).map(|(at, &(a, r))| of(&evidence[at], a * radii + r)).collect()
    };
    let gain: f32 = piece.stations().zip(&piece.states).map(|(at, &(a, r))| evidence[at].score[a * radii + r]).sum();
    let pooled = at(&|e, i| f64::from(e.pooled[i]));
    let reach = (RUN_PX / STEP as f64 / 2.0) as usize;
    let mean = |i: usize| {
        let near = &pooled[i.saturating_sub(reach)..(i + reach + 1).min(pooled.len())];
        near.iter().sum::<f64>() / near.len() as f64
    };
    let highest = (0..pooled.len()).map(mean).fold(f64::NEG_INFINITY, f64::max);
    let response = median(at(&|e, i| f64::from(e.pooled[i]) / f64::from(e.views[i].max(1)).sqrt()));
    let seen = median(at(&|e, i| f64::from(e.views[i])));
    let is_few = seen < FEW * 2.0 * views as f64;
    let length = (piece.states.len() * STEP) as f64;
    let inner = piece.first > 12 && piece.stations().end + 12 < evidence.len();
    if is_few && inner && response > p("CLEAR", 2.5) && gain > p("CLEARGAIN", 20.0) as f32 && length >= p("CLEARPX", 24.0) && seen >= p("CLEARN", 3.0) {
        if std::env::var("FINDBG").is_ok() { eprintln!("   clear {:?} a {} r {} gain {gain:.0} highest {highest:.1} response {response:.2} seen {seen} on {goes_on}", piece.stations(), 2 * piece.states[0].0, piece.states[0].1); }
        return true;
    }
    let clear = response >= if is_few { if goes_on { RESPONSE_LEAST_FEW } else { RESPONSE_CLEAR } } else { RESPONSE_LEAST };
    let gain_least = if goes_on { GAIN_ON } else { GAIN };
    if std::env::var("FINDBG").is_ok() {
        eprintln!("   try {:?} a {} r {} gain {gain:.0} highest {highest:.1} response {response:.2} seen {seen} on {goes_on} -> {}", piece.stations(), 2 * piece.states[0].0, piece.states[0].1, clear && gain >= gain_least && highest >= RUN_LEAST && (piece.states.len() * STEP) as f64 >= SHORTEST_PX);
    }
    clear && gain >= gain_least && highest >= RUN_LEAST && (piece.states.len() * STEP) as f64 >= SHORTEST_PX
}

/// The free edge of a fin along a piece, smoothed, with a point in every slice.
fn shaped(piece: &Piece, evidence: &[Evidence], grid: &Grid, slices: &[Standing]) -> Fin {
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
        let station = &grid.stations[piece.first + i];
        [station.x_um, station.centre_um[0] + smooth[0][i], station.centre_um[1] + smooth[1][i]]
    };
    let last = piece.states.len() - 1;
    let points_um = (0..=last * STEP)
        .map(|k| {
            let (i, part) = (k / STEP, (k % STEP) as f64 / STEP as f64);
            let (a, b) = (node(i), node((i + 1).min(last)));
            [slices[(piece.first + i) * STEP + k % STEP].x_um, a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])]
        })
        .collect();
    let edges = median(piece.stations().zip(&piece.states).map(|(at, &(a, r))| f64::from(evidence[at].views[a * grid.radii + r])).collect());
    Fin { points_um, edges: edges as usize }
}

/// Two parts of a fin as one. Between them it is straight.
fn joined(one: &Fin, other: Fin) -> Fin {
    let (left, right) = if one.points_um[0][0] <= other.points_um[0][0] { (one, &other) } else { (&other, one) };
    let mut points_um = left.points_um.clone();
    let end = points_um.last().map_or(f64::NEG_INFINITY, |p| p[0]);
    points_um.extend(right.points_um.iter().filter(|p| p[0] > end));
    Fin { points_um, edges: one.edges.max(other.edges) }
}

/// Moves the known edges of each view out to a fin.
fn amend(sights: &mut [Sight], fin: &Fin, grid: &Grid) {
    for sight in sights {
        let centre = |x: f64| {
            let after = grid.stations.partition_point(|s| s.x_um < x).min(grid.stations.len() - 1);
            grid.stations[after].centre_um
        };
        super::amend::each_column(&fin.points_um, &sight.projection, sight.edges.len(), &centre, |u, v, middle| {
            let lower = v >= middle;
            let edge = &mut sight.edges[u][usize::from(lower)];
            if edge.is_nan() || if lower { v > *edge } else { v < *edge } {
                *edge = v;
            }
        });
    }
    let _ = SAME_PX;
}

/// lab
pub(super) fn p(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default)
}
