//! Detection of views that do not belong to the turn, and of a specimen that moved.
//!
//! ```text
//!   residuals of a view against the fit of all others, slice by slice ── over the slices ── rms, and what they look like:
//!       down the image: dy     along the capillary: dx (edge slope)     turned: domega (h')
//!   one view out of line: left out     all views from some view on: the specimen moved
//! ```

use super::least_squares::Solution;
use crate::parallel::prelude::*;
use crate::profile::Columns;
use crate::statistics::{fit, fit_robust, mad_sd, upper_median};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// The difference of one view from the model of all others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewOff {
    /// Distances between its edges and those of the model, px: root of the mean square without the largest 5 %.
    pub rms_px: f64,
    /// Share of its edges that are far from the model of all others: a leak through a narrow gap.
    pub far_share: f64,
    /// Offset down the image, px. It includes the view's shift in the solution.
    pub dy_px: f64,
    /// Offset along the capillary, px.
    pub dx_px: f64,
    /// Turn about the capillary against the ledger's angle, rad.
    pub turn: f64,
    /// Offset down the image, px, if this view alone caused everything that is odd in the views' shifts; and the scatter of the
    /// shifts without it.
    pub jump_px: [f64; 2],
}

/// Share of the largest residuals that is ignored: a few wrong px of a long profile do not make a view wrong.
pub(super) const TRIM: f64 = 0.05;

/// The difference of each view from the model of all others. `turned` is the ledger's angle of each view from the pivot, rad.
pub fn views_off(solution: &Solution, turned: &[f64]) -> Vec<ViewOff> {
    let (camera, slices) = (&solution.camera, &solution.slices);
    (0..solution.dy_px.len())
        .into_par_iter()
        .map(|view| {
            let mut rows: Vec<(Vector3<f64>, f64)> = Vec::new();
            for (slice, fit) in slices {
                for (at, off_um) in fit.leave_one_out(slice, view) {
                    let sight = &slice.sights[at];
                    let sign = sight.side.sign();
                    let [_, slope_um] = fit.support.at(sight.tangent.theta);
                    rows.push((row(sign, sight.tangent.edge_slope, slope_um * camera.ky), off_um * camera.ky));
                }
            }
            let found = off(&rows);
            let turn = found.turn + (solution.rho - 1.0) * turned[view];
            ViewOff { dy_px: solution.dy_px[view] + found.dy_px, turn, jump_px: jump(solution, view), ..found }
        })
        .collect()
}

/// Derivatives of an edge's distance with respect to a shift down (px), a shift to the right (px) and a turn (rad). `slope_px`
/// is the slope of the support function, px per rad.
pub(super) fn row(sign: f64, edge_slope: f64, slope_px: f64) -> Vector3<f64> {
    Vector3::new(sign, -sign * edge_slope, -slope_px)
}

/// The shift of one view that explains most of all shifts. The part that the slices took up is missing from the shifts, so that
/// a view that jumped by 7 px shows as some px in every view.
fn jump(solution: &Solution, view: usize) -> [f64; 2] {
    let n = solution.dy_px.len();
    let mut shape = DVector::zeros(n);
    shape[view] = 1.0;
    for direction in &solution.gauge {
        shape.axpy(-direction[view], direction, 1.0);
    }
    let observable = shape.norm_squared();
    let shifts = DVector::from_column_slice(&solution.dy_px);
    let free = n as f64 - solution.gauge.len() as f64 - 1.0;
    if observable < 0.05 || free < 1.0 {
        return [0.0, f64::INFINITY];
    }
    let size = shape.dot(&shifts) / observable;
    let left = (shifts.norm_squared() - size * size * observable).max(0.0);
    [size, (left / free).sqrt()]
}

/// Root of the mean square without the largest residuals. 0 where there are none.
pub(super) fn trimmed_rms(residuals: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = residuals.map(|r| r * r).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.truncate(((1.0 - TRIM) * sizes.len() as f64).ceil() as usize);
    (sizes.iter().sum::<f64>() / sizes.len().max(1) as f64).sqrt()
}

