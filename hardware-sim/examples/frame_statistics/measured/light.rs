//! The light of one colour without body and dust, and the noise around it.

use super::body::Body;
use super::walls::Walls;
use super::{Plane, quantile};
use rayon::prelude::*;

/// Half the length of the piece of a row whose median is the light of its middle.
const HALF: usize = 24;
/// Columns between two medians. In between the light is interpolated.
const STEP: usize = 4;
/// Distance from a wall line from which on the line does not matter.
const OFF_WALL_PX: f64 = 14.0;

#[derive(Debug, Clone)]
pub struct Light {
    /// Loss of light of each pixel against its light: positive is darker. 0 where the light is not known.
    pub lost: Vec<f32>,
    /// The light of each pixel.
    pub level: Vec<f32>,
    pub bore_level: f64,
    pub outside_level: f64,
    pub noise_sd: f64,
    /// Correlation of the noise of horizontal neighbours.
    pub noise_correlation: f64,
    /// Loss at 6 and 10 px from a wall line, against 14 to 20 px.
    pub shade: [f64; 2],
}

impl Light {
    pub fn of(plane: &Plane, walls: &Walls, body: &Body) -> Self {
        let width = plane.width;
        let mut level = vec![0.0f32; plane.data.len()];
        level.par_chunks_mut(width).enumerate().for_each(|(v, row)| {
            // Along the walls, so that a tilted wall does not change the level within a piece.
            let along = |u: usize, middle: usize| {
                let at = v as f64 + walls.slope * (u as f64 - middle as f64);
                let w = at.round();
                (w >= 0.0 && w < plane.height as f64).then_some(w as usize)
            };
            let median = |middle: usize| {
                let piece: Vec<f64> = (middle.saturating_sub(HALF)..(middle + HALF + 1).min(width))
                    .filter_map(|u| along(u, middle).map(|w| (u, w)))
                    .filter(|&(u, w)| !body.wide[w * width + u])
                    .map(|(u, w)| plane.at(u, w))
                    .collect();
                (piece.len() > HALF / 2).then(|| mid_mean(&piece))
            };
            let knots: Vec<Option<f64>> = (0..width).step_by(STEP).map(median).collect();
            for (u, pixel) in row.iter_mut().enumerate() {
                let (i, t) = (u / STEP, (u % STEP) as f64 / STEP as f64);
                let value = match (knots[i], knots.get(i + 1).copied().flatten()) {
                    (Some(a), Some(b)) => a + (b - a) * t,
                    (Some(a), None) | (None, Some(a)) => a,
                    (None, None) => f64::NAN,
                };
                *pixel = value as f32;
            }
        });
        let lost: Vec<f32> = plane
            .data
            .iter()
            .zip(&level)
            .zip(&body.wide)
            .map(|((&is, &light), &covered)| if covered || !light.is_finite() { 0.0 } else { 1.0 - is / light.max(1.0) })
            .collect();
        let far = |inside: bool, least: f64| -> Vec<f64> {
            let of = |i: usize| {
                let from_wall = walls.inside_px(i % width, i / width);
                let counts = if inside { from_wall > least } else { from_wall < -least };
                (counts && !body.wide[i]).then(|| f64::from(plane.data[i]))
            };
            (0..plane.data.len()).filter_map(of).collect()
        };
        let bore_level = quantile(&far(true, OFF_WALL_PX), 0.5);
        let outside_level = quantile(&far(false, OFF_WALL_PX + 4.0), 0.5);
        // Noise in the bore and outside, in levels.
        let noise: Vec<Option<f64>> = (0..plane.data.len())
            .map(|i| {
                let away = walls.inside_px(i % width, i / width).abs() > OFF_WALL_PX;
                (away && !body.wide[i] && level[i].is_finite()).then(|| f64::from(plane.data[i] - level[i]))
            })
            .collect();
        let noise_sd = robust_sd(&noise.iter().flatten().copied());
        let noise_correlation = correlation(&noise, width, 3.0 * noise_sd);
        let shade = shade(plane, walls, body);
        Self { lost, level, bore_level, outside_level, noise_sd, noise_correlation, shade }
    }
}

/// Mean of the middle half: less rough than a median of whole levels.
fn mid_mean(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = &sorted[sorted.len() / 4..(3 * sorted.len()).div_ceil(4)];
    middle.iter().sum::<f64>() / middle.len().max(1) as f64
}

/// Standard deviation within three standard deviations, so that specks do not count.
fn robust_sd(values: &(impl Iterator<Item = f64> + Clone)) -> f64 {
    let sd = |most: f64| {
        let (n, sum) = values.clone().filter(|v| v.abs() <= most).fold((0usize, 0.0), |(n, sum), v| (n + 1, sum + v * v));
        (sum / n.max(1) as f64).sqrt()
    };
    (0..6).fold(sd(12.0), |found, _| sd(3.0 * found.max(0.2)))
}

fn correlation(noise: &[Option<f64>], width: usize, most: f64) -> f64 {
    let (mut both, mut square, mut n) = (0.0, 0.0, 0usize);
    for row in noise.chunks(width) {
        for pair in row.windows(2) {
            if let [Some(a), Some(b)] = pair
                && a.abs() <= most
                && b.abs() <= most
            {
                both += a * b;
                square += f64::midpoint(a * a, b * b);
                n += 1;
            }
        }
    }
    if n == 0 || square <= 0.0 { 0.0 } else { both / square }
}

/// Loss of light in the bore beside the walls.
fn shade(plane: &Plane, walls: &Walls, body: &Body) -> [f64; 2] {
    let level = |side: usize, from_px: f64, to_px: f64| {
        let mut levels = Vec::new();
        for u in (0..plane.width).step_by(3) {
            let inward = if side == 0 { 1.0 } else { -1.0 };
            let mut at = from_px;
            while at <= to_px {
                let v = walls.row(side, u as f64) + inward * at;
                let covered =
                    v < 0.0 || v as usize >= plane.height || body.wide[(v.round() as usize).min(plane.height - 1) * plane.width + u];
                if let Some(level) = plane.between(u as f64, v).filter(|_| !covered) {
                    levels.push(level);
                }
                at += 1.0;
            }
        }
        quantile(&levels, 0.5)
    };
    [6.0, 10.0].map(|px| {
        let losses = [0, 1].map(|side| 1.0 - level(side, px, px) / level(side, 14.0, 20.0));
        f64::midpoint(losses[0], losses[1])
    })
}
