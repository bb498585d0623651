//! Specks of dust by the statistics of real frames: about 80 visible ones per 1000 px of bore, and many faint ones.

use crate::random::Random;
use crate::shape::{Point, Specimen};
use std::f64::consts::TAU;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// On the window of the instrument: at rest in the frame, px.
    Window { u: f64, v: f64 },
    /// On the glass or in the water: turns with the capillary. Position at angle 0, um.
    Turning(Point),
}

#[derive(Debug, Clone, Copy)]
pub struct Speck {
    pub place: Place,
    /// Share of the light that its middle takes.
    pub depth: f64,
    /// Full width at half maximum, px, along and across its own axis.
    pub fwhm_px: [f64; 2],
    /// Direction of its own axis in the frame, rad.
    pub along_rad: f64,
}

/// How dirty the instrument is.
#[derive(Debug, Clone, Copy)]
pub struct Dirt {
    /// Specks that take 2 % of the light or more, per 1000 px of bore.
    pub visible_per_1000_px: f64,
    /// Specks that take 0.4 to 2 %.
    pub faint_per_1000_px: f64,
    /// Shares of the specks on the window and on the glass; the others are in the water.
    pub on_window: f64,
    pub on_glass: f64,
}

impl Dirt {
    /// What was measured on real frames. How the specks are shared out between window, glass and water is an assumption.
    pub const MEASURED: Self = Self { visible_per_1000_px: 80.0, faint_per_1000_px: 200.0, on_window: 0.35, on_glass: 0.45 };
    pub const NONE: Self = Self { visible_per_1000_px: 0.0, faint_per_1000_px: 0.0, on_window: 0.0, on_glass: 0.0 };

    /// The specks of a frame of `width` x `height` px whose bore has a radius of `bore_um`. None lies inside the specimen.
    pub fn specks(&self, seed: u64, [width, height]: [usize; 2], bore_um: f64, px_um: f64, specimen: Option<&Specimen>) -> Vec<Speck> {
        let mut r = Random::new(seed ^ 0xd057);
        let (long, high) = (width as f64, height as f64);
        let mut specks = Vec::new();
        for (per_1000_px, faint) in [(self.visible_per_1000_px, false), (self.faint_per_1000_px, true)] {
            let in_bore = per_1000_px * long / 1000.0;
            let count = |share: f64, r: &mut Random| (in_bore * share + r.uniform(0.0, 1.0)) as usize;
            for _ in 0..count(self.on_window * high * px_um / (2.0 * bore_um), &mut r) {
                let place = Place::Window { u: r.uniform(0.0, long), v: r.uniform(0.0, high) };
                specks.push(Speck::at(place, faint, &mut r));
            }
            // What turns may leave the frame when the picture is rolled: a margin keeps the density even.
            let reach_um = (long / 2.0 + 10.0) * px_um;
            let glass = count(self.on_glass * (1.0 + 20.0 / long), &mut r);
            let water = count((1.0 - self.on_window - self.on_glass) * (1.0 + 20.0 / long), &mut r);
            for number in 0..glass + water {
                let point = loop {
                    let (x, turn) = (r.uniform(-reach_um, reach_um), r.uniform(0.0, TAU));
                    let radius = if number < glass { 1.0 } else { 0.97 * r.uniform(0.0, 1.0).sqrt() } * bore_um;
                    let point = [x, radius * turn.cos(), radius * turn.sin()];
                    if number < glass || !specimen.is_some_and(|s| s.contains(point)) {
                        break point;
                    }
                };
                specks.push(Speck::at(Place::Turning(point), faint, &mut r));
            }
        }
        specks
    }
}

impl Speck {
    fn at(place: Place, faint: bool, r: &mut Random) -> Self {
        let depth = loop {
            let depth = if faint { 0.004 * 5f64.powf(r.uniform(0.0, 1.0)) } else { 0.045 * (0.62 * r.normal()).exp() };
            if faint || (0.02..0.5).contains(&depth) {
                break depth;
            }
        };
        // 2.1, 3.6 and 5.1 px at 10, 50 and 90 % are those of a normal distribution.
        let fwhm_px = (3.6 + 1.17 * r.normal()).max(1.3);
        let oval = r.uniform(1.0, 1.3);
        Self { place, depth, fwhm_px: [fwhm_px * oval, fwhm_px / oval], along_rad: r.uniform(0.0, TAU) }
    }

    /// Multiplies a picture of `width` columns by what the speck, seen at `[u, v]`, lets through: a raised cosine.
    pub fn darken(&self, [u, v]: [f64; 2], picture: &mut [f32], width: usize) {
        let reach = self.fwhm_px[0].max(self.fwhm_px[1]);
        let height = picture.len() / width;
        let span = |at: f64, n: usize| (at - reach).ceil().max(0.0) as usize..((at + reach).floor() + 1.0).clamp(0.0, n as f64) as usize;
        let (sin, cos) = self.along_rad.sin_cos();
        for row in span(v, height) {
            for column in span(u, width) {
                let (du, dv) = (column as f64 - u, row as f64 - v);
                let r = ((du * cos + dv * sin) / self.fwhm_px[0]).hypot((dv * cos - du * sin) / self.fwhm_px[1]);
                if r < 1.0 {
                    picture[row * width + column] *= (1.0 - self.depth * 0.5 * (1.0 + (r * TAU / 2.0).cos())) as f32;
                }
            }
        }
    }
}
