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

mod known_light;
mod levels;
mod light;
mod table;

use crate::profile::bore::{Bore, MARGIN_PX};
use crate::profile::raster::plane::Plane;
use crate::profile::{EmptyCapillary, Picture};
use known_light::{KnownLight, Surroundings};
use levels::Levels;
use light::{ACROSS, Light};
use table::Table;

/// The values of each column of the bore, side by side, so that those of many columns are computed at once.
#[derive(Debug, Default)]
struct Columns {
    /// Table row of the window's first row, and table rows per picture row.
    first_t: Vec<f32>,
    per_px: Vec<f32>,
    /// The three terms of the light across the bore.
    light: [Vec<f32>; ACROSS],
    /// The light in the water beside the capillary, where it replaces the empty capillary's picture: at table row 0, and its
    /// slope per row.
    beside: [Vec<f32>; 2],
}

impl Columns {
    fn fill(&mut self, bore: &Bore, light: &Light, beside: impl Fn(usize) -> [f32; 2]) {
        let Self { first_t, per_px, light: terms, beside: sides } = self;
        [&mut *first_t, &mut *per_px].into_iter().chain(&mut *terms).chain(&mut *sides).for_each(Vec::clear);
        for u in 0..bore.width {
            let rate = bore.mean_px / bore.walls.bore_px(u as f64);
            first_t.push(((bore.top as f64 - bore.walls.upper.inner.at(u as f64)) * rate) as f32 + MARGIN_PX as f32);
            per_px.push(rate as f32);
            let along = Light::along(2.0 * u as f64 / (bore.width.max(2) - 1) as f64 - 1.0);
            terms.iter_mut().zip(light.column(&along)).for_each(|(terms, term)| terms.push(term));
            sides.iter_mut().zip(beside(u)).for_each(|(sides, side)| sides.push(side));
        }
    }
}

