//! The box to carve if none is given: the region that the bounding rectangles of all silhouettes have in common, seen through their
//! matrices.
//!
//! ```text
//!   rectangle of a view ── four planes through its projection centre ── half-spaces
//!   cube about the point that all views look at ── cut into eighths, again and again ── those outside any half-space are dropped
//!        ── until the cells are small against what is left: its extents are the box
//! ```
//! For psi, whose angles describe a turn, the box encloses a body of revolution: calibration may move the axis, and then the specimen with
//! it. Every cell that may contain a part of the specimen is kept, so the box is never too small. A margin keeps the hull away from its
//! ends.

use super::{Psi, View};
use carved_core::geometry::{BoxUm, Projection};
use nalgebra::{Matrix3, Vector3};

/// Largest edge of a cell, as a share of the box's shortest side.
const FINE: f64 = 1.0 / 64.0;
/// Margin, as a share of the box's sides and in addition in voxels: a hull that reaches the outermost voxels looks as if it continued
/// outside.
const MARGIN: f64 = 1.0 / 32.0;
const MARGIN_VOXELS: f64 = 2.0;
/// Maximum number of subdivisions of the first cube. A specimen smaller than a millionth of its distance is not supported.
const CUTS_MOST: usize = 26;
/// Maximum number of cells in one round.
const CELLS_MOST: usize = 4_000_000;

/// Why no box could be derived from the silhouettes.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum NoBox {
    /// The rays through the silhouettes meet in no point.
    #[error(
        "no box was given, and the views do not tell where the specimen is: they look along one direction, or show nothing. Give a box"
    )]
    Nowhere,
    /// The rectangles around the silhouettes exclude each other.
    #[error(
        "no box was given, and no point is within the rectangles around all silhouettes: check that views and matrices are in the same order, \
         or give a box"
    )]
    Apart,
    /// The region has no end on a side.
    #[error("no box was given, and the views leave the specimen open on a side: they look from too few directions. Give a box")]
    Open,
    /// The region is too small for the cells.
    #[error(
        "no box was given, and none could be derived from the silhouettes: their rectangles have next to nothing in common. Give a box"
    )]
    Tiny,
}

/// The points with `normal x + offset >= 0`.
struct HalfSpace {
    normal: Vector3<f64>,
    offset: f64,
}

/// The pixels that a silhouette covers, px: left, right, top, bottom.
fn rectangle(view: &View) -> Option<[f64; 4]> {
    let (from, to) = view.columns.extent()?;
    let edges = || (from..=to).filter_map(|u| view.columns.get(u));
    let (top, bottom) = edges().fold((f64::INFINITY, f64::NEG_INFINITY), |(top, bottom), e| (top.min(e.upper), bottom.max(e.lower)));
    Some([from as f64 - 0.5, to as f64 + 0.5, top, bottom])
}

/// A camera matrix and the rectangle around its silhouette.
type Seen = (Projection, [f64; 4]);

/// The rectangles of these views, none of which is blank.
fn rectangles(projections: &[Projection], views: &[View]) -> Vec<Seen> {
    projections.iter().zip(views).filter_map(|(projection, view)| Some((*projection, rectangle(view)?))).collect()
}

/// The rectangles of a body of revolution around the row `uy` that covers every silhouette of a turn.
///
/// Let the true axis be `d` rows off. Where a slice reaches from `uy + d - a` to `uy + d + b`, the view from the other side shows
/// `uy + d - b` to `uy + d + a`. The body of revolution reaches `|d| + max(a, b)` to either side: it holds the slice about either axis.
fn revolved(psi: &Psi, views: &[View]) -> Vec<Seen> {
    let camera = &psi.camera;
    let all: Vec<[f64; 4]> = views.iter().filter_map(rectangle).collect();
    let left = all.iter().map(|r| r[0]).fold(f64::INFINITY, f64::min);
    let right = all.iter().map(|r| r[1]).fold(f64::NEG_INFINITY, f64::max);
    let half = all.iter().map(|r| (r[3] - camera.uy).max(camera.uy - r[2])).fold(0.0, f64::max);
    let rectangle = [left, right, camera.uy - half, camera.uy + half];
    let seen = psi.omega.iter().map(|omega| (camera.projection(*omega), rectangle));
    if all.is_empty() { Vec::new() } else { seen.collect() }
}

