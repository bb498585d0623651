//! Two outlines of one turn, compared column by column.

use crate::profile::Columns;
use crate::statistics::{lower_quantile, upper_median};

/// How the second picture is held against the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mirror {
    /// As it is.
    None,
    /// Left and right exchanged.
    LeftRight,
    /// Turned by half a turn in its plane: left and right, and top and bottom, exchanged.
    HalfTurn,
}

/// Every such column is compared.
const STEP: usize = 3;
/// Least columns that an outline must have.
const COLUMNS_LEAST: usize = 24;
/// Distance that a column counts for which only one of the outlines has, px.
const ABSENT_PX: f64 = 30.0;
/// Share of the columns of which the distance is at most the given one. Fins that one segmentation finds and another misses are in fewer columns
/// than the rest.
pub(super) const SHARE: f64 = 0.75;

/// Distance between two outlines, px: in this share of the columns the edges lie within it. `down_px` is how far the capillary lies lower in
/// the second picture. `None` where one shows too little.
pub(super) fn distance_px(a: &Columns, b: &Columns, down_px: f64, share: f64) -> Option<f64> {
    let ((from, to), (other_from, other_to)) = (shown(a)?, shown(b)?);
    let columns = (from.min(other_from)..=to.max(other_to)).step_by(STEP);
    let distances = columns.map(|u| match (a.get(u), b.get(u)) {
        (Some(a), Some(b)) => (a.upper - b.upper + down_px).abs().max((a.lower - b.lower + down_px).abs()),
        (None, None) => 0.0,
        _ => ABSENT_PX,
    });
    lower_quantile(distances.collect(), share).or(Some(0.0))
}

/// Distance between the shapes of two outlines, px: the outlines are first moved onto each other, their ends along the capillary and their
/// middles across it.
pub(super) fn shape_distance_px(a: &Columns, b: &Columns, mirror: Mirror) -> Option<f64> {
    let ((from, to), (other_from, other_to)) = (shown(a)?, shown(b)?);
    let other = |u: usize| match mirror {
        Mirror::None => (u + other_from).checked_sub(from),
        Mirror::LeftRight | Mirror::HalfTurn => (from + other_to).checked_sub(u),
    };
    let sign = if mirror == Mirror::HalfTurn { -1.0 } else { 1.0 };
    let end = to.max(from + other_to - other_from);
    let pairs: Vec<_> = (from..=end).step_by(STEP).map(|u| (a.get(u), other(u).and_then(|u| b.get(u)))).collect();
    let middle = |e: crate::profile::ColumnEdges| f64::midpoint(e.upper, e.lower);
    let apart = upper_median(pairs.iter().filter_map(|(a, b)| Some(middle((*a)?) - sign * middle((*b)?))).collect());
    let distances = pairs.iter().map(|pair| match pair {
        (Some(a), Some(b)) => {
            let [upper, lower] = if sign > 0.0 { [b.upper, b.lower] } else { [-b.lower, -b.upper] };
            (a.upper - upper - apart).abs().max((a.lower - lower - apart).abs())
        }
        (None, None) => 0.0,
        _ => ABSENT_PX,
    });
    lower_quantile(distances.collect(), SHARE).or(Some(0.0))
}

fn shown(columns: &Columns) -> Option<(usize, usize)> {
    columns.extent().filter(|(from, to)| to - from >= COLUMNS_LEAST)
}
