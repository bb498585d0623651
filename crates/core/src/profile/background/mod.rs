//! Estimates from the frame itself how the bore would look if it were empty.
//!
//! ```text
//!   B(u, t) = a(t) * p(u, t)        t: rows below the upper wall, along the capillary's own tilt
//!             |      '- smooth unevenness of the light: a polynomial of low order
//!             '- what the glass does across the bore, the same in every column: dark towards the walls
//! ```
//! The variation of the light along the capillary is read first from the water outside, where there is no specimen, and divided
//! out; it may fall to nothing, which no polynomial follows. A specimen darkens what it covers, so the brightest cells of a row
//! show the empty bore. They give the row its first level, which then moves to the nearest mode. The polynomial is fitted to
//! the cells that agree. Cells are means of several pixels, so that a specimen as faint as a pixel's noise still differs from
//! the light. Where the rig has a picture of its empty capillary, all this is done on the quotient of the two pictures, in
//! which glass, dust and scratches cancel.

mod bore;
mod known_light;
mod levels;
mod light;
mod table;

pub(super) use bore::{Bore, MARGIN_PX};

use super::plane::Plane;
use super::{EmptyCapillary, Picture};
use known_light::{KnownLight, Surroundings};
use levels::Levels;
use light::{ACROSS, Light};
use table::Table;

/// One column of the bore.
#[derive(Debug)]
struct Column {
    /// Row of the upper wall's inner line.
    inner_v: f64,
    bore_px: f64,
    /// The three terms of the light across the bore.
    light: [f32; ACROSS],
    /// The light in the water beside the capillary, where it replaces the empty capillary's picture: at table row 0, and its
    /// slope per row.
    beside: [f32; 2],
}

impl Column {
    /// Table row of picture row `v`.
    fn t_of(&self, v: f64, mean_px: f64) -> f64 {
        (v - self.inner_v) * mean_px / self.bore_px + MARGIN_PX as f64
    }
}

/// The specimen's window after subtraction of the empty bore. Missing light counts positive.
#[derive(Debug, Default)]
pub(in crate::profile) struct Contrast {
    /// Missing light in standard deviations of a pixel's noise, mean of the colours. Near the walls the uncertainty of their
    /// position is added to the noise. It is used to find the specimen.
    pub lightness: Plane,
    /// Blue against red, in standard deviations: it shows yellowish tissue that is hardly darker than the light. Empty for grey
    /// pictures.
    pub colour: Vec<f32>,
    /// The share of missing light, scaled so that it equals `lightness` in the middle of the bore. A specimen in front of the
    /// dark line of a wall takes the same share as beside it, so that its edge continues there. It is used to locate the edge.
    pub darkness: Plane,
    /// Darkness where no light is left.
    pub all_light: f32,
    /// Noise of a pixel, grey values, mean of the colours.
    pub noise_grey: f64,
}

/// Finds the empty bore and subtracts it. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Background {
    table: Table,
    levels: Levels,
    /// The slope of the level from row to row.
    slope: Vec<f32>,
    /// The values of each column.
    columns: Vec<Column>,
    known_row: Vec<f32>,
    /// Lent to [`KnownLight`] while a colour is read.
    beside: Surroundings,
    pub contrast: Contrast,
}

impl Background {
    /// Fills [`Background::contrast`] for the bore's window.
    pub fn take_away(&mut self, bore: &Bore, picture: &Picture, empty: Option<&EmptyCapillary>) {
        let colours = picture.colours();
        let size = bore.width * bore.height();
        self.contrast.lightness.reset(bore);
        self.contrast.darkness.reset(bore);
        self.contrast.colour.clear();
        self.contrast.colour.resize(if colours == 3 { size } else { 0 }, 0.0);
        (self.contrast.noise_grey, self.contrast.all_light) = (0.0, 0.0);
        for channel in 0..colours {
            let known = if let Some(r) = empty {
                KnownLight::EmptyCapillary { plane: r.plane(channel), bore: Bore { walls: r.walls(), ..bore.clone() } }
            } else {
                let mut beside = std::mem::take(&mut self.beside);
                beside.read(bore, &picture.planes()[channel], picture.height());
                KnownLight::Surroundings(beside)
            };
            self.table.fill(bore, &picture.planes()[channel], &known);
            let light = self.levels.estimate(&self.table);
            let noise = self.levels.noise(&self.table, bore, &picture.planes()[channel], &known);
            self.contrast.noise_grey += f64::from(noise) / colours as f64;
            self.subtract(bore, picture, channel, &light, noise, &known);
            if let KnownLight::Surroundings(beside) = known {
                self.beside = beside;
            }
        }
    }