/// Fits the distances of edges from a model. A row has the derivatives by shift down, shift along and turn.
fn off(rows: &[(Vector3<f64>, f64)]) -> ViewOff {
    let rms_px = trimmed_rms(rows.iter().map(|(_, r)| *r));
    let far = (FAR * rms_px).max(FAR_LEAST_PX);
    let far_share = rows.iter().filter(|(_, r)| r.abs() > far).count() as f64 / rows.len().max(1) as f64;
    // Expected offsets of a view: 1 px, 3 px and 3 deg. They hold the shift along the capillary where the profiles have no
    // slope.
    let held = Matrix3::from_diagonal(&Vector3::new(1.0, 3.0, 0.05).map(|sd: f64| 1.0 / (sd * sd)));
    let fit = fit_robust(rows, held, 3, 0.05).unwrap_or_default();
    ViewOff { rms_px, far_share, dy_px: fit[0], dx_px: fit[1], turn: fit[2], jump_px: [0.0; 2] }
}

/// An edge is far from the model if its distance exceeds this many residuals of the view, and so many px.
const FAR: f64 = 6.0;
const FAR_LEAST_PX: f64 = 4.0;
/// Largest share of far edges of a good view: tips, and a fin that was lost over a stretch.
const FAR_MOST: f64 = 0.08;

/// Why a view is left out of the turn.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Bad {
    /// The view shows nothing.
    #[error("blank: no pixel of it is inside")]
    Blank,
    /// Its edges are far from the model of the other views.
    #[error(
        "its profile differs from the model of the other views by {found:.1} px (usual: {usual:.1} px): it leaks, or shows something else"
    )]
    Residual {
        /// Its residual, px.
        found: f64,
        /// Median residual of the views, px.
        usual: f64,
    },
    /// Many of its edges are far from the model of the other views.
    #[error("{:.0} % of its edges are far from the other views' model: it leaks, or a part is missing", 100.0 * share)]
    Far {
        /// Share of these edges.
        share: f64,
    },
    /// It lies elsewhere in the image.
    #[error("it lies {found:.1} px off in the image where views of this turn scatter by {usual:.1} px: it jumped")]
    Jumped {
        /// Its offset, px.
        found: f64,
        /// Standard deviation of the offsets, px.
        usual: f64,
    },
    /// A part of the specimen is missing along the capillary.
    #[error("{:.0} % of the columns in which the other views show the specimen are empty in it: a part is missing", 100.0 * share)]
    Short {
        /// Share of the columns of the other views that are empty in it.
        share: f64,
    },
    /// The area of its profile does not fit the turn.
    #[error("its profile covers {found:.2} times what the other views' turn makes expected: it leaks, or a part is missing")]
    Area {
        /// Its area over the expected one.
        found: f64,
    },
}

/// A view within these offsets, px, is no outlier: segmentation and a mounted capillary scatter by as much.
const RESIDUAL_LEAST_PX: f64 = 1.5;
const JUMP_LEAST_PX: f64 = 2.5;

/// The view with the largest excess over its limit. `None` where no view exceeds one.
pub fn worst(offs: &[ViewOff]) -> Option<(usize, Bad)> {
    let usual = upper_median(offs.iter().map(|o| o.rms_px).collect());
    let spread = |of: &dyn Fn(&ViewOff) -> f64| {
        let middle = upper_median(offs.iter().map(of).collect());
        let sd = mad_sd(&offs.iter().map(|o| of(o) - middle).collect::<Vec<_>>());
        (middle, sd)
    };
    let (dx, dx_sd) = spread(&|o| o.dx_px);
    let judged = offs.iter().enumerate().flat_map(|(view, o)| {
        // The fewer the other views, the less they determine the one that is left out.
        let most = (5.0 * usual).max(RESIDUAL_LEAST_PX) * (1.0 + 7.0 / offs.len() as f64);
        let jump = |off: f64, sd: f64| (off.abs() / (6.0 * sd).max(JUMP_LEAST_PX), Bad::Jumped { found: off.abs(), usual: sd });
        let far = o.far_share / FAR_MOST / (1.0 + 7.0 / offs.len() as f64);
        [
            (o.rms_px / most, Bad::Residual { found: o.rms_px, usual }),
            (far, Bad::Far { share: o.far_share }),
            jump(o.jump_px[0], o.jump_px[1]),
            jump(o.dx_px - dx, dx_sd),
        ]
        .map(|(excess, bad)| (excess, view, bad))
    });
    let (excess, view, bad) = judged.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (excess > 1.0).then_some((view, bad))
}

/// Largest relative difference of a profile's area from what the turn of the others makes expected. A larva's own variation has
/// the period of half a turn.
const AREA_OFF: f64 = 0.25;

