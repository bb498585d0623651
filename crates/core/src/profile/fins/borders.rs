//! How much each pixel beside the body looks like the outer border of a fin. A single view does not decide by it: the views are pooled.
//!
//! ```text
//!   lightness of one column      body ___|  fin ¯¯¯\_line_/¯¯¯ water          matched filter across the border, mean along the
//!   outwards from the body            ↑ margin                                capillary, divided by the level of chance = z
//! ```

use super::fringe::{Filters, INSIDE, OUTER, WALL_LINE_PX, mark};
use crate::profile::bore::background::Contrast;
use crate::profile::bore::walls::Walls;
use crate::profile::raster::columns::Columns;
use crate::profile::raster::outline::Polygon;
use crate::profile::raster::plane::{gaussian, quantile};
use std::sync::Arc;

/// Standard deviation of the mean along the capillary, px.
const ALONG_PX: f64 = 3.0;
/// Samples nearer to the body's edge than this many blurs show the body.
const BODY_BLURS: f64 = 2.1;
/// Blur that is assumed where the edge does not tell it, and the range in which it is believed, px.
const BLUR_PX: f64 = 1.1;
const BLUR_RANGE_PX: (f64, f64) = (0.8, 2.0);
/// Least weight of the pixels in a mean along the capillary.
const WEIGHT_LEAST: f32 = 0.5;
/// Least samples outside of a border.
const OUTSIDE_LEAST: usize = 5;
/// Steps of a stored number per standard deviation, and the number that says that there can be no border.
const STEPS: f32 = 31.0;
const NONE: i8 = i8::MIN;
/// Largest magnitude of a response, standard deviations. One view cannot outweigh the others.
const MOST: f32 = 4.0;
/// One of so many responses is read for the level of chance.
const SAMPLED: usize = 7;

/// The responses to a fin's outer border in the bore of one view, in standard deviations of what chance gives.
#[derive(Debug, Clone, PartialEq)]
pub struct FinBorders {
    width: usize,
    height: usize,
    /// Row of the picture in which the window begins.
    top: usize,
    margin_px: f64,
    bore_px: f64,
    /// Borders of the upper and of the lower side, column by column.
    sides: [Arc<[i8]>; 2],
}

/// What the responses are made from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window<'a> {
    /// Contrast in standard deviations of a pixel's noise, row by row.
    pub lightness: &'a [f32],
    pub width: usize,
    pub top: usize,
    /// Contrast of a mark that is not a fin's border.
    pub mark: f32,
    pub blur_px: Option<f64>,
}

impl FinBorders {
    /// The responses beside the outlines of a body, of whose frame this is the contrast.
    pub(in crate::profile) fn of(
        contrast: &Contrast,
        body: &[Polygon],
        walls: &Walls,
        blur_px: Option<f64>,
        picture_height: usize,
    ) -> Self {
        let plane = &contrast.lightness;
        let body = Columns::from_outlines(body, plane.width, picture_height);
        let mark = mark(contrast.all_light);
        let window = Window { lightness: &plane.data, width: plane.width, top: plane.top, mark, blur_px };
        let inner = |u: usize| [walls.upper.inner.at(u as f64), walls.lower.inner.at(u as f64)];
        Self::beside(&window, &body, inner)
    }

    /// The same where `walls` gives the rows of the walls' inner lines in a column.
    pub(crate) fn beside(window: &Window, body: &Columns, walls: impl Fn(usize) -> [f64; 2]) -> Self {
        let &Window { lightness, width, top, mark, blur_px } = window;
        let height = lightness.len() / width.max(1);
        let margin_px = BODY_BLURS * blur_px.unwrap_or(BLUR_PX).clamp(BLUR_RANGE_PX.0, BLUR_RANGE_PX.1);
        let filters = Filters::default();
        let (mut column, mut raw) = (vec![0.0; height], [0, 1].map(|_| vec![0.0f32; width * height]));
        let mut weight = [0, 1].map(|_| vec![0.0f32; width * height]);
        for u in 0..width {
            for (v, out) in column.iter_mut().enumerate() {
                *out = lightness[v * width + u].min(mark);
            }
            let edges = body.get(u).map(|e| [e.upper - top as f64, e.lower - top as f64]);
            let [upper, lower] = walls(u);
            let open = (upper - top as f64 + WALL_LINE_PX, lower - top as f64 - WALL_LINE_PX);
            for side in 0..2 {
                let at = u * height..(u + 1) * height;
                let (raw, weight) = (&mut raw[side][at.clone()], &mut weight[side][at]);
                responses(&column, edges.map(|e| e[side]), open, margin_px, side, &filters, |v, response| {
                    (raw[v], weight[v]) = (response, 1.0);
                });
            }
        }
        let mut kernel = Vec::new();
        gaussian(ALONG_PX, &mut kernel);
        let means = [0, 1].map(|side| mean_along(&raw[side], &weight[side], height, &kernel));
        let mut magnitudes: Vec<f32> = means.iter().flatten().step_by(SAMPLED).filter(|r| !r.is_nan()).map(|r| r.abs()).collect();
        let chance = (quantile(&mut magnitudes, 0.5) / 0.6745).max(1e-3);
        let stored = |r: &f32| if r.is_nan() { NONE } else { ((r / chance).clamp(-MOST, MOST) * STEPS).round() as i8 };
        let [upper, lower] = walls(width / 2);
        Self { width, height, top, margin_px, bore_px: lower - upper, sides: means.map(|side| side.iter().map(stored).collect()) }
    }

