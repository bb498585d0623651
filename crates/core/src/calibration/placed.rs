//! Single views at other angles than their own, against the slices that all other views give.
//!
//! ```text
//!   tangents of the other views ── slices (support functions) ──┐
//!   edges of one view ── turned by 0, 5, 10, .. 355 deg ────────┴── distance: least at its own angle, if it belongs there
//! ```
//! A view from the other side shows the same outline upside down. So a view that is upside down fits half a turn away.

use super::Side;
use super::screen::{TRIM, trimmed_rms};
use super::slices::{Equations, HARMONICS_MOST, SHARE_OF_VIEWS, Slice, fit, harmonics};
use super::support::{Support, basis};
use super::tangents::{Pose, TurnView};
use crate::geometry::Camera;
use crate::parallel::prelude::*;
use crate::statistics::upper_median;
use std::f64::consts::{PI, TAU};

/// Most slices that are compared.
const SLICES: usize = 48;
/// Least slices that tell.
const SLICES_LEAST: usize = 8;
/// Angles at which each view is tried.
const ANGLES: usize = 72;
/// Every so many slices are looked at first.
const LOOKED_AT: usize = 3;
/// A view may be exchanged with another one if its distance falls below this share at another angle. The other one, which is among those that it is
/// held against, makes both distances larger.
const EXCHANGED_SHARE: f64 = 0.9;
/// Most views that are exchanged with each other: those that gain most. Where more are wrong, the views are not just exchanged.
const EXCHANGED_MOST: usize = 6;
/// Halves of the turn that are compared with the rest: one of them is within an eighth of the turn of where a wrong half begins.
const HALVES: usize = 4;

/// A view at its own angle, and at the angle where it fits the other views best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placed {
    /// Distance of its edges from those that the other views make expected, px: root of the mean square without the largest 5 %.
    pub own_px: f64,
    /// Half of the edges are nearer than this to those expected at its own angle, px.
    pub half_px: f64,
    /// The first distance at the angle at which it is least, px.
    pub best_px: f64,
    /// That angle minus its own, rad, from -pi to pi.
    pub off_rad: f64,
}

/// Two views of a turn at their own angles, and each at the angle of the other. The slices are those of all other views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Exchanged {
    /// The two views.
    pub views: [usize; 2],
    /// Distance of the edges of each from those that the others make expected, px, without the shift of the view.
    pub own_px: [f64; 2],
    /// The same at the angle of the other.
    pub swapped_px: [f64; 2],
    /// Angle of the second minus that of the first, rad, from -pi to pi.
    pub apart_rad: f64,
}

/// Places each view among the others. `counts` says of each view whether the slices may rest on it. `None` for a view that cannot be compared.
pub(crate) fn placed(camera: &Camera, views: &[TurnView], counts: &[bool]) -> Vec<Option<Placed>> {
    let seen = Seen::new(camera, views, counts);
    let among_others = |view: usize| placed_among(&seen.pose, &seen.without(&[view]), &views[view], Shift::AsGiven);
    (0..views.len()).into_par_iter().map(among_others).collect()
}

/// Places the views of one half of the turn among those of the other, for several halves. A view shows two opposite tangents of each slice, so
/// half a turn shows all sides. What is wrong with a whole half spoils the slices of the other only by the columns in which their tangents are read.
/// `None` for a view that is in the half that the slices are from, and for one that cannot be compared.
pub(crate) fn placed_by_halves(camera: &Camera, views: &[TurnView], counts: &[bool]) -> Vec<Vec<Option<Placed>>> {
    let seen = Seen::new(camera, views, counts);
    let mut by_angle: Vec<usize> = (0..views.len()).filter(|&i| counts[i]).collect();
    by_angle.sort_by(|&a, &b| views[a].omega.total_cmp(&views[b].omega));
    let half = |first: usize| {
        let members: Vec<usize> = by_angle.iter().cycle().skip(first).take(by_angle.len() / 2 + 1).copied().collect();
        let others: Vec<usize> = by_angle.iter().filter(|i| !members.contains(i)).copied().collect();
        let slices = seen.without(&others);
        let placed = |i: usize| others.contains(&i).then(|| placed_among(&seen.pose, &slices, &views[i], Shift::Free)).flatten();
        (0..views.len()).map(placed).collect()
    };
    (0..HALVES).into_par_iter().map(|at| half(at * by_angle.len() / HALVES)).collect()
}

