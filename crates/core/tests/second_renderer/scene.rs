//! A frame: camera, lamp, capillary, dust, specimen, sensor.

use crate::dust::{Place, Speck};
use crate::optics::{FINE, Optics, SpecimenImage, image};
use crate::random::Random;
use crate::shape::{Point, Specimen};
use rayon::prelude::*;

/// A telecentric camera. The capillary turns about the image of its axis, which the roll tilts.
#[derive(Debug, Clone, Copy)]
pub struct View {
    pub width: usize,
    pub height: usize,
    /// Scale, um per px.
    pub px_um: f64,
    /// Column and row of the origin of the axis, px. Pixel centres are at integers.
    pub origin_px: [f64; 2],
    /// Roll of the axis, rad; positive lowers its +x end.
    pub roll_rad: f64,
}

impl View {
    /// Where a point of the capillary at angle 0 is seen when the capillary has turned by `omega`: positive angles move what is near the
    /// camera (z negative) downwards.
    pub fn project(&self, [x, y, z]: Point, omega: f64) -> [f64; 2] {
        let across = y * omega.cos() - z * omega.sin();
        let (sin, cos) = self.roll_rad.sin_cos();
        [self.origin_px[0] + (x * cos - across * sin) / self.px_um, self.origin_px[1] + (x * sin + across * cos) / self.px_um]
    }

    /// Position along the axis and across it, um, of what is seen at a pixel.
    fn aligned(&self, u: f64, v: f64) -> [f64; 2] {
        let (du, dv) = ((u - self.origin_px[0]) * self.px_um, (v - self.origin_px[1]) * self.px_um);
        let (sin, cos) = self.roll_rad.sin_cos();
        [du * cos + dv * sin, dv * cos - du * sin]
    }

    /// Distance of two slices of a specimen, um.
    pub fn step_um(&self) -> f64 {
        self.px_um / FINE as f64
    }
}

/// The lamp and the window: a plane and a paraboloid.
#[derive(Debug, Clone, Copy)]
pub struct Lamp {
    pub grey: [f64; 3],
    /// Relative change over the width and over the height of the picture.
    pub slope: [f64; 2],
    /// Relative change between the middle and the middle of the left and right border.
    pub curvature: f64,
}

/// The wall of the capillary in profile, the same above and below.
///
/// ```text
///   light ___       _    ________   outside, bright line, dark line of the outer face
///            \_/\__/ \  /
///                     \/  dark line of the inner face, then shade that fades into the bore
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Glass {
    /// Radius of the bore, um.
    pub bore_um: f64,
    /// Share of the light that the inner dark line takes, and its full width at half maximum, px.
    pub line: f64,
    pub line_px: f64,
    /// Share that the outer line takes; 0 makes the wall a single line. Distance between both lines, px.
    pub outer: f64,
    pub apart_px: f64,
    /// Light that the bright line adds.
    pub bright: f64,
    /// Share that the shade in the bore takes at the inner face, and where it has fallen to 1/e, px.
    pub shade: f64,
    pub fade_px: f64,
    /// Light in the bore relative to the light outside.
    pub bore_level: f64,
}

impl Glass {
    /// Share of the light at a distance (px) from the inner face, positive in the bore.
    pub fn passes(&self, inside_px: f64) -> f64 {
        // The full width at half maximum of 1 / cosh^2(x) is 1.763.
        let line = |at: f64, wide: f64| 1.0 / (1.763 * (inside_px - at) / wide).cosh().powi(2);
        let dark = self.line_px / 2.0;
        let bore = 1.0 / (1.0 + (-2.0 * inside_px).clamp(-60.0, 60.0).exp());
        let shade = self.shade * bore * (-inside_px.max(0.0) / self.fade_px).exp();
        let outer = self.outer * line(-dark - self.apart_px, 0.7 * self.line_px);
        let bright = self.bright * line(-dark - self.apart_px - self.line_px, 0.8 * self.line_px);
        (1.0 - (1.0 - self.bore_level) * bore) * (1.0 - self.line * line(-dark, self.line_px)) * (1.0 - outer) * (1.0 - shade) + bright
    }
}

/// A sensor under a colour mosaic, R G above G B.
#[derive(Debug, Clone, Copy)]
pub struct Sensor {
    /// Standard deviation of the noise of a pixel at a grey value of 220, before demosaicking. It grows with the root of the light.
    pub shot_grey: f64,
    /// The part of it that does not depend on the light.
    pub read_grey: f64,
}

#[derive(Debug, Clone)]
pub struct Scene {
    pub view: View,
    pub lamp: Lamp,
    pub glass: Glass,
    pub optics: Optics,
    pub sensor: Sensor,
    pub specks: Vec<Speck>,
    pub specimen: Option<Specimen>,
    pub seed: u64,
}

