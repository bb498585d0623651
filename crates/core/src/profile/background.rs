//! The bore as it would look empty, estimated from the frame itself.
//!
//! ```text
//!   B(u, t) = a(t) * p(u, t)        t: rows below the upper wall, along the capillary's own tilt
//!             |      '- smooth unevenness of the light: a polynomial of low order
//!             '- what the glass does across the bore, the same in every column: dark towards the walls
//! ```
//! The light's course along the capillary is read first from the water outside it, where no specimen is, and divided out: it
//! may fall off to nothing, which no polynomial follows. A specimen darkens what it covers, so the brightest cells of a row
//! show the empty bore: they give the row its first level, from where it slides to the mode beside it; the polynomial is then
//! fitted to the cells that agree. Cells are means of some pixels: what is as faint as a pixel's noise still stands out from
//! them, and is not taken for light. Where the rig has a picture of its empty capillary, all this is done on the quotient of
//! the two pictures, in which glass, dust and scratches are gone.

use super::plane::{Plane, quantile};
use super::{Picture, Reference, Walls};
use nalgebra::{SMatrix, SVector};

/// Orders of the light's polynomial along and across the capillary; 5 x 3 terms.
const ALONG: usize = 5;
const ACROSS: usize = 3;
const TERMS: usize = ALONG * ACROSS;

/// Rows of glass that the window keeps on each side of the bore.
pub(super) const MARGIN_PX: usize = 6;

/// Half a grey value of noise is the least that 8-bit frames are believed to have: quantisation alone is 0.3.
const LEAST_NOISE: f32 = 0.5;
/// The same of a cell.
const LEAST_CELL_NOISE: f32 = 0.25;
/// A wall's shade and its blur reach this far into the bore; there each row speaks for itself.
const WALL_SHADE_PX: usize = 10;
/// How far a row leans on its neighbours, as a share of its distance from that shade.
const LEANING: f32 = 0.35;
/// Rows that are averaged before the light is fitted to them.
const LIGHT_ROWS: usize = 4;

/// The rows of a picture between the walls, and the map to rows along the walls.
#[derive(Debug, Clone)]
pub(super) struct Bore {
    pub walls: Walls,
    pub width: usize,
    /// Rows `top .. bottom` of the picture.
    pub top: usize,
    pub bottom: usize,
    /// Mean height of the bore, px.
    pub mean_px: f64,
}

impl Bore {
    pub fn of(picture: &Picture, walls: Walls) -> Self {
        let (last, height) = ((picture.width() - 1) as f64, picture.height());
        // Walls may bend: their highest and lowest places are at the ends or near the middle.
        let columns = [0.0, last / 4.0, last / 2.0, 0.75 * last, last];
        let highest = columns.map(|u| walls.upper.inner.at(u)).into_iter().fold(f64::INFINITY, f64::min) - MARGIN_PX as f64;
        let lowest = columns.map(|u| walls.lower.inner.at(u)).into_iter().fold(f64::NEG_INFINITY, f64::max) + MARGIN_PX as f64;
        let top = (highest.floor().max(0.0) as usize).min(height - 1);
        let bottom = (lowest.ceil().max(0.0) as usize + 1).min(height);
        Self { walls, width: picture.width(), top, bottom: bottom.max(top + 1), mean_px: walls.bore_px(last / 2.0) }
    }

    pub fn height(&self) -> usize {
        self.bottom - self.top
    }

    /// Rows of the table along the walls: the bore with its margin.
    fn table_rows(&self) -> usize {
        self.mean_px.ceil() as usize + 2 * MARGIN_PX + 1
    }

    /// Row of the picture of table row `t` in column `u`.
    fn v_of(&self, t: f64, u: f64) -> f64 {
        self.walls.upper.inner.at(u) + (t - MARGIN_PX as f64) * self.walls.bore_px(u) / self.mean_px
    }
}

/// One column of the bore.
#[derive(Debug)]
struct Column {
    /// Row of the upper wall's inner line.
    inner_v: f64,
    bore_px: f64,
    /// The light's three terms across the bore.
    light: [f32; ACROSS],
    /// The light by the water beside the capillary, where it stands for what is known: at table row 0, and more per row.
    beside: [f32; 2],
}