/// Holds the views that fit better at other angles against each other in pairs, as they are and exchanged. `placed` are those of [`placed`].
/// Each of two exchanged views is among the views that the other one is held against there, and so spoils what it is compared with.
pub(crate) fn exchanged(camera: &Camera, views: &[TurnView], counts: &[bool], placed: &[Option<Placed>]) -> Vec<Exchanged> {
    let better_px = |i: usize| placed[i].filter(|p| p.best_px < EXCHANGED_SHARE * p.own_px).map(|p| p.own_px - p.best_px);
    let mut doubtful: Vec<(usize, f64)> = (0..views.len()).filter_map(|i| Some((i, better_px(i)?))).collect();
    doubtful.sort_by(|a, b| b.1.total_cmp(&a.1));
    doubtful.truncate(EXCHANGED_MOST);
    let mut doubtful: Vec<usize> = doubtful.into_iter().map(|(i, _)| i).collect();
    doubtful.sort_unstable();
    let pairs: Vec<[usize; 2]> = doubtful.iter().flat_map(|&b| doubtful.iter().filter(move |&&a| a < b).map(move |&a| [a, b])).collect();
    if pairs.is_empty() {
        return Vec::new();
    }
    let seen = Seen::new(camera, views, counts);
    let of_pair = |pair: [usize; 2]| {
        let slices = seen.without(&pair);
        if slices.len() < SLICES_LEAST {
            return None;
        }
        let at = |view: usize, angle: usize| {
            let view = TurnView { omega: views[angle].omega, ..views[view] };
            residuals_px(&seen.pose, &slices, &view, Shift::Free).map(|residuals| trimmed_rms(residuals.into_iter()))
        };
        let [a, b] = pair;
        let turns = (views[b].omega - views[a].omega) / TAU;
        let apart_rad = TAU * (turns - turns.round());
        Some(Exchanged { views: pair, own_px: [at(a, a)?, at(b, b)?], swapped_px: [at(a, b)?, at(b, a)?], apart_rad })
    };
    pairs.into_par_iter().filter_map(of_pair).collect()
}

/// The place of a view among the slices of others.
fn placed_among(pose: &Pose, slices: &[Outline], view: &TurnView, shift: Shift) -> Option<Placed> {
    if slices.len() < SLICES_LEAST {
        return None;
    }
    let at = |off_rad: f64| residuals_px(pose, slices, &TurnView { omega: view.omega + off_rad, ..*view }, shift);
    let own = at(0.0)?;
    let own_px = trimmed_rms(own.iter().copied());
    let distance_px = |off_rad: f64| at(off_rad).map_or(f64::INFINITY, |residuals| trimmed_rms(residuals.into_iter()));
    let (mut best_px, mut best_rad) = (own_px, 0.0);
    for off_rad in (1..ANGLES).map(|step| TAU * step as f64 / ANGLES as f64) {
        if is_farther(pose, slices, &TurnView { omega: view.omega + off_rad, ..*view }, shift, best_px) {
            continue;
        }
        let found_px = distance_px(off_rad);
        if found_px < best_px {
            (best_px, best_rad) = (found_px, off_rad);
        }
    }
    let half_px = upper_median(own.into_iter().map(f64::abs).collect());
    Some(Placed { own_px, half_px, best_px, off_rad: if best_rad > PI { best_rad - TAU } else { best_rad } })
}

