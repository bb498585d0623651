//! The low front ends of fins.
//!
//! ```text
//!   height over the body   ____----     A fold rises slowly from the body. Where it stands out by less than the body's blur, no view
//!        ..... taper  ----'             shows its border: its last slope is continued down to the body.
//! ```

use super::{Fin, FinSlice, centre};

/// Largest height of an end that is low, px.
const LOW_PX: f64 = 10.0;
/// Length over which the slope at an end is taken, px.
const SLOPE_PX: usize = 80;
/// Least and largest slope, px per px. A fold that is seen down to 5 px goes on for 30 to 100 px in emulated larvae; by the least
/// slope it is not made longer than it is.
const SLOPE_LEAST: f64 = 1.0 / 10.0;
const SLOPE_MOST: f64 = 1.0 / 5.0;
/// Shortest fin that is a fold, px.
const LONG_PX: usize = 150;
/// How far another fin must reach beyond an end, and how far from it it may begin, px.
const AHEAD_PX: (f64, f64) = (20.0, 100.0);
/// Cosine of the angle within which two fins have the same direction.
const SAME_DIRECTION: f64 = 0.8;

/// A fin, continued from its low front end down to the body. Where another of the `fins` goes on, that one shows where it goes.
pub(super) fn tapered(fins: &[Fin], which: usize, slices: &[FinSlice], px_um: f64) -> Fin {
    let fin = fins[which].clone();
    if fin.points_um.len() < LONG_PX {
        return fin;
    }
    let right = is_right_front(&fin, slices);
    let goes_on = |(k, other): (usize, &Fin)| k != which && is_ahead(&fin, other, right, slices, px_um);
    if fins.iter().enumerate().any(goes_on) {
        return fin;
    }
    let Some(added) = beyond(&fin, right, slices, px_um) else { return fin };
    let points_um = if right { [fin.points_um, added].concat() } else { added.into_iter().rev().chain(fin.points_um).collect() };
    Fin { points_um, edges: fin.edges }
}

/// Whether another fin continues where a fin ends: ahead of the end, near it, and in its direction.
fn is_ahead(fin: &Fin, other: &Fin, right: bool, slices: &[FinSlice], px_um: f64) -> bool {
    let end = if right { fin.points_um.last() } else { fin.points_um.first() };
    let (Some(end), Some(first), Some(last)) = (end, other.points_um.first(), other.points_um.last()) else { return false };
    let (far, near) = if right { (last[0] - end[0], first[0] - end[0]) } else { (end[0] - first[0], end[0] - last[0]) };
    if far < AHEAD_PX.0 * px_um || near > AHEAD_PX.1 * px_um {
        return false;
    }
    let Some(slice) = slices.get(slices.partition_point(|slice| slice.x_um < end[0] - 1e-6)) else { return false };
    let beside = other.points_um.iter().min_by(|a, b| (a[0] - end[0]).abs().total_cmp(&(b[0] - end[0]).abs()));
    beside.is_some_and(|point| (from_centre(slice, point).1 - from_centre(slice, end).1).cos() > SAME_DIRECTION)
}

/// Whether the right end of a fin is the one where the body is thicker.
fn is_right_front(fin: &Fin, slices: &[FinSlice]) -> bool {
    let radius = |point: Option<&[f64; 3]>| {
        let at = slices.partition_point(|slice| slice.x_um < point.map_or(0.0, |p| p[0]) - 1e-6);
        slices.get(at).map_or(0.0, |slice| slice.body.coefficients[0])
    };
    radius(fin.points_um.last()) > radius(fin.points_um.first())
}

/// The points beyond one end, from the end on.
fn beyond(fin: &Fin, right: bool, slices: &[FinSlice], px_um: f64) -> Option<Vec<[f64; 3]>> {
    let end = *if right { fin.points_um.last()? } else { fin.points_um.first()? };
    let at = slices.iter().position(|slice| (slice.x_um - end[0]).abs() < 1e-6)?;
    let height = |slice: &FinSlice, point: &[f64; 3]| {
        let ([y, z], theta) = from_centre(slice, point);
        y.hypot(z) / px_um - reach_px(slice, theta, px_um)
    };
    let last = height(slices.get(at)?, &end);
    if !(0.0..LOW_PX).contains(&last) {
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
    let slope = (xy / xx).clamp(SLOPE_LEAST, SLOPE_MOST);
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
fn from_centre(slice: &FinSlice, point: &[f64; 3]) -> ([f64; 2], f64) {
    let [y, z] = centre(&slice.body);
    let offset = [point[1] - y, point[2] - z];
    (offset, offset[1].atan2(offset[0]))
}

/// Distance of the body's edge from its centre, px.
fn reach_px(slice: &FinSlice, theta: f64, px_um: f64) -> f64 {
    let [y, z] = centre(&slice.body);
    (slice.body.at(theta)[0] - y * theta.cos() - z * theta.sin()) / px_um
}

#[cfg(test)]
mod tests {
    use super::super::body::Known;
    use super::*;
    use crate::calibration::Support;

    /// A body that is thicker on the left, and a fold that falls from 14 px to 4 px towards there, at 1/16.
    #[test]
    fn a_low_front_end_goes_on_down_to_the_body_and_a_rear_end_does_not() {
        let body = |u: usize| Support { coefficients: vec![60.0 - 0.1 * u as f64, 0.0, 0.0] };
        let slices: Vec<FinSlice> =
            (0..400).map(|u| FinSlice { x_um: u as f64, known: Known::Body, body: body(u), points_um: Vec::new() }).collect();
        let height = |p: &[f64; 3]| p[1] - slices[p[0] as usize].body.coefficients[0];
        let points_um = (200..360).map(|u| [u as f64, slices[u].body.coefficients[0] + 4.0 + (u - 200) as f64 / 16.0, 0.0]).collect();
        let fins = [Fin { points_um, edges: 9 }];
        let fin = tapered(&fins, 0, &slices, 1.0);
        let (first, last) = (fin.points_um[0], fin.points_um[fin.points_um.len() - 1]);
        // 4 px at the least slope are 40 columns.
        assert!((158.0..=162.0).contains(&first[0]) && height(&first).abs() < 0.5, "{first:?}");
        assert_eq!(last[0] as usize, 359);
        let steps: Vec<f64> = fin.points_um.windows(2).map(|p| p[1][0] - p[0][0]).collect();
        assert!(steps.iter().all(|step| (step - 1.0).abs() < 1e-9));
        // Another fin that goes on from there shows where it goes.
        let other = Fin { points_um: (150..195).map(|u| [f64::from(u), 60.0, 0.0]).collect(), edges: 9 };
        assert_eq!(tapered(&[fins[0].clone(), other], 0, &slices, 1.0), fins[0]);
    }
}