    /// Adds the contrast of one colour to that of the others.
    fn subtract(&mut self, bore: &Bore, picture: &Picture, channel: usize, light: &Light, noise: f32, known: &KnownLight) {
        const MISPLACED_PX: f32 = 0.2;
        // Light below which the missing share cannot be determined, in units of a pixel's noise.
        const TELLING: f32 = 8.0;
        let colours = picture.colours();
        let share = 1.0 / colours as f32;
        // Blue counts positive, red negative.
        let colour_sign = if colours == 3 { channel as f32 - 1.0 } else { 0.0 };
        let (rows, profile) = (self.table.rows, &self.levels.profile);
        self.slope.clear();
        self.slope.extend((0..rows).map(|t| (profile[(t + 1).min(rows - 1)] - profile[t.saturating_sub(1)]).abs() / 2.0));
        self.columns.clear();
        self.columns.extend((0..bore.width).map(|u| Column {
            inner_v: bore.walls.upper.inner.at(u as f64),
            bore_px: bore.walls.bore_px(u as f64),
            light: light.column(2.0 * u as f64 / (bore.width.max(2) - 1) as f64 - 1.0),
            beside: match known {
                KnownLight::EmptyCapillary { .. } => [1.0, 0.0],
                KnownLight::Surroundings(beside) => beside.columns[u].map(|light| light / self.table.typical),
            },
        }));
        let mid_level = profile[rows / 2];
        let unit = share * mid_level / noise;
        let last = (rows - 1) as f32;
        let per_row = 2.0 / last;
        self.contrast.all_light += unit;
        let Contrast { lightness, colour, darkness, .. } = &mut self.contrast;
        for v in 0..bore.height() {
            let row_v = (bore.top + v) as f64;
            let span = v * bore.width..(v + 1) * bore.width;
            let seen = &picture.planes()[channel][(bore.top + v) * bore.width..][..bore.width];
            let (lightness, darkness) = (&mut lightness.data[span.clone()], &mut darkness.data[span.clone()]);
            self.known_row.clear();
            if let KnownLight::EmptyCapillary { .. } = known {
                let typical = self.table.typical;
                let t = |u: usize| self.columns[u].t_of(row_v, bore.mean_px);
                self.known_row.extend((0..bore.width).map(|u| known.at(t(u), u) / typical));
            }
            for u in 0..bore.width {
                let column = &self.columns[u];
                let t = (column.t_of(row_v, bore.mean_px) as f32).clamp(0.0, last);
                let (t0, part) = (t as usize, t.fract());
                let t1 = (t0 + 1).min(rows - 1);
                let y = t * per_row - 1.0;
                let [c0, c1, c2] = column.light;
                let expected = (column.beside[0] + t * column.beside[1]) * self.known_row.get(u).copied().unwrap_or(1.0);
                let lit = (c0 + y * c1 + (1.5 * y * y - 0.5) * c2).max(0.1) * expected;
                let level = ((profile[t0] + part * (profile[t1] - profile[t0])) * lit).max(1.0);
                let slope = (self.slope[t0] + part * (self.slope[t1] - self.slope[t0])) * lit * MISPLACED_PX;
                let off = level - f32::from(seen[u]);
                let sigmas = off / (noise * noise + slope * slope).sqrt();
                lightness[u] += share * sigmas;
                darkness[u] += unit * off / level.max(TELLING * noise);
                if let Some(colour) = colour.get_mut(span.start + u) {
                    *colour += colour_sign * sigmas;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{PixelFormat, RawFrame};
    use crate::profile::settings::WallSettings;
    use crate::profile::synthetic::{Noise, blurred_step};
    use crate::profile::walls;

    const WIDTH: usize = 512;
    const HEIGHT: usize = 320;
    const BODY: [f64; 4] = [240.0, 160.0, 130.0, 45.0];

    /// A capillary between rows 60 and 260 in uneven light, with or without a dark body, moved down and tilted. Towards the left end
    /// `fall` of the light is missing.
    fn picture(body: bool, (down_px, slope): (f64, f64), fall: f64, seed: u64) -> Picture {
        let mut noise = Noise::new(seed);
        let mut grey = |u: f64, v: f64| {
            let (x, y) = (u / 256.0 - 1.0, v / 160.0 - 1.0);
            let far = ((u - 511.0) / 511.0).powi(2);
            let light = 190.0 * (1.0 + 0.06 * x - 0.05 * x * x - 0.03 * y) * (1.0 - fall * far).max(0.0);
            let t = v - down_px - slope * (u - 255.5);
            let line = |at: f64| 0.6 * (-0.5 * ((t - at) / 1.5).powi(2)).exp();
            let glass = 1.0 - line(60.0) - line(260.0);
            // Glass darkens the bore towards its walls.
            let across = ((t - 160.0) / 100.0).clamp(-1.0, 1.0);
            let shade = 1.0 - 0.1 * across.powi(4);
            let [u0, v0, a, b] = BODY;
            let depth = (1.0 - ((u - u0) / a).hypot((v - v0) / b)) * b;
            let body = if body { 1.0 - 0.4 * blurred_step(depth, 1.5) } else { 1.0 };
            (light * glass * shade * body + 1.5 * noise.next()).round().clamp(0.0, 255.0) as u8
        };
        let bytes = (0..WIDTH * HEIGHT).map(|i| grey((i % WIDTH) as f64, (i / WIDTH) as f64)).collect();
        Picture::from_frame(&RawFrame::new(WIDTH as u32, HEIGHT as u32, PixelFormat::Mono8, bytes).unwrap())
    }

    /// Largest mean contrast of a block of 16 x 16 px off the walls and off the body, and least mean contrast inside it.
    fn contrasts(empty: Option<&EmptyCapillary>, fall: f64) -> (f32, f32) {
        let picture = picture(true, (0.0, 0.0), fall, 1);
        let bore = Bore::of(&picture, walls::WallFinder::default().find(&picture, &WallSettings::default()).unwrap());
        let mut background = Background::default();
        background.take_away(&bore, &picture, empty);
        let lightness = &background.contrast.lightness;
        // The reference's own noise counts too, halved or not by how it lies between rows; so does what the light's course
        // between its blocks is off by where it falls off.
        let most = if fall > 0.0 { 3.0 } else { 1.65 };
        let least_and_most = if empty.is_some() { (1.8, 2.2) } else { (1.4, most) };
        let noise = background.contrast.noise_grey;
        assert!((least_and_most.0..least_and_most.1).contains(&noise), "noise {noise}");
        let (mut outside, mut inside) = (0.0f32, f32::MAX);
        for v0 in (76..232).step_by(16) {
            for u0 in (0..WIDTH).step_by(16) {
                let depth = |u: usize, v: usize| 1.0 - ((u as f64 - BODY[0]) / BODY[2]).hypot((v as f64 - BODY[1]) / BODY[3]);
                let corners = [depth(u0, v0), depth(u0 + 15, v0), depth(u0, v0 + 15), depth(u0 + 15, v0 + 15)];
                let rows = v0 - bore.top..v0 - bore.top + 16;
                let mean = rows.map(|v| lightness.row(v)[u0..u0 + 16].iter().sum::<f32>()).sum::<f32>() / 256.0;
                if corners.iter().all(|d| *d < -0.15) {
                    if mean.abs() > outside.abs() {
                        outside = mean;
                    }
                } else if corners.iter().all(|d| *d > 0.15) {
                    inside = inside.min(mean);
                }
            }
        }
        (outside, inside)
    }

    /// A block's own noise is 1 / 16; five times that for the largest of 200.
    #[test]
    fn what_is_empty_has_no_contrast() {
        let (outside, inside) = contrasts(None, 0.0);
        assert!(outside.abs() < 0.3 && inside > 20.0, "outside {outside}, inside {inside}");
    }

    /// Where it is dark, the body takes less light: a fifth of it at its left end.
    #[test]
    fn nor_where_the_light_falls_off_to_nothing() {
        let (outside, inside) = contrasts(None, 0.9);
        assert!(outside.abs() < 0.5 && inside > 4.0, "outside {outside}, inside {inside}");
    }

    #[test]
    fn nor_beside_a_picture_of_the_empty_capillary_that_lies_elsewhere() {
        let reference = EmptyCapillary::new(picture(false, (1.5, 0.004), 0.0, 2), &WallSettings::default()).unwrap();
        let (outside, inside) = contrasts(Some(&reference), 0.0);
        assert!(outside.abs() < 0.3 && inside > 20.0, "outside {outside}, inside {inside}");
    }
}
