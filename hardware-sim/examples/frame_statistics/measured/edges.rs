//! How sharp the image is: the shortest rise of a strong edge of the body.

use super::{Plane, body::Body, quantile};

/// Length of the line across an edge, to each side, and its steps per px.
const REACH_PX: f64 = 9.0;
const STEPS: f64 = 4.0;
/// Least contrast of an edge, as a part of the light.
const CONTRAST: f64 = 0.35;
/// Beyond both ends of an edge the level changes by less than this part of the contrast within two px.
const FLAT: f64 = 0.08;
/// Of all strong edges this part is sharper than the result.
const SHARPEST: f64 = 0.1;
/// Fewer edges give no result.
const FEWEST: usize = 12;

/// Distance over which the sharpest edges in and around the body rise from 10 to 90 % of their contrast.
pub fn sharpest_px(plane: &Plane, body: &Body, light: f64) -> Option<f64> {
    let (width, height) = (plane.width, plane.height);
    let mut widths = Vec::new();
    for v in 2..height - 2 {
        for u in 2..width - 2 {
            if !body.wide[v * width + u] {
                continue;
            }
            let gradient = [plane.at(u + 1, v) - plane.at(u - 1, v), plane.at(u, v + 1) - plane.at(u, v - 1)];
            let size = gradient[0].hypot(gradient[1]);
            // The middle of an edge of 5 px has a tenth of its contrast per px.
            if size / 2.0 < 0.1 * CONTRAST * light {
                continue;
            }
            let towards = gradient.map(|g| g / size);
            let level = |at: f64| plane.between(u as f64 + at * towards[0], v as f64 + at * towards[1]);
            widths.extend(rise(&level, CONTRAST * light));
        }
    }
    (widths.len() >= FEWEST).then(|| quantile(&widths, SHARPEST))
}

/// The 10 to 90 % distance of the edge at 0, if it is a single strong edge between two even levels.
fn rise(level: &impl Fn(f64) -> Option<f64>, least: f64) -> Option<f64> {
    let steps = (REACH_PX * STEPS) as i32;
    let line: Vec<f64> = (-steps..=steps).map(|i| level(f64::from(i) / STEPS)).collect::<Option<_>>()?;
    let middle = steps as usize;
    // Follow the rise to both ends.
    let half_px = (STEPS / 2.0) as usize;
    let mut low = middle;
    while low >= half_px && line[low - half_px] < line[low] - 0.5 {
        low -= half_px;
    }
    let mut high = middle;
    while high + half_px < line.len() && line[high + half_px] > line[high] + 0.5 {
        high += half_px;
    }
    let contrast = line[high] - line[low];
    let beyond = (2.0 * STEPS) as usize;
    let even = |from: usize, to: Option<&f64>| to.is_some_and(|to| (to - line[from]).abs() < FLAT * contrast);
    if contrast < least || !even(low, low.checked_sub(beyond).and_then(|i| line.get(i))) || !even(high, line.get(high + beyond)) {
        return None;
    }
    let crossing = |part: f64| {
        let level = line[low] + part * contrast;
        let i = (low..high).find(|&i| line[i] <= level && line[i + 1] > level)?;
        Some((i as f64 + (level - line[i]) / (line[i + 1] - line[i])) / STEPS)
    };
    Some(crossing(0.9)? - crossing(0.1)?)
}