/// The box around everything that a turn of psi's camera shows, with a margin for voxels of edge `voxel` (0 if the edge is derived from the
/// box).
pub(super) fn of_turn(psi: &Psi, views: &[View], voxel: f64) -> Result<BoxUm, NoBox> {
    let seen = revolved(psi, views);
    let middle = nearest(&seen)?;
    around(&seen, middle, voxel)
}

/// The box around everything that the matrices show, like [`of_turn`]. The specimen is in front of each camera, near `middle`.
pub(super) fn derived(projections: &[Projection], views: &[View], middle: [f64; 3], voxel: f64) -> Result<BoxUm, NoBox> {
    around(&rectangles(projections, views), middle, voxel)
}

/// The plane through the projection centre in which `row x = at depth`, as a half-space whose side is not set yet.
fn plane(projection: &Projection, row: usize, at: f64) -> HalfSpace {
    let rows = projection.rows();
    let [a, b, c, d]: [f64; 4] = std::array::from_fn(|i| rows[row][i] - at * rows[2][i]);
    let length = Vector3::new(a, b, c).norm();
    HalfSpace { normal: Vector3::new(a, b, c) / length, offset: d / length }
}

/// The point nearest to all rays through the middles of the rectangles. It may be in front of the cameras or behind them.
pub(super) fn middle(projections: &[Projection], views: &[View]) -> Result<[f64; 3], NoBox> {
    nearest(&rectangles(projections, views))
}

fn nearest(seen: &[Seen]) -> Result<[f64; 3], NoBox> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (projection, [left, to, top, bottom]) in seen {
        for (row, at) in [(0, f64::midpoint(*left, *to)), (1, f64::midpoint(*top, *bottom))] {
            let HalfSpace { normal: n, offset } = plane(projection, row, at);
            normal += n * n.transpose();
            right -= offset * n;
        }
    }
    let found = normal.cholesky().ok_or(NoBox::Nowhere)?;
    Ok(found.solve(&right).into())
}