/// Whether some of the slices show already that a view lies farther from all of them than `than_px`, whatever the others show.
fn is_farther(pose: &Pose, slices: &[Outline], view: &TurnView, shift: Shift, than_px: f64) -> bool {
    let mut squares: Vec<f64> = Vec::with_capacity(2 * slices.len().div_ceil(LOOKED_AT));
    for slice in slices.iter().step_by(LOOKED_AT) {
        match (shift, Side::BOTH.map(|side| off_um(pose, slice, view, side))) {
            (Shift::AsGiven, found) => squares.extend(found.into_iter().flatten().map(|off_um| off_um * off_um)),
            // A shift moves both edges the same way: what it leaves of the two is at least this.
            (Shift::Free, [Some(a), Some(b)]) => squares.push((a + b) * (a + b) / 2.0),
            (Shift::Free, _) => {}
        }
    }
    // The largest residuals of all slices are left out, and may all be among these.
    let most = 2 * slices.len();
    let kept = ((1.0 - TRIM) * most as f64).ceil() as usize;
    squares.sort_by(f64::total_cmp);
    squares.truncate(squares.len().saturating_sub(most - kept));
    (squares.iter().sum::<f64>() / kept.max(1) as f64).sqrt() * pose.camera().ky > than_px * (1.0 + 1e-9)
}

/// Distance of an edge of a view from a slice, um.
fn off_um(pose: &Pose, outline: &Outline, view: &TurnView, side: Side) -> Option<f64> {
    let tangent = pose.tangent(outline.x_um, view, side, Some(&outline.support))?;
    Some(tangent.offset_um - outline.support.at(tangent.theta)[0])
}

/// Whether a view may lie higher or lower than the calibration says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shift {
    AsGiven,
    /// The calibration of a turn of which half is wrong is wrong itself.
    Free,
}

/// A slice, and the support function that some of the views give of it.
struct Outline {
    x_um: f64,
    support: Support,
}

/// A tangent of a slice: the series in its direction, and its distance from the axis, um.
struct Row {
    series: [f64; 2 * HARMONICS_MOST + 1],
    offset_um: f64,
}

/// What the views show of a slice.
struct SeenSlice {
    x_um: f64,
    /// The tangents that each view gives.
    rows: Vec<[Option<Row>; 2]>,
    /// Those of the views that count, and their number.
    equations: Equations,
    tangents: usize,
}

/// The slices that are compared, as the views show them.
struct Seen<'a> {
    pose: Pose,
    views: &'a [TurnView<'a>],
    counts: &'a [bool],
    slices: Vec<SeenSlice>,
}

impl<'a> Seen<'a> {
    fn new(camera: &Camera, views: &'a [TurnView<'a>], counts: &'a [bool]) -> Self {
        let pose = Pose::new(camera);
        let extents: Vec<(usize, usize)> = views.iter().filter_map(|v| v.columns.extent()).collect();
        let middle = |of: fn(&(usize, usize)) -> usize| upper_median(extents.iter().map(|e| of(e) as f64).collect());
        let (from, to) = (middle(|e| e.0), middle(|e| e.1));
        let count = ((to - from) as usize).min(SLICES);
        let counted: Vec<TurnView> = views.iter().zip(counts).filter(|(_, counts)| **counts).map(|(view, _)| *view).collect();
        let series = harmonics(&counted.iter().map(|v| v.omega).collect::<Vec<_>>());
        let slice = |i: usize| {
            let x_um = pose.slice(from + (to - from) * (i as f64 + 0.5) / count as f64);
            // The second pass reads the columns in which the tangents touch. A view that does not belong moves these by some tenths of a px at the
            // ends of the picture, where the rays lean, and less in the middle.
            let first = Slice::of(x_um, &pose, &counted, None).and_then(|slice| fit(&slice, series, 1.0, 0)).ok()?;
            let row = |view: &TurnView, side: Side| {
                let tangent = pose.tangent(x_um, view, side, Some(&first.support))?;
                let mut row = Row { series: [0.0; 2 * HARMONICS_MOST + 1], offset_um: tangent.offset_um };
                basis(tangent.theta, &mut row.series);
                Some(row)
            };
            let rows: Vec<[Option<Row>; 2]> = views.iter().map(|view| Side::BOTH.map(|side| row(view, side))).collect();
            let (mut equations, mut tangents) = (Equations::new(HARMONICS_MOST), 0);
            for row in rows.iter().zip(counts).filter(|(_, counts)| **counts).flat_map(|(rows, _)| rows.iter().flatten()) {
                equations.add(&row.series, row.offset_um, 1.0);
                tangents += 1;
            }
            Some(SeenSlice { x_um, rows, equations, tangents })
        };
        let slices = (0..count).into_par_iter().filter_map(slice).collect();
        Self { pose, views, counts, slices }
    }

    /// The slices with the support functions nearest to all views that count, without these.
    fn without(&self, left_out: &[usize]) -> Vec<Outline> {
        let left_out: Vec<usize> = left_out.iter().copied().filter(|&i| self.counts[i]).collect();
        let members = (0..self.views.len()).filter(|i| self.counts[*i] && !left_out.contains(i));
        let omegas: Vec<f64> = members.map(|i| self.views[i].omega).collect();
        let (series, needed) = (harmonics(&omegas), 2.0 * SHARE_OF_VIEWS * omegas.len() as f64);
        let of_slice = |slice: &SeenSlice| {
            let (mut equations, mut tangents) = (slice.equations.clone(), slice.tangents);
            for row in left_out.iter().flat_map(|&i| slice.rows[i].iter().flatten()) {
                equations.add(&row.series, row.offset_um, -1.0);
                tangents -= 1;
            }
            let (support, _) = equations.solved(series).filter(|_| tangents as f64 >= needed)?;
            Some(Outline { x_um: slice.x_um, support })
        };
        self.slices.iter().filter_map(of_slice).collect()
    }
}