impl Column {
    /// Table row of picture row `v`.
    fn t_of(&self, v: f64, mean_px: f64) -> f64 {
        (v - self.inner_v) * mean_px / self.bore_px + MARGIN_PX as f64
    }
}

/// The specimen's window with the empty bore taken away. Light taken away counts positive.
#[derive(Debug, Default)]
pub(super) struct Contrast {
    /// In standard deviations of a pixel's noise, mean of the colours. Near the walls the doubt about their place counts as
    /// noise: for finding the specimen.
    pub lightness: Plane,
    /// Blue against red, in standard deviations: yellowish tissue that is hardly darker than the light. Empty for grey.
    pub colour: Vec<f32>,
    /// The share of light taken away, in units in which it equals `lightness` in mid-bore. A specimen before the dark line of
    /// a wall takes the same share as beside it, so its edge goes on there: for placing the edge.
    pub darkness: Plane,
    /// Darkness where no light is left.
    pub all_light: f32,
    /// Noise of a pixel, grey values, mean of the colours.
    pub noise_grey: f64,
}

/// Finds the empty bore and takes it away; keeps its memory from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Background {
    table: Table,
    /// Grey over light of every cell, and smoothed along the capillary.
    even: Vec<f32>,
    smooth: Vec<f32>,
    lit: Vec<f32>,
    /// Level of each row, and how steeply it changes from row to row.
    profile: Vec<f32>,
    /// Cells that agree with it.
    support: Vec<f32>,
    slope: Vec<f32>,
    scratch: Vec<f32>,
    /// What every column has of its own.
    columns: Vec<Column>,
    before_row: Vec<f32>,
    /// Lent to [`Before`] while a colour is read.
    beside: Beside,
    pub contrast: Contrast,
}

impl Background {
    /// Fills [`Background::contrast`] for the bore's window.
    pub fn take_away(&mut self, bore: &Bore, picture: &Picture, reference: Option<&Reference>) {
        let colours = picture.colours();
        let size = bore.width * bore.height();
        self.contrast.lightness.reset(bore);
        self.contrast.darkness.reset(bore);
        self.contrast.colour.clear();
        self.contrast.colour.resize(if colours == 3 { size } else { 0 }, 0.0);
        (self.contrast.noise_grey, self.contrast.all_light) = (0.0, 0.0);
        for channel in 0..colours {
            let before = if let Some(r) = reference {
                Before::Picture { plane: r.plane(channel), bore: Bore { walls: r.walls(), ..bore.clone() } }
            } else {
                let mut beside = std::mem::take(&mut self.beside);
                beside.read(bore, &picture.planes()[channel], picture.height());
                Before::Beside(beside)
            };
            self.table.fill(bore, &picture.planes()[channel], &before);
            let light = self.estimate();
            let noise = self.noise(bore, &picture.planes()[channel], &before);
            self.contrast.noise_grey += f64::from(noise) / colours as f64;
            self.subtract(bore, picture, channel, &light, noise, &before);
            if let Before::Beside(beside) = before {
                self.beside = beside;
            }
        }
    }

    /// Fits the light and leaves the level of each row in `profile`.
    fn estimate(&mut self) -> Light {
        let mut light = Light::even();
        self.even_out(&light);
        let mut sigma = self.roughness();
        self.brightest();
        // Each round believes the estimate more: from 2 % of the level down to the noise alone.
        for tolerance in [0.02, 0.01, 0.0] {
            self.slide_to_modes(sigma);
            light = self.fit_light(&light, |level| (tolerance * level).max(2.5 * sigma));
            self.even_out(&light);
            sigma = self.spread(sigma);
        }
        self.slide_to_modes(sigma);
        light
    }

    /// Divides the light out of the table.
    fn even_out(&mut self, light: &Light) {
        light.over(&self.table, &mut self.lit);
        self.even.clear();
        self.even.extend(self.table.values.iter().zip(&self.lit).map(|(grey, light)| grey / light));
    }

