//! What the unit tests look at: white noise, level bores, discs.

use super::bore::Bore;
use super::bore::walls::{Line, Wall, Walls};
use super::raster::plane::Plane;

/// White noise of standard deviation 1, the same for the same seed.
pub(super) struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 33) as f64 / f64::from(1u32 << 31)
        };
        // Twelve uniform numbers make a normal one.
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// A bore between two level walls that fills its picture.
pub(super) fn bore(width: usize, height: usize) -> Bore {
    let line = |v_mid: f64| Line { u_mid: (width - 1) as f64 / 2.0, v_mid, slope: 0.0, bend: 0.0 };
    let wall = |v: f64| Wall { outer: line(v), inner: line(v) };
    let walls = Walls { upper: wall(0.0), lower: wall((height - 1) as f64) };
    Bore { walls, width, top: 0, bottom: height, lit: 0..height, mean_px: (height - 1) as f64 }
}

/// Share of a blurred half plane's height at a depth, by the error function of Abramowitz and Stegun 7.1.26.
pub(super) fn blurred_step(depth: f64, blur: f64) -> f64 {
    let x = depth / blur / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let tail = ((((1.061_405_429 * t - 1.453_152_027) * t + 1.421_413_741) * t - 0.284_496_736) * t + 0.254_829_592) * t;
    0.5 * (1.0 + x.signum() * (1.0 - tail * (-x * x).exp()))
}

/// A plane of what `of` says at each pixel.
pub(super) fn plane(width: usize, height: usize, mut of: impl FnMut(f64, f64) -> f64) -> Plane {
    let data = (0..width * height).map(|i| of((i % width) as f64, (i / width) as f64) as f32).collect();
    Plane { width, height, top: 0, data }
}