/// A frame with its truth.
pub struct Frame {
    pub width: usize,
    pub height: usize,
    /// Under the colour mosaic, one byte per pixel.
    pub mosaic: Vec<u8>,
    /// Coverage of each pixel by the specimen, 0 to 1.
    pub covered: Vec<f32>,
    /// Coverage by the specimen without its fins.
    pub body: Vec<f32>,
}

impl Scene {
    /// Light at each pixel in grey values, red, green and blue, without noise; and the coverages with and without fins.
    pub fn light(&self, omega: f64) -> ([Vec<f32>; 3], [Vec<f32>; 2]) {
        let View { width, height, .. } = self.view;
        let seen = self.specimen.as_ref().map(|s| image(s, omega, &self.optics));
        let mut dust = vec![1.0f32; width * height];
        for speck in &self.specks {
            let at = match speck.place {
                Place::Window { u, v } => [u, v],
                Place::Turning(point) => self.view.project(point, omega),
            };
            speck.darken(at, &mut dust, width);
        }
        let pixels: Vec<[f32; 5]> =
            (0..width * height).into_par_iter().map(|i| self.pixel(i % width, i / width, dust[i], seen.as_ref())).collect();
        let plane = |c: usize| pixels.iter().map(|p| p[c]).collect::<Vec<f32>>();
        (std::array::from_fn(plane), [plane(3), plane(4)])
    }

    /// Red, green and blue light of a pixel, and its coverage with and without fins.
    fn pixel(&self, u: usize, v: usize, dust: f32, seen: Option<&SpecimenImage>) -> [f32; 5] {
        let (wide, high) = (self.view.width as f64, self.view.height as f64);
        let (u, v) = (u as f64, v as f64);
        let [x, across] = self.view.aligned(u, v);
        let (du, dv) = ((u - (wide - 1.0) / 2.0) / wide, (v - (high - 1.0) / 2.0) / wide);
        let even = 1.0 + self.lamp.slope[0] * du + self.lamp.slope[1] * dv * wide / high + self.lamp.curvature * 4.0 * (du * du + dv * dv);
        let glass = self.glass.passes((self.glass.bore_um - across.abs()) / self.view.px_um);
        let [column, row] = [x / self.view.step_um(), across / self.view.step_um()];
        let mut out = [0.0; 5];
        for (c, grey) in self.lamp.grey.iter().enumerate() {
            let specimen = seen.map_or(1.0, |s| s.intensity[c].mean(column, row, 1.0));
            out[c] = (grey * even * glass) as f32 * dust * specimen;
        }
        if let Some(seen) = seen {
            (out[3], out[4]) = (seen.covered.mean(column, row, 0.0), seen.body.mean(column, row, 0.0));
        }
        out
    }

    /// The frame number `number` at angle `omega` (rad). The number decides the noise alone.
    pub fn render(&self, omega: f64, number: u64) -> Frame {
        let View { width, height, .. } = self.view;
        let (planes, [covered, body]) = self.light(omega);
        let mut r = Random::new(self.seed.wrapping_mul(7919) ^ (number << 20) ^ 0x5e75);
        let value = |(i, _): (usize, &f32)| {
            let light = f64::from(planes[i % width % 2 + i / width % 2][i]);
            let sd = (self.sensor.shot_grey.powi(2) * light / 220.0 + self.sensor.read_grey.powi(2)).sqrt();
            (light + sd * r.normal()).round().clamp(0.0, 255.0) as u8
        };
        let mosaic = covered.iter().enumerate().map(value).collect();
        Frame { width, height, mosaic, covered, body }
    }
}

impl Frame {
    /// Interleaved colours, red first: each missing colour is the mean of those of the pixels around that have it.
    pub fn rgb(&self) -> Vec<u8> {
        let colour = |u: usize, v: usize| u % 2 + v % 2;
        let (last_u, last_v) = (self.width - 1, self.height - 1);
        let pixel = |i: usize| {
            let (u, v) = (i % self.width, i / self.width);
            let mut sums = [[0u32; 2]; 3];
            for row in v.saturating_sub(1)..=(v + 1).min(last_v) {
                for column in u.saturating_sub(1)..=(u + 1).min(last_u) {
                    let [sum, count] = &mut sums[colour(column, row)];
                    (*sum, *count) = (*sum + u32::from(self.mosaic[row * self.width + column]), *count + 1);
                }
            }
            sums[colour(u, v)] = [u32::from(self.mosaic[i]), 1];
            sums.map(|[sum, count]| ((sum + count / 2) / count) as u8)
        };
        (0..self.mosaic.len()).flat_map(pixel).collect()
    }
}
