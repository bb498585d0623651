//! The body of the specimen, from a mask or from the pixels, and its statistics.

use super::light::Light;
use super::walls::Walls;
use super::{BodyStatistics, Plane, quantile};

/// A body is darker than this part of the light, and fins are lighter.
const BODY: f64 = 0.88;
/// The body is looked for this far from the wall lines.
const OFF_WALL_PX: f64 = 5.0;
/// Smallest body, px.
const SMALLEST: usize = 600;
/// Border around the body that belongs neither to it nor to the background. It is wider without a mask, because fins are then not known.
const BORDER_PX: usize = 4;
const UNKNOWN_FINS_PX: usize = 14;
/// Half the side of the square whose mean is subtracted for the texture.
const TEXTURE: usize = 4;

#[derive(Debug, Clone)]
pub struct Body {
    width: usize,
    /// The body without fins.
    pub set: Vec<bool>,
    /// Body, fins and their border: what is not background.
    pub wide: Vec<bool>,
    /// The mask that was given, with fins.
    mask: Option<Vec<bool>>,
}

impl Body {
    pub fn found(plane: &Plane, walls: &Walls, mask: Option<&[bool]>) -> Self {
        let width = plane.width;
        // The light of a column is that beside the body, and the body may fill the column.
        let mut levels = Vec::new();
        for i in (0..plane.data.len()).step_by(3) {
            if walls.inside_px(i % width, i / width) > OFF_WALL_PX + 9.0 {
                levels.push(f64::from(plane.data[i]));
            }
        }
        let light = quantile(&levels, 0.9);
        let smooth = smoothed(plane);
        let dark: Vec<bool> = (0..plane.data.len())
            .map(|i| {
                let may_be = match mask {
                    Some(mask) => mask[i],
                    None => walls.inside_px(i % width, i / width) > OFF_WALL_PX,
                };
                may_be && f64::from(smooth[i]) < BODY * light
            })
            .collect();
        let mut set = largest(&dark, width);
        if set.iter().filter(|&&is| is).count() < SMALLEST {
            set.fill(false);
        }
        fill_holes(&mut set, width);
        let with_fins: Vec<bool> = match mask {
            Some(mask) => mask.iter().zip(&set).map(|(a, b)| *a || *b).collect(),
            None => set.clone(),
        };
        let wide = grown(&with_fins, width, if mask.is_some() { BORDER_PX } else { UNKNOWN_FINS_PX });
        Self { width, set, wide, mask: mask.map(<[bool]>::to_vec) }
    }

    pub fn rows(&self) -> usize {
        self.set.len() / self.width
    }

    pub fn is_empty(&self) -> bool {
        !self.set.iter().any(|&is| is)
    }

    pub fn statistics(&self, plane: &Plane, light: &Light, walls: &Walls) -> Option<BodyStatistics> {
        if self.is_empty() {
            return None;
        }
        let beside = light.bore_level;
        let inside = || (0..self.set.len()).filter(|&i| self.set[i]);
        let parts: Vec<f64> = inside().map(|i| f64::from(plane.data[i]) / beside).collect();
        let core = shrunk(&self.set, self.width, TEXTURE + 1);
        let texture: Vec<f64> =
            (0..core.len()).filter(|&i| core[i]).map(|i| plane.at(i % self.width, i / self.width) - mean_around(plane, i)).collect();
        let mut gap_px = [f64::INFINITY; 2];
        for i in inside() {
            let (u, v) = (i % self.width, (i / self.width) as f64);
            gap_px[0] = gap_px[0].min(v - 0.5 - walls.row(0, u as f64));
            gap_px[1] = gap_px[1].min(walls.row(1, u as f64) - v - 0.5);
        }
        let fins = self.mask.as_ref().map(|mask| {
            let border = grown(&self.set, self.width, 2);
            let fins: Vec<usize> = (0..mask.len()).filter(|&i| mask[i] && !self.set[i]).collect();
            let lost = |i: usize| {
                let light = Some(f64::from(light.level[i])).filter(|level| level.is_finite()).unwrap_or(beside);
                1.0 - f64::from(plane.data[i]) / light
            };
            let darkness: Vec<f64> = fins.iter().filter(|&&i| !border[i]).map(|&i| lost(i)).collect();
            let mean = darkness.iter().sum::<f64>() / darkness.len().max(1) as f64;
            [fins.len() as f64 / parts.len() as f64, mean]
        });
        Some(BodyStatistics {
            median: quantile(&parts, 0.5),
            dark_share: parts.iter().filter(|&&part| part < 0.25).count() as f64 / parts.len() as f64,
            texture_sd: (texture.iter().map(|t| t * t).sum::<f64>() / texture.len().max(1) as f64).sqrt(),
            gap_px,
            fins,
        })
    }
}