    /// Noise of a cell by the differences of neighbours. Their lower quartile: a specimen's texture fills the upper half.
    fn roughness(&mut self) -> f32 {
        let cols = self.table.cols;
        self.scratch.clear();
        self.scratch.extend(self.even.chunks_exact(cols).flat_map(|row| row.windows(2).step_by(2).map(|pair| (pair[1] - pair[0]).abs())));
        // A quarter of normal numbers lies within 0.3186 standard deviations; a difference has two noises.
        (quantile(&mut self.scratch, 0.25) / (0.3186 * std::f32::consts::SQRT_2)).max(LEAST_CELL_NOISE)
    }

    /// First level of each row: that of its brightest cells. Neighbours together: a bright speck is narrow.
    fn brightest(&mut self) {
        let cols = self.table.cols;
        let reach = (cols / 64).max(1);
        self.profile.clear();
        for row in self.even.chunks_exact(cols) {
            self.smooth.clear();
            let mut sum: f32 = row[..reach.min(cols)].iter().sum();
            for k in 0..cols {
                if k + reach < cols {
                    sum += row[k + reach];
                }
                if k > reach {
                    sum -= row[k - reach - 1];
                }
                let n = (k + reach + 1).min(cols) - k.saturating_sub(reach);
                self.smooth.push(sum / n as f32);
            }
            // A specimen that nearly fills the picture leaves some 4 % of a row, and what it leaves must not pass for brighter than empty.
            self.profile.push(quantile(&mut self.smooth, 0.98).max(1.0));
        }
    }

    /// Slides each row's level to the mode beside it: a body that is nearly as bright as the light and fills its row must not
    /// become the background.
    fn slide_to_modes(&mut self, sigma: f32) {
        self.support.clear();
        for (row, level) in self.even.chunks_exact(self.table.cols).zip(&mut self.profile) {
            let first = *level;
            let mut support = 0.0;
            for _ in 0..3 {
                let (mut sum, mut n) = (0.0f32, 0.0f32);
                for &e in row {
                    let near = f32::from((e - *level).abs() <= 2.5 * sigma);
                    sum += near * (e - first);
                    n += near;
                }
                if n > 0.0 {
                    *level = (first + sum / n).clamp(first - sigma, first + sigma);
                }
                support = n;
            }
            *level = level.max(1.0);
            self.support.push(support);
        }
        self.lean_on_neighbours();
    }

    /// Far from the walls the glass changes slowly from row to row: there a row that a specimen fills leans on its neighbours
    /// by a weighed straight line through them. The nearer to a wall, the fewer neighbours.
    fn lean_on_neighbours(&mut self) {
        let rows = self.table.rows;
        self.scratch.clear();
        self.scratch.extend_from_slice(&self.profile);
        for t in 0..rows {
            let from_wall = t.min(rows - 1 - t).saturating_sub(MARGIN_PX + WALL_SHADE_PX);
            let reach = (from_wall as f32 * LEANING) as usize;
            if reach < 2 {
                continue;
            }
            let (mut w0, mut w1, mut w2, mut y0, mut y1) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for other in t - reach..=t + reach {
                let x = (other as f32 - t as f32) / (reach as f32 + 1.0);
                let weight = self.support[other] * self.support[other] * (1.0 - x * x);
                let y = self.scratch[other] - self.scratch[t];
                w0 += weight;
                w1 += weight * x;
                w2 += weight * x * x;
                y0 += weight * y;
                y1 += weight * x * y;
            }
            let det = w0 * w2 - w1 * w1;
            if det > 1e-3 * w0 * w0 {
                self.profile[t] = (self.scratch[t] + (y0 * w2 - y1 * w1) / det).max(1.0);
            }
        }
    }