    /// Distance from the body's edge within which its blur hides a border, px.
    pub(crate) fn margin_px(&self) -> f64 {
        self.margin_px
    }

    /// Distance of the walls' inner lines from each other, px.
    pub(crate) fn bore_px(&self) -> f64 {
        self.bore_px
    }

    /// The columns of the image.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// The first row, and the responses of one column from there on. `lower`: those of borders at the lower side.
    pub(crate) fn column(&self, u: usize, lower: bool) -> (usize, &[i8]) {
        (self.top, &self.sides[usize::from(lower)][u * self.height..(u + 1) * self.height])
    }

    /// The response between two rows of a column, standard deviations. `None` where there can be no border.
    pub(crate) fn between(first: i8, second: i8, part: f32) -> Option<f32> {
        let (a, b) = (f32::from(first), f32::from(second));
        (first != NONE && second != NONE).then(|| (a + part * (b - a)) / STEPS)
    }
}

/// Calls `found` with each row of a column where a border can lie, and its response.
fn responses(
    column: &[f32],
    body: Option<f64>,
    open: (f64, f64),
    margin_px: f64,
    side: usize,
    filters: &Filters,
    mut found: impl FnMut(usize, f32),
) {
    let height = column.len();
    for v in 0..height {
        let row = v as f64;
        let (out, room) = if side == 0 { (body.map(|b| b - row), row - open.0) } else { (body.map(|b| row - b), open.1 - row) };
        let inside = out.map_or(INSIDE as f64, |out| (out - margin_px).floor().min(INSIDE as f64));
        let outside = (room.floor() + 1.0).min((OUTER + 1) as f64);
        if inside < 1.0 || outside < OUTSIDE_LEAST as f64 {
            continue;
        }
        let (inside, outside) = (inside as usize, outside as usize);
        let filter = filters.of(inside, outside);
        // From inside to outside.
        let response = if side == 0 {
            if v + inside >= height || v + 1 < outside {
                continue;
            }
            column[v + 1 - outside..=v + inside].iter().rev().zip(filter).map(|(c, w)| c * w).sum()
        } else {
            if v < inside || v + outside > height {
                continue;
            }
            column[v - inside..v + outside].iter().zip(filter).map(|(c, w)| c * w).sum()
        };
        found(v, response);
    }
}

/// Weighted mean of columns along the capillary. NaN where `weight` is 0 or where too few columns count.
fn mean_along(raw: &[f32], weight: &[f32], height: usize, kernel: &[f32]) -> Vec<f32> {
    let (width, reach) = (raw.len() / height.max(1), kernel.len() / 2);
    let mut means = Vec::with_capacity(raw.len());
    let (mut sum, mut total) = (vec![0.0f32; height], vec![0.0f32; height]);
    for u in 0..width {
        sum.fill(0.0);
        total.fill(0.0);
        for (k, &share) in kernel.iter().enumerate() {
            let Some(at) = (u + k).checked_sub(reach).filter(|at| *at < width) else { continue };
            let columns = raw[at * height..(at + 1) * height].iter().zip(&weight[at * height..(at + 1) * height]);
            for ((sum, total), (r, w)) in sum.iter_mut().zip(&mut total).zip(columns) {
                *sum += share * r;
                *total += share * w;
            }
        }
        let own = &weight[u * height..(u + 1) * height];
        means.extend(
            own.iter().zip(sum.iter().zip(&total)).map(|(own, (s, t))| if *own > 0.0 && *t > WEIGHT_LEAST { s / t } else { f32::NAN }),
        );
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::Polygon;
    use crate::profile::synthetic::{Noise, plane};

    /// A body between rows 40 and 80, and a line of the noise's size that is two px wide at row 97.
    #[test]
    fn the_border_of_a_fin_stands_out_and_nothing_beside_it() {
        let mut noise = Noise::new(5);
        let plane = plane(200, 120, |_, v| match v as usize {
            40..80 => 40.0,
            80..96 => 0.5 + noise.next(),
            96..98 => 1.0 + noise.next(),
            _ => noise.next(),
        });
        let body = Polygon { vertices: vec![[-1.0, 39.5], [200.0, 39.5], [200.0, 79.5], [-1.0, 79.5]] };
        let window = Window { lightness: &plane.data, width: 200, top: 0, mark: 5.0, blur_px: Some(1.0) };
        let borders = FinBorders::beside(&window, &Columns::from_outlines(&[body], 200, 120), |_| [0.0, 119.0]);
        let mean = |v: usize, lower: bool| {
            let column = |u: usize| FinBorders::between(borders.column(u, lower).1[v], borders.column(u, lower).1[v], 0.0);
            (10..190).filter_map(column).sum::<f32>() / 180.0
        };
        let best = (84..110).max_by(|&a, &b| mean(a, true).total_cmp(&mean(b, true)));
        assert!(best.is_some_and(|v| (96..98).contains(&v)), "{best:?}");
        assert!(mean(96, true) > 2.5, "{}", mean(96, true));
        assert!((12..30).all(|v| mean(v, false).abs() < 0.5), "the other side shows none");
        // In the body, in its blur and at the wall there can be no border.
        for (v, lower) in [(60, true), (60, false), (81, true), (38, false), (118, true), (1, false)] {
            assert_eq!(borders.column(100, lower).1[v], NONE, "row {v}, lower {lower}");
        }
    }
}
