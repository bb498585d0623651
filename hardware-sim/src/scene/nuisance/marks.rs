//! Scratches and dust: thin dark lines and soft dark dots, on a fixed window or on the glass, which turns.
//!
//! ```text
//!   ----------------------  outside of the capillary
//!      \_    *     __/         marks of the near and of the far side are visible
//!   ----------------------
//! ```

use crate::scene::camera::Camera;
use crate::scene::capillary::Capillary;
use crate::scene::seeded::{Seeded, mixed};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Number and darkness of the marks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Marks {
    pub scratches: u32,
    pub dust: u32,
    /// Darkness of the darkest mark, 0 to 1. The faintest have a quarter of it.
    pub contrast: f64,
}

impl Default for Marks {
    fn default() -> Self {
        Self { scratches: 0, dust: 0, contrast: 0.4 }
    }
}

/// A mark in the image: a bent line, or one point.
pub(super) struct Mark {
    pub points_px: Vec<[f64; 2]>,
    /// Distance at which it ends.
    pub radius_px: f64,
    pub depth: f64,
}

/// A mark on a surface, in coordinates along it.
struct Drawn {
    points: Vec<[f64; 2]>,
    radius: f64,
    depth: f64,
}

impl Marks {
    pub fn none(&self) -> bool {
        self.scratches == 0 && self.dust == 0
    }

    /// Marks on a rectangle from (0, 0) to `size`. `unit` is about a pixel in its coordinates. Most scratches run along the first
    /// coordinate.
    fn drawn(&self, size: [f64; 2], unit: f64, seed: u64) -> Vec<Drawn> {
        let mut s = Seeded::new(mixed(seed));
        let mut marks = Vec::new();
        for i in 0..self.scratches + self.dust {
            let start = [s.between(0.0, size[0]), s.between(0.0, size[1])];
            let depth = self.contrast * s.between(0.25, 1.0);
            if i < self.scratches {
                let (length, bend) = (unit * s.between(30.0, 260.0), s.between(-0.3, 0.3));
                let towards = s.normal(0.35);
                let points = (0..=12)
                    .map(|k| {
                        let t = f64::from(k) / 12.0;
                        let (sin, cos) = (towards + bend * (t - 0.5)).sin_cos();
                        [start[0] + length * t * cos, start[1] + length * t * sin]
                    })
                    .collect();
                marks.push(Drawn { points, radius: unit * s.between(1.2, 2.4), depth });
            } else {
                marks.push(Drawn { points: vec![start], radius: unit * s.between(2.0, 7.0), depth });
            }
        }
        marks
    }

    pub fn shade_fixed(&self, light: &mut [[f32; 3]], camera: &Camera, seed: u64) {
        for mark in self.drawn([f64::from(camera.width), f64::from(camera.height)], 1.0, seed ^ 0x31D0) {
            shade(&Mark { points_px: mark.points, radius_px: mark.radius, depth: mark.depth }, light, camera.width as usize);
        }
    }

    /// Marks on the outside of the glass over the length that the camera sees.
    pub fn shade_turning(&self, light: &mut [[f32; 3]], camera: &Camera, capillary: &Capillary, angle_rad: f64, seed: u64) {
        let view = camera.view(angle_rad);
        let radius_um = capillary.bore_radius_um() + capillary.glass_um;
        let um_per_px = 1.0 / camera.kx_px_per_um;
        let first_um = -camera.ux_px * um_per_px;
        let size = [f64::from(camera.width) * um_per_px, TAU * radius_um];
        for mark in self.drawn(size, um_per_px, seed ^ 0x61A5) {
            let seen = |[x, along]: [f64; 2]| {
                let (sin, cos) = (along / radius_um).sin_cos();
                let p = view.project([first_um + x, radius_um * cos, radius_um * sin]);
                [p.u_px, p.v_px]
            };
            let points_px = mark.points.into_iter().map(seen).collect();
            shade(&Mark { points_px, radius_px: mark.radius / um_per_px, depth: mark.depth }, light, camera.width as usize);
        }
    }
}

pub(super) fn shade(mark: &Mark, light: &mut [[f32; 3]], width: usize) {
    let height = light.len() / width.max(1);
    let span = |axis: usize, size: usize| {
        let low = mark.points_px.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - mark.radius_px;
        let high = mark.points_px.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max) + mark.radius_px;
        low.ceil().max(0.0) as usize..(high.floor() + 1.0).clamp(0.0, size as f64) as usize
    };
    for v in span(1, height) {
        for u in span(0, width) {
            let off = distance([u as f64, v as f64], &mark.points_px) / mark.radius_px;
            if off < 1.0 {
                let left = (1.0 - mark.depth * (1.0 - off * off).powi(2)) as f32;
                let pixel = &mut light[v * width + u];
                *pixel = pixel.map(|p| p * left);
            }
        }
    }
}

/// Distance of a point from a line through `points`.
fn distance(from: [f64; 2], points: &[[f64; 2]]) -> f64 {
    let to = |p: [f64; 2]| (from[0] - p[0]).hypot(from[1] - p[1]);
    let to_piece = |a: [f64; 2], b: [f64; 2]| {
        let d = [b[0] - a[0], b[1] - a[1]];
        let t = ((from[0] - a[0]) * d[0] + (from[1] - a[1]) * d[1]) / (d[0] * d[0] + d[1] * d[1]).max(1e-12);
        let t = t.clamp(0.0, 1.0);
        to([a[0] + t * d[0], a[1] + t * d[1]])
    };
    match points {
        [one] => to(*one),
        _ => points.windows(2).map(|w| to_piece(w[0], w[1])).fold(f64::INFINITY, f64::min),
    }
}
