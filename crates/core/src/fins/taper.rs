//! The low ends of fins.
//!
//! ```text
//!   height over the body   ____----     A fold rises slowly from the body. Where it stands out by less than the body's blur, no view
//!        ..... taper  ----'             shows its border: its last slope is continued down to the body.
//! ```

use super::faint::p;
use super::{Fin, Standing, centre};

/// Largest height of an end that is low, px.
const LOW_PX: f64 = 10.0;
/// Length over which the slope at an end is taken, px.
const SLOPE_PX: usize = 80;
/// Least and largest slope, px per px. The fin folds of larvae rise by 1/25 to 1/40.
const SLOPE_LEAST: f64 = 1.0 / 10.0;
const SLOPE_MOST: f64 = 1.0 / 5.0;

/// Continues a fin from its low ends down to the body.
pub(super) fn taper(fin: &mut Fin, others: &[Fin], slices: &[Standing], px_um: f64) {
    if (fin.points_um.len() as f64) < p("TAPERLEN", 150.0) {
        return;
    }
    for right in [false, true] {
        if !is_front(fin, right, slices) {
            continue;
        }
        // Another fin that goes on from here shows itself where this one goes.
        let end = if right { fin.points_um.last() } else { fin.points_um.first() };
        let beside = |other: &Fin| {
            let (Some(end), Some(first), Some(last)) = (end, other.points_um.first(), other.points_um.last()) else { return false };
            let ahead = if right { last[0] > end[0] + 20.0 * px_um && first[0] < end[0] + 100.0 * px_um } else { first[0] < end[0] - 20.0 * px_um && last[0] > end[0] - 100.0 * px_um };
            let near = other.points_um.iter().min_by(|a, b| (a[0] - end[0]).abs().total_cmp(&(b[0] - end[0]).abs()));
            ahead && near.is_some_and(|q| {
                let Some(slice) = slices.iter().min_by(|a, b| (a.x_um - end[0]).abs().total_cmp(&(b.x_um - end[0]).abs())) else { return false };
                let (_, a) = from_centre(slice, end);
                let (_, b) = from_centre(slice, q);
                (a - b).cos() > 0.8
            })
        };
        if others.iter().any(beside) {
            continue;
        }
        let Some(added) = beyond(fin, right, slices, px_um) else { continue };
        if right {
            fin.points_um.extend(added);
        } else {
            fin.points_um.splice(0..0, added.into_iter().rev());
        }
    }
}

/// Whether the end of a fin is the one where the body is thicker.
fn is_front(fin: &Fin, right: bool, slices: &[Standing]) -> bool {
    let radius = |point: Option<&[f64; 3]>| {
        let at = slices.partition_point(|slice| slice.x_um < point.map_or(0.0, |p| p[0]) - 1e-6);
        slices.get(at).map_or(0.0, |slice| slice.body.coefficients[0])
    };
    let (left_um, right_um) = (radius(fin.points_um.first()), radius(fin.points_um.last()));
    (right_um > left_um) == right
}

/// The points beyond one end, from the end on.
fn beyond(fin: &Fin, right: bool, slices: &[Standing], px_um: f64) -> Option<Vec<[f64; 3]>> {
    let end = *if right { fin.points_um.last()? } else { fin.points_um.first()? };
    let at = slices.iter().position(|slice| (slice.x_um - end[0]).abs() < 1e-6)?;
    let height = |slice: &Standing, point: &[f64; 3]| {
        let ([y, z], theta) = from_centre(slice, point);
        y.hypot(z) / px_um - reach_px(slice, theta, px_um)
    };
    let last = height(slices.get(at)?, &end);
    if !(0.0..p("TAPERLOW", LOW_PX)).contains(&last) {
        return None;
    }
    // Heights inwards from the end, by least squares.
    let inner = |k: usize| -> Option<f64> {
        let (slice, point) = if right {
            (slices.get(at.checked_sub(k)?)?, fin.points_um.get(fin.points_um.len().checked_sub(k + 1)?)?)
        } else {
            (slices.get(at + k)?, fin.points_um.get(k)?)
        };
        Some(height(slice, point))
    };
    let heights: Vec<f64> = (0..SLOPE_PX).map_while(inner).collect();
    if heights.len() < SLOPE_PX / 2 {
        return None;
    }
    let n = heights.len() as f64;
    let (mean, middle) = (heights.iter().sum::<f64>() / n, (n - 1.0) / 2.0);
    let (xy, xx) = heights.iter().enumerate().fold((0.0, 0.0), |(xy, xx), (k, h)| {
        let dx = k as f64 - middle;
        (xy + dx * (h - mean), xx + dx * dx)
    });
    let slope = (xy / xx).clamp(p("TAPERLEAST", SLOPE_LEAST), SLOPE_MOST);
    let (_, theta) = from_centre(&slices[at], &end);
    let mut added = Vec::new();
    for k in 1.. {
        let height = last - slope * k as f64;
        let next = if right { at.checked_add(k) } else { at.checked_sub(k) };
        let Some(slice) = next.and_then(|at| slices.get(at)).filter(|_| height > 0.0) else { break };
        let [y, z] = centre(&slice.body);
        let reach = (reach_px(slice, theta, px_um) + height) * px_um;
        added.push([slice.x_um, y + reach * theta.cos(), z + reach * theta.sin()]);
    }
    Some(added)
}

/// A point as the body's centre sees it, and its direction.
fn from_centre(slice: &Standing, point: &[f64; 3]) -> ([f64; 2], f64) {
    let [y, z] = centre(&slice.body);
    let offset = [point[1] - y, point[2] - z];
    (offset, offset[1].atan2(offset[0]))
}

/// Distance of the body's edge from its centre, px.
fn reach_px(slice: &Standing, theta: f64, px_um: f64) -> f64 {
    let [y, z] = centre(&slice.body);
    (slice.body.at(theta)[0] - y * theta.cos() - z * theta.sin()) / px_um
}
