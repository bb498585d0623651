//! Specks of dust in the bore: small dark spots beside the body.

use super::body::{Body, grown, pieces};
use super::light::Light;
use super::walls::Walls;

/// Standard deviation of the Gaussian with which the noise is smoothed. Widths and depths are corrected for it.
const SMOOTH_PX: f64 = 0.8;
/// Full width at half maximum over standard deviation.
const FWHM: f64 = 2.354_82;
/// Distance from the wall lines within which no specks are counted.
const OFF_WALL_PX: f64 = 9.0;
/// Shallowest speck, as a part of the light.
const SHALLOWEST: f64 = 0.02;
/// A speck is deeper than this many standard deviations of the smoothed noise.
const SIGNIFICANT: f64 = 4.0;
/// Larger spots are not dust.
const LARGEST_PX: usize = 220;
const NEAR_BODY_PX: usize = 25;

#[derive(Debug, Clone)]
pub struct Specks {
    /// Depth and full width at half maximum of each speck.
    all: Vec<[f64; 2]>,
    pub near_body: usize,
    /// The searched area, in areas of the bore over 1000 px of length.
    searched: f64,
}

impl Specks {
    pub fn per_1000px(&self, counts: impl Fn(f64) -> bool) -> f64 {
        self.all.iter().filter(|[depth, _]| counts(*depth)).count() as f64 / self.searched.max(1e-9)
    }

    pub fn depths(&self) -> Option<Vec<f64>> {
        (!self.all.is_empty()).then(|| self.all.iter().map(|s| s[0]).collect())
    }

    pub fn widths(&self) -> Option<Vec<f64>> {
        (!self.all.is_empty()).then(|| self.all.iter().map(|s| s[1]).collect())
    }
}

pub fn found(light: &Light, walls: &Walls, body: &Body) -> Specks {
    let width = light_width(light, body);
    let searched: Vec<bool> = (0..light.lost.len())
        .map(|i| !body.wide[i] && light.level[i].is_finite() && walls.inside_px(i % width, i / width) > OFF_WALL_PX)
        .collect();
    let smooth = smoothed(&light.lost, width);
    let noise = smoothed_noise(&smooth, &searched);
    let least = SIGNIFICANT * noise;
    let near: Vec<bool> = if body.is_empty() { vec![false; searched.len()] } else { grown(&body.wide, width, NEAR_BODY_PX) };
    let mut specks =
        Specks { all: Vec::new(), near_body: 0, searched: searched.iter().filter(|&&is| is).count() as f64 / (1000.0 * walls.bore_px()) };
    let candidates: Vec<bool> = smooth.iter().zip(&searched).map(|(&lost, &is)| is && f64::from(lost) > least).collect();
    for piece in pieces(&candidates, width) {
        for peak in piece.iter().copied().filter(|&i| is_peak(&smooth, width, i)) {
            let dip = f64::from(smooth[peak]);
            let half = half_area(&smooth, width, peak, dip / 2.0);
            if half.len() > LARGEST_PX || half.iter().any(|&i| !searched[i]) {
                continue;
            }
            let seen_px = 2.0 * (half.len() as f64 / std::f64::consts::PI).sqrt();
            let own = (seen_px * seen_px - (FWHM * SMOOTH_PX).powi(2)).max(1.0);
            let depth = dip * seen_px * seen_px / own.max(0.4 * seen_px * seen_px);
            // The deepest point of its own half-depth area.
            if depth >= SHALLOWEST && half.iter().all(|&i| smooth[i] <= smooth[peak]) {
                specks.all.push([depth, own.sqrt()]);
                specks.near_body += usize::from(near[peak]);
            }
        }
    }
    specks
}

fn light_width(light: &Light, body: &Body) -> usize {
    light.lost.len() / body.rows().max(1)
}

fn is_peak(smooth: &[f32], width: usize, i: usize) -> bool {
    let (u, v, height) = (i % width, i / width, smooth.len() / width);
    u > 0
        && v > 0
        && u + 1 < width
        && v + 1 < height
        && (v - 1..=v + 1)
            .all(|w| (u - 1..=u + 1).all(|x| smooth[w * width + x] < smooth[i] || w * width + x >= i && smooth[w * width + x] <= smooth[i]))
}

/// The connected pixels around a peak that are deeper than half of it.
fn half_area(smooth: &[f32], width: usize, peak: usize, half: f64) -> Vec<usize> {
    let mut area = vec![peak];
    let mut next = 0;
    while let Some(&i) = area.get(next) {
        next += 1;
        if area.len() > LARGEST_PX {
            break;
        }
        let u = i % width;
        let near = [
            (u > 0, i.wrapping_sub(1)),
            (u + 1 < width, i + 1),
            (i >= width, i.wrapping_sub(width)),
            (i + width < smooth.len(), i + width),
        ];
        for (is, j) in near {
            if is && f64::from(smooth[j]) > half && !area.contains(&j) {
                area.push(j);
            }
        }
    }
    area
}

fn smoothed(plane: &[f32], width: usize) -> Vec<f32> {
    const REACH: i64 = 3;
    let weights: Vec<f64> = (-REACH..=REACH).map(|d| (-0.5 * (d as f64 / SMOOTH_PX).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let height = plane.len() / width;
    let pass = |from: &[f32], step_u: i64, step_v: i64| -> Vec<f32> {
        (0..from.len())
            .map(|i| {
                let (u, v) = ((i % width) as i64, (i / width) as i64);
                let value: f64 = (-REACH..=REACH)
                    .zip(&weights)
                    .map(|(d, weight)| {
                        let (x, y) = ((u + d * step_u).clamp(0, width as i64 - 1), (v + d * step_v).clamp(0, height as i64 - 1));
                        weight * f64::from(from[y as usize * width + x as usize])
                    })
                    .sum();
                (value / sum) as f32
            })
            .collect()
    };
    pass(&pass(plane, 1, 0), 0, 1)
}

/// Standard deviation of the brighter half, which has no dust.
fn smoothed_noise(smooth: &[f32], searched: &[bool]) -> f64 {
    let bright: Vec<f64> =
        smooth.iter().zip(searched).filter(|&(&lost, &is)| is && lost < 0.0).map(|(&lost, _)| f64::from(lost * lost)).collect();
    (bright.iter().sum::<f64>() / bright.len().max(1) as f64).sqrt()
}