/// Views whose area does not fit the turn, before anything is solved: a profile that leaks to the wall would bend the model of
/// few views.
pub fn wrong_areas(views: &[(f64, f64)]) -> Vec<(usize, Bad)> {
    let mut weights = vec![1.0; views.len()];
    let wave = |omega: f64| Vector3::new(1.0, (2.0 * omega).cos(), (2.0 * omega).sin());
    let middle = upper_median(views.iter().map(|v| v.1).collect());
    if views.len() < 6 || middle <= 0.0 {
        return Vec::new();
    }
    let mut off: Vec<f64> = views.iter().map(|(_, area)| area / middle - 1.0).collect();
    for _ in 0..8 {
        let sd = mad_sd(&off).max(0.02);
        for (weight, o) in weights.iter_mut().zip(&off) {
            // Redescending weights: a profile of twice the area has none.
            let far = (o / (4.0 * sd)).abs();
            *weight = if far < 1.0 { (1.0 - far * far).powi(2) } else { 0.0 };
        }
        // A prior holds the variation to 0 unless the views show one.
        let held = Matrix3::from_diagonal(&Vector3::new(1e-9, 0.5, 0.5));
        let rows = views.iter().zip(&weights).map(|((omega, area), weight)| (wave(*omega), area / middle, *weight));
        let Some(fit) = fit(rows, held) else { return Vec::new() };
        off = views.iter().map(|(omega, area)| area / middle - wave(*omega).dot(&fit)).collect();
    }
    off.iter().enumerate().filter(|(_, o)| o.abs() > AREA_OFF).map(|(view, o)| (view, Bad::Area { found: 1.0 + o })).collect()
}

/// Largest share of the usual view's columns that may be empty in a good view: the thin end of a tail.
const SHORT_MOST: f64 = 0.1;

/// Views in which a part of the specimen is missing along the capillary. Where nothing is shown there is no edge whose distance
/// could be judged.
pub fn short(views: &[&Columns]) -> Vec<(usize, Bad)> {
    let extents: Vec<(usize, usize)> = views.iter().filter_map(|v| v.extent()).collect();
    if extents.len() < 6 {
        return Vec::new();
    }
    let usual = |of: fn(&(usize, usize)) -> usize| upper_median(extents.iter().map(|e| of(e) as f64).collect()) as usize;
    let (from, to) = (usual(|e| e.0), usual(|e| e.1));
    let length = (to.max(from) - from + 1) as f64;
    let share = |view: &Columns| (from..=to).filter(|&u| view.get(u).is_none()).count() as f64 / length;
    let shares = views.iter().map(|view| share(view)).enumerate();
    shares.filter(|(_, share)| *share > SHORT_MOST).map(|(view, share)| (view, Bad::Short { share })).collect()
}

/// A step in the specimen's pose from one view on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Moved {
    /// Number of the first view after the step.
    pub view: usize,
    /// Shift along the capillary, px.
    pub along_px: f64,
    /// Shift across the capillary, px.
    pub across_px: f64,
    /// Turn about the capillary, rad.
    pub turn_rad: f64,
}

/// Least views on either side of a step. Fewer are bad views.
const SIDE: usize = 3;
/// Smaller steps are not distinguished from the scatter of profiles: 5 um along and across, 1.7 degrees.
const MOVED_PX: f64 = 1.0;
const TURNED: f64 = 0.03;
/// Least size of a step in its own standard deviations. The best of some tens of places is searched, so this is large.
const SURE: f64 = 5.0;
/// The same of a turn, which also has to explain the edges.
const SURE_TURNED: f64 = 3.0;

/// Least share of the views on the shorter side that show the step. One outlier among few views shifts their mean, but most of
/// them then fit worse with the step than without.
const SHOWN: f64 = 0.75;
/// Least views on either side of a step across: it is a wave with three unknowns, which any three views fit.
const SIDE_ACROSS: usize = 2 * SIDE;