/// Distances of the edges of a view from the slices, px. `None` for a view that shows less than half of their edges.
fn residuals_px(pose: &Pose, slices: &[Outline], view: &TurnView, shift: Shift) -> Option<Vec<f64>> {
    let residual = |slice: &Outline, side: Side| Some((side.sign(), off_um(pose, slice, view, side)?));
    let residuals: Vec<(f64, f64)> = slices.iter().flat_map(|slice| Side::BOTH.map(|side| residual(slice, side))).flatten().collect();
    if residuals.len() < slices.len() {
        return None;
    }
    let down_um = match shift {
        Shift::AsGiven => 0.0,
        Shift::Free => upper_median(residuals.iter().map(|(sign, off_um)| sign * off_um).collect()),
    };
    Some(residuals.into_iter().map(|(sign, off_um)| (off_um - sign * down_um) * pose.camera().ky).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::{Columns, Polygon};

    const WIDTH: usize = 200;
    const HEIGHT: usize = 160;

    /// Taking views out of the equations gives the support functions that a fit to the others gives, also where some do not count.
    #[test]
    fn slices_without_some_views_are_those_of_the_others() {
        let camera = Camera::published(WIDTH as u32, HEIGHT as u32);
        let shown = |i: usize| {
            let out = (i % 3) as f64;
            Polygon { vertices: vec![[20.0, 60.0 - out], [180.0, 58.0], [180.0, 100.0 + out], [20.0, 102.0]] }
        };
        let columns: Vec<Columns> = (0..13).map(|i| Columns::from_outlines(&[shown(i)], WIDTH, HEIGHT)).collect();
        let view = |(i, columns)| TurnView { columns, omega: TAU * i as f64 / 13.0, dy_px: 0.0 };
        let views: Vec<TurnView> = columns.iter().enumerate().map(view).collect();
        let counts: Vec<bool> = (0..views.len()).map(|i| i != 5).collect();
        let seen = Seen::new(&camera, &views, &counts);
        let of = |left_out: &[usize]| -> Vec<TurnView> {
            (0..views.len()).filter(|i| counts[*i] && !left_out.contains(i)).map(|i| views[i]).collect()
        };
        let fitted = |x_um: f64, views: &[TurnView], first: Option<&Support>| {
            let series = harmonics(&views.iter().map(|view| view.omega).collect::<Vec<_>>());
            fit(&Slice::of(x_um, &seen.pose, views, first).unwrap(), series, 1.0, 0).unwrap().support
        };
        for left_out in [vec![3], vec![5], vec![0, 1, 2, 3, 4, 6]] {
            let found = seen.without(&left_out);
            assert_eq!(found.len(), SLICES, "{left_out:?}");
            for Outline { x_um, support } in found {
                let expected = fitted(x_um, &of(&left_out), Some(&fitted(x_um, &of(&[]), None)));
                assert_eq!(support.coefficients.len(), expected.coefficients.len(), "{left_out:?}");
                let off = support.coefficients.iter().zip(&expected.coefficients).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off < 1e-9, "without {left_out:?} at {x_um} um: off by {off} um");
            }
        }
    }
}