    fn fit_light(&self, before: &Light, tolerance: impl Fn(f32) -> f32) -> Light {
        let (rows, cols) = (self.table.rows, self.table.cols);
        let mut normal = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut right = SVector::<f64, TERMS>::zeros();
        let mut seen = 0.0f64;
        // Two rows of the glass on either side belong to the walls, whose darkness says little about the light.
        let mut t = MARGIN_PX + 2;
        while t + LIGHT_ROWS + MARGIN_PX + 2 <= rows {
            let y = self.table.y(t as f64 + (LIGHT_ROWS - 1) as f64 / 2.0);
            let level = self.profile[t..t + LIGHT_ROWS].iter().sum::<f32>() / LIGHT_ROWS as f32;
            let reach = tolerance(level);
            for k in (t / LIGHT_ROWS % 2..cols).step_by(2) {
                let ratio = (t..t + LIGHT_ROWS).map(|t| f64::from(self.table.values[t * cols + k] / self.profile[t])).sum::<f64>()
                    / LIGHT_ROWS as f64;
                let basis = Light::basis(self.table.x(k), y);
                seen += 1.0;
                // Rows together have half the noise of one.
                let off = (ratio - before.terms.dot(&basis)).abs() * f64::from(level / (0.6 * reach));
                if off < 1.5 {
                    let weight = 1.0 / (1.0 + off * off);
                    for i in 0..TERMS {
                        for j in 0..=i {
                            normal[(i, j)] += weight * basis[i] * basis[j];
                        }
                    }
                    right += weight * ratio * basis;
                }
            }
            t += LIGHT_ROWS;
        }
        normal.fill_upper_triangle_with_lower_triangle();
        // A hundredth of all cells pulls towards the light as it was believed, which decides only where nothing was seen.
        let pull = 0.01 * seen.max(1.0);
        for i in 0..TERMS {
            normal[(i, i)] += pull;
        }
        right += pull * before.terms;
        Light { terms: normal.cholesky().map_or(before.terms, |c| c.solve(&right)) }
    }

    /// Noise of a cell by the distances of those that agree with the estimate, which is known to be `sigma` or less.
    fn spread(&mut self, sigma: f32) -> f32 {
        let cols = self.table.cols;
        let inner = MARGIN_PX + 2..self.table.rows.saturating_sub(MARGIN_PX + 2);
        self.scratch.clear();
        for t in inner {
            let level = self.profile[t];
            self.scratch.extend(self.even[t * cols..(t + 1) * cols].iter().map(|e| (e - level).abs()).filter(|off| *off <= 3.0 * sigma));
        }
        (quantile(&mut self.scratch, 0.5) / 0.6745).clamp(LEAST_CELL_NOISE, sigma.max(LEAST_CELL_NOISE))
    }

    /// Noise of a pixel, grey values: one pixel of each cell that shows the empty bore, where the level is even.
    fn noise(&mut self, bore: &Bore, plane: &[u8], before: &Before) -> f32 {
        let (rows, cols) = (self.table.rows, self.table.cols);
        self.scratch.clear();
        let sigma = self.spread(f32::MAX.sqrt()).min(self.roughness().max(LEAST_CELL_NOISE) * 2.0);
        self.scratch.clear();
        for t in (MARGIN_PX + rows / 8..rows.saturating_sub(MARGIN_PX + rows / 8)).step_by(2) {
            for k in 0..cols {
                let at = t * cols + k;
                if (self.even[at] - self.profile[t]).abs() > 2.5 * sigma {
                    continue;
                }
                let u = (k * self.table.stride + self.table.stride / 2).min(bore.width - 1);
                let v = bore.v_of(t as f64, u as f64).round();
                if v < bore.top as f64 || v >= bore.bottom as f64 {
                    continue;
                }
                let level = self.profile[t] * self.lit[at] * before.at(t as f64, u) / self.table.typical;
                self.scratch.push((f32::from(plane[v as usize * bore.width + u]) - level).abs());
            }
        }
        (quantile(&mut self.scratch, 0.5) / 0.6745).max(LEAST_NOISE)
    }