/// The values of one row of the window.
#[derive(Debug, Default)]
struct Row {
    /// Table row.
    t: Vec<f32>,
    /// Level of the empty bore, and its slope from row to row.
    level: Vec<f32>,
    slope: Vec<f32>,
    /// The empty capillary's picture, share of its typical grey value.
    known: Vec<f32>,
    /// Contrast, standard deviations.
    sigmas: Vec<f32>,
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
pub(in crate::profile) struct Background {
    table: Table,
    levels: Levels,
    /// The level of each row of the table, its slope from row to row, and the changes of both to the next row.
    rungs: Vec<[f32; 4]>,
    columns: Columns,
    row: Row,
    /// Lent to [`KnownLight`] while a colour is read.
    beside: Surroundings,
    pub contrast: Contrast,
}

impl Background {
    /// Fills [`Background::contrast`] for the bore's window.
    pub fn take_away(&mut self, bore: &Bore, picture: &Picture, empty: Option<&EmptyCapillary>) {
        let colours = picture.colours();
        let size = bore.width * bore.height();
        self.contrast.lightness.reset(bore.width, bore.top, bore.height());
        self.contrast.darkness.reset(bore.width, bore.top, bore.height());
        self.contrast.colour.clear();
        self.contrast.colour.resize(if colours == 3 { size } else { 0 }, 0.0);
        (self.contrast.noise_grey, self.contrast.all_light) = (0.0, 0.0);
        for channel in 0..colours {
            let known = if let Some(r) = empty {
                KnownLight::EmptyCapillary { plane: r.plane(channel), bore: Bore { walls: r.walls(), ..bore.clone() } }
            } else {
                let mut beside = std::mem::take(&mut self.beside);
                beside.read(bore, &picture.planes()[channel]);
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
        let slope = |t: usize| (profile[(t + 1).min(rows - 1)] - profile[t.saturating_sub(1)]).abs() / 2.0;
        self.rungs.clear();
        self.rungs.extend((0..rows).map(|t| {
            let next = (t + 1).min(rows - 1);
            [profile[t], slope(t), profile[next] - profile[t], slope(next) - slope(t)]
        }));
        self.columns.fill(bore, light, |u| match known {
            KnownLight::EmptyCapillary { .. } => [1.0, 0.0],
            KnownLight::Surroundings(beside) => beside.columns[u].map(|light| light / self.table.typical),
        });
        let unit = share * profile[rows / 2] / noise;
        let last = (rows - 1) as f32;
        let per_row = 2.0 / last;
        self.contrast.all_light += unit;
        let width = bore.width;
        let Row { t, level, slope, known: known_row, sigmas } = &mut self.row;
        for row in [&mut *t, &mut *level, &mut *slope, &mut *sigmas] {
            row.resize(width, 0.0);
        }
        let (t, level, slope, sigmas) = (&mut t[..width], &mut level[..width], &mut slope[..width], &mut sigmas[..width]);
        let Columns { first_t, per_px, light: [c0, c1, c2], beside: [beside, beside_per_row] } = &self.columns;
        let (first_t, per_px, beside, beside_per_row) = (&first_t[..width], &per_px[..width], &beside[..width], &beside_per_row[..width]);
        let (c0, c1, c2) = (&c0[..width], &c1[..width], &c2[..width]);
        known_row.clear();
        known_row.resize(width, 1.0);
        for v in 0..bore.height() {
            let span = v * width..(v + 1) * width;
            let seen = &picture.planes()[channel][(bore.top + v) * width..][..width];
            for u in 0..width {
                t[u] = (first_t[u] + v as f32 * per_px[u]).clamp(0.0, last);
            }
            if let KnownLight::EmptyCapillary { .. } = known {
                for (u, light) in known_row.iter_mut().enumerate() {
                    *light = known.at(f64::from(first_t[u] + v as f32 * per_px[u]), u) / self.table.typical;
                }
            }
            for u in 0..width {
                // The processor converts directly to signed integers of 32 bits.
                let below = t[u] as i32 as usize;
                let part = t[u] - below as f32;
                let [l, s, next_l, next_s] = self.rungs[below];
                (level[u], slope[u]) = (l + part * next_l, s + part * next_s);
            }
            let darkness = &mut self.contrast.darkness.data[span.clone()];
            let known_row = &known_row[..width];
            for u in 0..width {
                let y = t[u] * per_row - 1.0;
                let expected = (beside[u] + t[u] * beside_per_row[u]) * known_row[u];
                let lit = (c0[u] + y * c1[u] + (1.5 * y * y - 0.5) * c2[u]).max(0.1) * expected;
                let level = (level[u] * lit).max(1.0);
                let misplaced = slope[u] * lit * MISPLACED_PX;
                let off = level - f32::from(seen[u]);
                sigmas[u] = off / (noise * noise + misplaced * misplaced).sqrt();
                darkness[u] += unit * off / level.max(TELLING * noise);
            }
            let lightness = self.contrast.lightness.data[span.clone()].iter_mut();
            lightness.zip(&*sigmas).for_each(|(lightness, sigmas)| *lightness += share * sigmas);
            if colour_sign != 0.0 {
                let colour = self.contrast.colour[span].iter_mut();
                colour.zip(&*sigmas).for_each(|(colour, sigmas)| *colour += colour_sign * sigmas);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{PixelFormat, RawFrame};
    use crate::profile::bore::walls;
    use crate::profile::settings::WallSettings;
    use crate::profile::synthetic::{Noise, blurred_step};

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
        // The reference's own noise counts too, halved or not by how it lies between rows; so does what the light's course
        // between its blocks is off by where it falls off.
        let most = if fall > 0.0 { 3.0 } else { 1.65 };
        contrasts_of(&picture(true, (0.0, 0.0), fall, 1), empty, most)
    }

    /// As `contrasts`. `most`: largest noise, grey values.
    fn contrasts_of(picture: &Picture, empty: Option<&EmptyCapillary>, most: f64) -> (f32, f32) {
        let bore = Bore::of(picture, walls::WallFinder::default().find(picture, &WallSettings::default()).unwrap());
        let mut background = Background::default();
        background.take_away(&bore, picture, empty);
        let lightness = &background.contrast.lightness;
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

    /// Dirt on the glass, of which the blur reaches into the few rows below the capillary that the picture has. There is enough light above.
    #[test]
    fn nor_where_few_rows_beside_the_glass_are_in_the_picture() {
        const ROWS: usize = 270;
        let whole = picture(true, (0.0, 0.0), 0.0, 1);
        let dirty = |u: usize, v: usize, grey: u8| if u < WIDTH / 2 && v > 262 { (0.7 * f64::from(grey)) as u8 } else { grey };
        let bytes = whole.planes()[1].iter().enumerate().map(|(i, grey)| dirty(i % WIDTH, i / WIDTH, *grey)).take(ROWS * WIDTH).collect();
        let cut = Picture::from_frame(&RawFrame::new(WIDTH as u32, ROWS as u32, PixelFormat::Mono8, bytes).unwrap());
        let (outside, inside) = contrasts_of(&cut, None, 1.65);
        // The light of one side tells nothing of its course across the bore.
        assert!(outside.abs() < 0.5 && inside > 20.0, "outside {outside}, inside {inside}");
    }
}