/// Searches for the view from which on the specimen lies elsewhere. A turn is a candidate only: whoever asks has to see whether it explains the
/// edges. The turn of a round specimen is not observable: then `shows_turn` is false.
pub fn moved(offs: &[ViewOff], omegas: &[f64], shows_turn: bool) -> Option<Moved> {
    let n = offs.len();
    if n < 2 * SIDE + 2 {
        return None;
    }
    let best = (SIDE..=n - SIDE).map(|at| {
        let later = |i: usize| f64::from(u8::from(i >= at));
        let along = step(offs, at, |o| o.dx_px, |_| vec![1.0], |i| vec![later(i)]);
        // Another number of steps per revolution turns the views by more and more, not from one view to the next.
        let turn = if shows_turn { step(offs, at, |o| o.turn, |i| vec![1.0, omegas[i]], |i| vec![later(i)]) } else { (0.0, 0.0) };
        // A body that lies elsewhere across moves with cos and sin of omega. With few views most of that goes into the shapes
        // of the slices.
        let wave = |i: usize| vec![1.0, omegas[i].cos(), omegas[i].sin()];
        let across = if n < ACROSS_LEAST || at.min(n - at) < SIDE_ACROSS {
            (0.0, 0.0)
        } else {
            step(offs, at, |o| o.dy_px, wave, |i| wave(i).into_iter().map(|w| w * later(i)).collect())
        };
        let score = [(along.0 / MOVED_PX, along.1 / SURE), (turn.0 / TURNED, turn.1 / SURE_TURNED), (across.0 / MOVED_PX, across.1 / SURE)]
            .into_iter()
            .filter(|(size, sure)| size.abs() > 1.0 && *sure > 1.0)
            .map(|(_, sure)| sure)
            .fold(0.0, f64::max);
        (score, Moved { view: at, along_px: along.0, across_px: across.0, turn_rad: turn.0 })
    });
    best.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(score, _)| *score > 0.0).map(|(_, moved)| moved)
}

/// Least views with which shifts show whether a body moved across.
const ACROSS_LEAST: usize = 20;

/// How much the rows of the views from `at` on add to the explanation of a value of each view: size of the step, and its
/// significance as the root of F. Both are 0 where most views of the shorter side do not show the step.
fn step(
    offs: &[ViewOff],
    at: usize,
    of: impl Fn(&ViewOff) -> f64,
    always: impl Fn(usize) -> Vec<f64>,
    later: impl Fn(usize) -> Vec<f64>,
) -> (f64, f64) {
    let n = offs.len();
    let fit = |rows: &dyn Fn(usize) -> Vec<f64>| -> Option<(DVector<f64>, DVector<f64>)> {
        let width = rows(0).len();
        let matrix = DMatrix::from_fn(n, width, |i, j| rows(i)[j]);
        let right = DVector::from_fn(n, |i, _| of(&offs[i]));
        let normal = matrix.transpose() * &matrix + DMatrix::identity(width, width) * 1e-6;
        let solved = normal.cholesky()?.solve(&(matrix.transpose() * &right));
        let left = right - matrix * &solved;
        Some((solved, left))
    };
    let more = later(0).len();
    let both = |i: usize| always(i).into_iter().chain(later(i)).collect::<Vec<_>>();
    let (Some((_, without)), Some((found, with))) = (fit(&always), fit(&both)) else { return (0.0, 0.0) };
    let side = if n - at <= at { at..n } else { 0..at };
    let shown = side.clone().filter(|&i| with[i].abs() < without[i].abs()).count();
    if (shown as f64) < SHOWN * side.len() as f64 {
        return (0.0, 0.0);
    }
    let (without, with) = (without.norm_squared(), with.norm_squared());
    let added = found.rows(found.len() - more, more);
    // Of a wave, the larger of shift and amplitude; of one number, the number with its sign.
    let size = if more == 1 { added[0] } else { added[0].abs().max(added[1].hypot(added[2])) };
    let free = (n as f64 - found.len() as f64).max(1.0);
    (size, ((without - with).max(0.0) / more as f64 / (with / free).max(1e-9)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bar from column `from` to 90 of 100.
    fn bar(from: usize) -> Columns {
        let coverage: Vec<u8> =
            (0..20 * 100).map(|i| if (from..=90).contains(&(i % 100)) && (5..15).contains(&(i / 100)) { 255 } else { 0 }).collect();
        Columns::from_coverage(100, 20, &coverage)
    }

    #[test]
    fn views_that_lack_a_part_are_named_and_a_thin_end_is_not() {
        let bars: Vec<Columns> = [10, 10, 26, 10, 27, 14, 10, 10].map(bar).into();
        let found = short(&bars.iter().collect::<Vec<_>>());
        assert_eq!(found.iter().map(|(view, _)| *view).collect::<Vec<_>>(), [2, 4]);
        assert_eq!(found[0].1, Bad::Short { share: 16.0 / 81.0 });
    }
}