    /// Adds one colour's contrast to that of the others.
    fn subtract(&mut self, bore: &Bore, picture: &Picture, channel: usize, light: &Light, noise: f32, before: &Before) {
        const MISPLACED_PX: f32 = 0.2;
        // Where less light than this falls, in noises of a pixel, the share that is missing is not known.
        const TELLING: f32 = 8.0;
        let colours = picture.colours();
        let share = 1.0 / colours as f32;
        // Blue counts up, red down.
        let colour_sign = if colours == 3 { channel as f32 - 1.0 } else { 0.0 };
        let rows = self.table.rows;
        self.slope.clear();
        self.slope.extend((0..rows).map(|t| (self.profile[(t + 1).min(rows - 1)] - self.profile[t.saturating_sub(1)]).abs() / 2.0));
        self.columns.clear();
        self.columns.extend((0..bore.width).map(|u| Column {
            inner_v: bore.walls.upper.inner.at(u as f64),
            bore_px: bore.walls.bore_px(u as f64),
            light: light.column(2.0 * u as f64 / (bore.width.max(2) - 1) as f64 - 1.0),
            beside: match before {
                Before::Picture { .. } => [1.0, 0.0],
                Before::Beside(beside) => beside.columns[u].map(|light| light / self.table.typical),
            },
        }));
        let mid_level = self.profile[rows / 2];
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
            self.before_row.clear();
            if let Before::Picture { .. } = before {
                let typical = self.table.typical;
                let t = |u: usize| self.columns[u].t_of(row_v, bore.mean_px);
                self.before_row.extend((0..bore.width).map(|u| before.at(t(u), u) / typical));
            }
            for u in 0..bore.width {
                let column = &self.columns[u];
                let t = (column.t_of(row_v, bore.mean_px) as f32).clamp(0.0, last);
                let (t0, part) = (t as usize, t.fract());
                let t1 = (t0 + 1).min(rows - 1);
                let y = t * per_row - 1.0;
                let [c0, c1, c2] = column.light;
                let known = (column.beside[0] + t * column.beside[1]) * self.before_row.get(u).copied().unwrap_or(1.0);
                let lit = (c0 + y * c1 + (1.5 * y * y - 0.5) * c2).max(0.1) * known;
                let level = ((self.profile[t0] + part * (self.profile[t1] - self.profile[t0])) * lit).max(1.0);
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

/// What one colour of the empty bore is known to look like before the frame's own bore is read.
enum Before<'a> {
    /// The empty capillary's picture, and this frame's bore between that picture's walls.
    Picture { plane: &'a [u8], bore: Bore },
    /// Without one, the light beside the capillary.
    Beside(Beside),
}

impl Before<'_> {
    /// Grey at table row `t` in column `u`; beyond the picture its border goes on.
    fn at(&self, t: f64, u: usize) -> f32 {
        match self {
            Self::Picture { plane, bore } => {
                let width = bore.width;
                let last = plane.len() / width - 1;
                let v = bore.v_of(t, u as f64).clamp(0.0, last as f64);
                let (v0, part) = (v as usize, v.fract() as f32);
                let (a, b) = (f32::from(plane[v0 * width + u]), f32::from(plane[(v0 + 1).min(last) * width + u]));
                a + part * (b - a)
            }
            Self::Beside(beside) => beside.columns[u][0] + t as f32 * beside.columns[u][1],
        }
    }
}

/// The light along the capillary by the water above and below it, straight across in between.
#[derive(Debug, Default)]
struct Beside {
    /// Grey at table row 0, and more per row.
    columns: Vec<[f32; 2]>,
    /// One block's pixels on one side.
    greys: Vec<u8>,
}

impl Beside {
    /// Blocks of columns whose middle grey is taken; between them it is straight.
    const BLOCKS: usize = 24;
    /// Fewer pixels tell no block's light.
    const LEAST_SEEN: usize = 16;

    /// Reads one colour's light off the picture.
    fn read(&mut self, bore: &Bore, plane: &[u8], height: usize) {
        let w = bore.width;
        let band = (0.4 * bore.mean_px) as usize;
        let mut blocks = [[0.0f32; 2]; Self::BLOCKS];
        let mut seen = [true; 2];
        for (block, levels) in blocks.iter_mut().enumerate() {
            let columns = block * w / Self::BLOCKS..((block + 1) * w / Self::BLOCKS).max(block * w / Self::BLOCKS + 1).min(w);
            let mid = (columns.start + columns.end) as f64 / 2.0;
            // Beyond the glass and its blur.
            let above = (bore.walls.upper.outer.at(mid) - MARGIN_PX as f64).clamp(0.0, height as f64) as usize;
            let below = (bore.walls.lower.outer.at(mid) + MARGIN_PX as f64).clamp(0.0, height as f64) as usize;
            for (side, rows) in [above.saturating_sub(band)..above, below..(below + band).min(height)].into_iter().enumerate() {
                self.greys.clear();
                for v in rows.step_by(3) {
                    self.greys.extend(plane[v * w + columns.start..v * w + columns.end].iter().step_by(2));
                }
                seen[side] &= self.greys.len() >= Self::LEAST_SEEN;
                levels[side] = middle_half(&mut self.greys);
            }
        }
        let sides = [0, 1].map(|side| blocks.map(|levels| levels[side]));
        // Each side has a level of its own, which says nothing: above and below the lamp need not be the same, and a row's
        // level is found in the bore.
        let shapes = sides.map(|side| {
            let mean = side.iter().sum::<f32>() / Self::BLOCKS as f32;
            side.map(|grey| grey * 128.0 / mean.max(1.0))
        });
        let [above, below] = match seen {
            [true, true] => shapes,
            [true, false] => [shapes[0]; 2],
            [false, true] => [shapes[1]; 2],
            [false, false] => [[128.0; Self::BLOCKS]; 2],
        };
        let at = |side: &[f32; Self::BLOCKS], u: usize| {
            let x = (u as f32 + 0.5) * Self::BLOCKS as f32 / w as f32 - 0.5;
            let k = (x.max(0.0) as usize).min(Self::BLOCKS - 2);
            (side[k] + (x - k as f32) * (side[k + 1] - side[k])).max(1.0)
        };
        let rows = (bore.table_rows() - 1) as f32;
        self.columns.clear();
        self.columns.extend((0..w).map(|u| {
            let (a, b) = (at(&above, u), at(&below, u));
            // The bands' middles lie this much beyond the table on either side, as a share of its height.
            let beyond = |wall: f64| ((wall + band as f64 / 2.0) / f64::from(rows)) as f32;
            let mid = u as f64;
            let from = beyond(bore.walls.upper.inner.at(mid) - bore.walls.upper.outer.at(mid));
            let upto = beyond(bore.walls.lower.outer.at(mid) - bore.walls.lower.inner.at(mid));
            let slope = (b - a) / (1.0 + from + upto);
            [(a + from * slope).max(1.0), slope / rows]
        }));
    }
}

/// The mean of the middle half: as sure as a mean, and as indifferent to specks as a median. 0 for none.
fn middle_half(greys: &mut [u8]) -> f32 {
    greys.sort_unstable();
    let middle = &greys[greys.len() / 4..greys.len() - greys.len() / 4];
    middle.iter().map(|&g| f32::from(g)).sum::<f32>() / middle.len().max(1) as f32
}

/// The smooth unevenness of the light over `x, y` in -1..1.
struct Light {
    terms: SVector<f64, TERMS>,
}

impl Light {
    fn even() -> Self {
        let mut terms = SVector::zeros();
        terms[0] = 1.0;
        Self { terms }
    }

    fn basis(x: f64, y: f64) -> SVector<f64, TERMS> {
        // Legendre polynomials: nearly orthogonal over the bore, so that the normal equations stay well conditioned.
        let (x2, y2) = (x * x, y * y);
        let px = [1.0, x, 1.5 * x2 - 0.5, x * (2.5 * x2 - 1.5), (35.0 * x2 * x2 - 30.0 * x2 + 3.0) / 8.0];
        let py = [1.0, y, 1.5 * y2 - 0.5];
        SVector::from_fn(|i, _| px[i / ACROSS] * py[i % ACROSS])
    }

    /// The three terms across the bore in the column at `x`.
    fn column(&self, x: f64) -> [f32; ACROSS] {
        let along = Self::basis(x, 0.0);
        // At y = 0 the terms' own factors are 1, 0 and -1/2: those along the capillary are read from the first.
        std::array::from_fn(|j| (0..ALONG).map(|i| self.terms[i * ACROSS + j] * along[i * ACROSS]).sum::<f64>() as f32)
    }

    /// The light at every cell of a table, never less than a tenth.
    fn over(&self, table: &Table, grid: &mut Vec<f32>) {
        grid.clear();
        grid.resize(table.rows * table.cols, 0.0);
        for k in 0..table.cols {
            let [c0, c1, c2] = self.column(table.x(k));
            for t in 0..table.rows {
                let y = table.y(t as f64) as f32;
                grid[t * table.cols + k] = (c0 + y * c1 + (1.5 * y * y - 0.5) * c2).max(0.1);
            }
        }
    }
}

/// The window in cells: the walls level, one row per pixel across the bore, some columns together.
#[derive(Debug, Default)]
struct Table {
    rows: usize,
    cols: usize,
    stride: usize,
    width: usize,
    /// `values[t * cols + k]`: mean grey over what is known before, times the typical grey of that.
    values: Vec<f32>,
    typical: f32,
}

impl Table {
    fn fill(&mut self, bore: &Bore, plane: &[u8], before: &Before) {
        self.width = bore.width;
        // 256 cells decide a row's level to a twentieth of the noise; more only cost time.
        self.stride = (bore.width / 256).max(1);
        (self.rows, self.cols) = (bore.table_rows(), bore.width / self.stride);
        self.values.clear();
        self.values.resize(self.rows * self.cols, 0.0);
        let mut sum = 0.0f64;
        for k in 0..self.cols {
            let columns = k * self.stride..(k + 1) * self.stride;
            let mid = (columns.start + columns.end - 1) as f64 / 2.0;
            for t in 0..self.rows {
                let v = bore.v_of(t as f64, mid).clamp(bore.top as f64, (bore.bottom - 1) as f64);
                let (v0, part) = (v as usize, v.fract() as f32);
                let v1 = (v0 + 1).min(bore.bottom - 1);
                let mean = |row: usize| {
                    let seen = &plane[row * bore.width..][columns.clone()];
                    seen.iter().map(|&p| u32::from(p)).sum::<u32>() as f32 / seen.len() as f32
                };
                let (a, b) = (mean(v0), mean(v1));
                let before = columns.clone().map(|u| before.at(t as f64, u)).sum::<f32>() / columns.len() as f32;
                sum += f64::from(before);
                self.values[t * self.cols + k] = (a + part * (b - a)) / before.max(1.0);
            }
        }
        self.typical = ((sum / self.values.len() as f64) as f32).max(1.0);
        self.values.iter_mut().for_each(|value| *value *= self.typical);
    }

    fn x(&self, k: usize) -> f64 {
        let mid = (k * self.stride) as f64 + (self.stride - 1) as f64 / 2.0;
        2.0 * mid / (self.width.max(2) - 1) as f64 - 1.0
    }

    fn y(&self, t: f64) -> f64 {
        2.0 * t / (self.rows - 1) as f64 - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::WallSettings;
    use super::super::synthetic::{Noise, blurred_step};
    use super::super::walls;
    use super::*;
    use crate::frame::{PixelFormat, RawFrame};

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
    fn contrasts(reference: Option<&Reference>, fall: f64) -> (f32, f32) {
        let picture = picture(true, (0.0, 0.0), fall, 1);
        let bore = Bore::of(&picture, walls::WallFinder::default().find(&picture, &WallSettings::default()).unwrap());
        let mut background = Background::default();
        background.take_away(&bore, &picture, reference);
        let lightness = &background.contrast.lightness;
        // The reference's own noise counts too, halved or not by how it lies between rows; so does what the light's course
        // between its blocks is off by where it falls off.
        let most = if fall > 0.0 { 3.0 } else { 1.65 };
        let least_and_most = if reference.is_some() { (1.8, 2.2) } else { (1.4, most) };
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
        let reference = Reference::new(picture(false, (1.5, 0.004), 0.0, 2), &WallSettings::default()).unwrap();
        let (outside, inside) = contrasts(Some(&reference), 0.0);
        assert!(outside.abs() < 0.3 && inside > 20.0, "outside {outside}, inside {inside}");
    }
}