fn around(seen: &[Seen], middle: [f64; 3], voxel: f64) -> Result<BoxUm, NoBox> {
    let mut sides = Vec::new();
    let mut reach = 0.0_f64;
    for (projection, [left, right, top, bottom]) in seen {
        for (row, at, sign) in [(0, *left, 1.0), (0, *right, -1.0), (1, *top, 1.0), (1, *bottom, -1.0)] {
            let HalfSpace { normal, offset } = plane(projection, row, at);
            sides.push(HalfSpace { normal: sign * normal, offset: sign * offset });
        }
        reach = reach.max(projection.depth(middle));
    }
    if !(reach.is_finite() && reach > 0.0) {
        return Err(NoBox::Nowhere);
    }
    let mut half = reach;
    let mut cells = vec![Vector3::from(middle)];
    for _ in 0..CUTS_MOST {
        half /= 2.0;
        let eighths =
            cells.iter().flat_map(|cell| (0..8).map(move |i| cell + Vector3::from_fn(|a, _| if i >> a & 1 == 0 { -half } else { half })));
        // The corner that is furthest along the normal decides.
        let may_hold = |cell: &Vector3<f64>| sides.iter().all(|s| s.normal.dot(cell) + s.offset + half * s.normal.abs().sum() >= 0.0);
        cells = eighths.filter(may_hold).collect();
        if cells.is_empty() {
            return Err(NoBox::Apart);
        }
        let end = |a: usize, side: fn(f64, f64) -> f64, sign: f64| cells.iter().map(|c| c[a]).reduce(side).map_or(0.0, |x| x + sign * half);
        let bounds = BoxUm { min: [0, 1, 2].map(|a| end(a, f64::min, -1.0)), max: [0, 1, 2].map(|a| end(a, f64::max, 1.0)) };
        let shortest = (0..3).map(|a| bounds.max[a] - bounds.min[a]).fold(f64::INFINITY, f64::min);
        if 2.0 * half <= FINE * shortest {
            let open = (0..3).any(|a| bounds.min[a] <= middle[a] - 0.999 * reach || bounds.max[a] >= middle[a] + 0.999 * reach);
            if open {
                return Err(NoBox::Open);
            }
            let margin = [0, 1, 2].map(|a| MARGIN * (bounds.max[a] - bounds.min[a]) + MARGIN_VOXELS * voxel);
            return Ok(BoxUm { min: [0, 1, 2].map(|a| bounds.min[a] - margin[a]), max: [0, 1, 2].map(|a| bounds.max[a] + margin[a]) });
        }
        if cells.len() > CELLS_MOST {
            break;
        }
    }
    Err(NoBox::Tiny)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::profile::{Columns, Mask};

    /// A camera 100 units away, turned about y, that sees 20 px per unit; the world moved by `shift`.
    fn turned(angle: f64, shift: [f64; 3]) -> Projection {
        let (s, c) = angle.sin_cos();
        let m = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]];
        let t: [f64; 3] = std::array::from_fn(|i| f64::from(u8::from(i == 2)) * 100.0 - (0..3).map(|j| m[i][j] * shift[j]).sum::<f64>());
        let row = |k: f64, at: f64, i: usize| -> [f64; 4] {
            let of = |j: usize| if j < 3 { m[i][j] } else { t[i] };
            let depth = |j: usize| if j < 3 { m[2][j] } else { t[2] };
            std::array::from_fn(|j| k * of(j) + at * depth(j))
        };
        Projection::from_matrix([row(2000.0, 50.0, 0), row(2000.0, 40.0, 1), row(1.0, 0.0, 2)]).unwrap()
    }

    /// A block of `half` px around the principal point.
    fn block(half: [usize; 2]) -> View {
        let mut mask = Mask::empty(101, 81);
        for (u, v) in (50 - half[0]..=50 + half[0]).flat_map(|u| (40 - half[1]..=40 + half[1]).map(move |v| (u, v))) {
            mask.set(u, v, true);
        }
        View { name: "block.png".into(), columns: Columns::from_mask(&mask), mask }
    }

    #[test]
    fn the_box_is_around_what_all_rectangles_have_in_common() {
        let shift = [7.0, -3.0, 11.0];
        let quarter = std::f64::consts::FRAC_PI_2;
        let projections: Vec<Projection> = (0..4).map(|i| turned(quarter * f64::from(i), shift)).collect();
        // 21 px wide and 11 px high, half a px beyond the outermost centres: 1.05 and 0.55 units, and 1 % more for the nearer side.
        let views: Vec<View> = (0..4).map(|_| block([10, 5])).collect();
        let middle = middle(&projections, &views).unwrap();
        assert!((0..3).all(|a| (middle[a] - shift[a]).abs() < 1e-9), "{middle:?}");
        let found = derived(&projections, &views, middle, 0.0).unwrap();
        for (a, half) in [0.525, 0.275, 0.525].into_iter().enumerate() {
            for reach in [shift[a] - found.min[a], found.max[a] - shift[a]] {
                // 2/64 for a cell and 2/32 for the margin, relative to half the side.
                assert!((half..1.12 * half).contains(&reach), "axis {a}: {reach} of {half}");
            }
        }
        let along = derived(&projections[..1], &views[..1], shift, 0.0).unwrap_err();
        assert!(matches!(along, NoBox::Open | NoBox::Tiny), "{along}");
        assert!(super::middle(&projections[..1], &views[..1]).is_err());
        let apart = [projections[0], turned(quarter, [7.0, 20.0, 11.0])];
        assert_eq!(derived(&apart, &views[..2], shift, 0.0), Err(NoBox::Apart));
    }
}