/// Mean of 3 x 3 px.
fn smoothed(plane: &Plane) -> Vec<f32> {
    let (width, height) = (plane.width, plane.height);
    let mut out = plane.data.clone();
    for v in 1..height - 1 {
        for u in 1..width - 1 {
            let sum: f32 = (v - 1..=v + 1).map(|w| plane.data[w * width + u - 1..=w * width + u + 1].iter().sum::<f32>()).sum();
            out[v * width + u] = sum / 9.0;
        }
    }
    out
}

fn mean_around(plane: &Plane, i: usize) -> f64 {
    let (u, v) = (i % plane.width, i / plane.width);
    let rows = v.saturating_sub(TEXTURE)..(v + TEXTURE + 1).min(plane.height);
    let columns = u.saturating_sub(TEXTURE)..(u + TEXTURE + 1).min(plane.width);
    let n = (rows.len() * columns.len()) as f64;
    rows.map(|w| plane.data[w * plane.width + columns.start..w * plane.width + columns.end].iter().map(|&p| f64::from(p)).sum::<f64>())
        .sum::<f64>()
        / n
}

/// Connected pieces of `set`, each as the list of its pixels. Neighbours share a side.
pub fn pieces(set: &[bool], width: usize) -> Vec<Vec<usize>> {
    let mut seen = vec![false; set.len()];
    let mut pieces = Vec::new();
    for first in 0..set.len() {
        if !set[first] || seen[first] {
            continue;
        }
        let (mut piece, mut next) = (vec![first], 0);
        seen[first] = true;
        while let Some(&i) = piece.get(next) {
            next += 1;
            let u = i % width;
            let near = [
                (u > 0, i.wrapping_sub(1)),
                (u + 1 < width, i + 1),
                (i >= width, i.wrapping_sub(width)),
                (i + width < set.len(), i + width),
            ];
            for (is, j) in near {
                if is && set[j] && !seen[j] {
                    seen[j] = true;
                    piece.push(j);
                }
            }
        }
        pieces.push(piece);
    }
    pieces
}

fn largest(set: &[bool], width: usize) -> Vec<bool> {
    let mut out = vec![false; set.len()];
    for i in pieces(set, width).into_iter().max_by_key(Vec::len).unwrap_or_default() {
        out[i] = true;
    }
    out
}

/// Adds what the set encloses.
fn fill_holes(set: &mut [bool], width: usize) {
    let outside: Vec<bool> = set.iter().map(|&is| !is).collect();
    let height = set.len() / width;
    for piece in pieces(&outside, width) {
        let at_border = |&i: &usize| i % width == 0 || i % width == width - 1 || i / width == 0 || i / width == height - 1;
        if !piece.iter().any(at_border) {
            for i in piece {
                set[i] = true;
            }
        }
    }
}

/// The pixels within `by` rows and columns of the set.
pub fn grown(set: &[bool], width: usize, by: usize) -> Vec<bool> {
    let height = set.len() / width;
    let mut along = vec![false; set.len()];
    for (i, _) in set.iter().enumerate().filter(|&(_, &is)| is) {
        let (u, row) = (i % width, i / width * width);
        along[row + u.saturating_sub(by)..row + (u + by + 1).min(width)].fill(true);
    }
    let mut out = vec![false; set.len()];
    for (i, _) in along.iter().enumerate().filter(|&(_, &is)| is) {
        let (u, v) = (i % width, i / width);
        for w in v.saturating_sub(by)..(v + by + 1).min(height) {
            out[w * width + u] = true;
        }
    }
    out
}

fn shrunk(set: &[bool], width: usize, by: usize) -> Vec<bool> {
    let outside: Vec<bool> = set.iter().map(|&is| !is).collect();
    grown(&outside, width, by).into_iter().map(|is| !is).collect()
}
