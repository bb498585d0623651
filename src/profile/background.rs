//! The bore as it would look empty, estimated from the frame itself.
//!
//! ```text
//!   B(u, t) = a(t) * p(u, t)        t: rows below the upper wall, along the capillary's own tilt
//!             |      '- smooth unevenness of the light: a polynomial of low order
//!             '- what the glass does across the bore, the same in every column: dark towards the walls
//! ```
//! The light's course along the capillary is read first from the water outside it, where no specimen is. A specimen darkens
//! the columns that it covers, so the brightest columns show the empty bore: they give each row its first level, from where it
//! slides to the mode of all columns next to it; the polynomial is then fitted to the pixels that agree. Those columns give the
//! noise as well.

use super::plane::{Plane, quantile};
use super::{Picture, Walls};
use nalgebra::{SMatrix, SVector};

/// Orders of the light's polynomial along and across the capillary; 5 x 3 terms.
const ALONG: usize = 5;
const ACROSS: usize = 3;
const TERMS: usize = ALONG * ACROSS;

/// Rows of glass that the window keeps on each side of the bore.
pub(super) const MARGIN_PX: usize = 6;

/// One grey value of noise is the least that 8-bit frames are believed to have: quantisation alone is 0.3.
const LEAST_NOISE: f32 = 0.5;

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
        let last = (picture.width() - 1) as f64;
        let highest = walls.upper.inner.at(0.0).min(walls.upper.inner.at(last)) - MARGIN_PX as f64;
        let lowest = walls.lower.inner.at(0.0).max(walls.lower.inner.at(last)) + MARGIN_PX as f64;
        let top = highest.floor().max(0.0) as usize;
        let bottom = (lowest.ceil().max(0.0) as usize + 1).min(picture.height());
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

    /// Table row of picture row `v` in column `u`.
    fn t_of(&self, v: f64, u: f64) -> f64 {
        (v - self.walls.upper.inner.at(u)) * self.mean_px / self.walls.bore_px(u) + MARGIN_PX as f64
    }
}

/// What one colour shows behind the specimen.
pub(super) struct Background {
    /// Expected grey of each pixel of the window.
    pub level: Plane,
    /// Its standard deviation: noise, and near the walls also what 0.15 px of misplaced wall would make.
    pub sigma: Plane,
    /// Noise of a pixel where the light is even, grey values.
    pub noise: f32,
    /// Grey of the bore's middle where the light is even.
    pub mid_level: f32,
    /// Columns of the picture that are believed to show the empty bore.
    pub free: Vec<bool>,
}

/// Estimates the empty bore of one colour of a picture; `seen` is its window.
pub(super) fn estimate(bore: &Bore, picture: &Picture, channel: usize, seen: &Plane) -> Background {
    let table = Table::of(bore, seen);
    let mut light = Light::outside(bore, picture, channel);
    let mut lit = light.over(&table);
    let free = table.brightest_columns(&lit);
    let mut sigma = table.spread(&free, &table.medians(&free, &lit), &lit);
    // Each round believes the estimate more: from 2 % of the level down to the noise alone.
    for tolerance in [0.02, 0.01, 0.0] {
        let profile = table.modes(&table.medians(&free, &lit), &lit, sigma);
        light = table.fit_light(&profile, &light, |level| (tolerance * level).max(2.5 * sigma));
        lit = light.over(&table);
        sigma = table.spread(&free, &table.medians(&free, &lit), &lit).min(sigma);
    }
    let profile = table.modes(&table.medians(&free, &lit), &lit, sigma);
    let free = (0..bore.width).map(|u| free.binary_search(&(u / table.stride)).is_ok()).collect();
    table.render(bore, &profile, &light, sigma, free)
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

    /// The light along the capillary by the water above and below it: a parabola through the medians of column blocks.
    fn outside(bore: &Bore, picture: &Picture, channel: usize) -> Self {
        const BLOCKS: usize = 24;
        let (w, h) = (picture.width(), picture.height());
        let plane = &picture.planes()[channel];
        let band = (0.4 * bore.mean_px) as usize;
        let mut normal = SMatrix::<f64, 4, 4>::zeros();
        let mut right = SVector::<f64, 4>::zeros();
        for block in 0..BLOCKS {
            let columns = block * w / BLOCKS..(block + 1) * w / BLOCKS;
            let mid = (columns.start + columns.end) as f64 / 2.0;
            // Beyond the glass and its blur.
            let above = (bore.walls.upper.outer.at(mid) - MARGIN_PX as f64).clamp(0.0, h as f64) as usize;
            let below = (bore.walls.lower.outer.at(mid) + MARGIN_PX as f64).clamp(0.0, h as f64) as usize;
            for (side, rows) in [above.saturating_sub(band)..above, below..(below + band).min(h)].into_iter().enumerate() {
                let mut greys: Vec<f32> = Vec::new();
                for v in rows.step_by(3) {
                    greys.extend(plane[v * w + columns.start..v * w + columns.end].iter().step_by(2).map(|&p| f32::from(p)));
                }
                if greys.len() < 16 {
                    continue;
                }
                let grey = f64::from(quantile(&mut greys, 0.5));
                let x = 2.0 * mid / w as f64 - 1.0;
                // Each side has a level of its own: above and below the lamp need not be the same.
                let basis = SVector::<f64, 4>::from([f64::from(side == 0), f64::from(side == 1), x, 1.5 * x * x - 0.5]);
                normal += basis * basis.transpose();
                right += basis * grey;
            }
        }
        for i in 0..4 {
            normal[(i, i)] += 1e-3;
        }
        let mut light = Self::even();
        if let Some(fit) = normal.cholesky().map(|c| c.solve(&right)) {
            let level = fit[0].max(fit[1]);
            if level > 1.0 {
                light.terms[ACROSS] = (fit[2] / level).clamp(-0.5, 0.5);
                light.terms[2 * ACROSS] = (fit[3] / level).clamp(-0.5, 0.5);
            }
        }
        light
    }

    fn basis(x: f64, y: f64) -> SVector<f64, TERMS> {
        // Legendre polynomials: nearly orthogonal over the bore, so that the normal equations stay well conditioned.
        let (x2, y2) = (x * x, y * y);
        let px = [1.0, x, 1.5 * x2 - 0.5, x * (2.5 * x2 - 1.5), (35.0 * x2 * x2 - 30.0 * x2 + 3.0) / 8.0];
        let py = [1.0, y, 1.5 * y2 - 0.5];
        SVector::from_fn(|i, _| px[i / ACROSS] * py[i % ACROSS])
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        self.terms.dot(&Self::basis(x, y))
    }

    /// The light at every value of a table, never less than a tenth.
    fn over(&self, table: &Table) -> Vec<f32> {
        let columns: Vec<_> = (0..table.cols).map(|k| Self::basis(table.x((k * table.stride) as f64), 0.0)).collect();
        let mut grid = Vec::with_capacity(table.values.len());
        for t in 0..table.rows {
            // Along one row only the terms along the capillary are left.
            let y = table.y(t as f64);
            let row: [f64; ALONG] = std::array::from_fn(|i| (0..ACROSS).map(|j| self.terms[i * ACROSS + j] * Self::basis(0.0, y)[j]).sum());
            grid.extend(columns.iter().map(|c| (0..ALONG).map(|i| row[i] * c[i * ACROSS]).sum::<f64>().max(0.1) as f32));
        }
        grid
    }
}

/// The window resampled so that the walls are level: every `STRIDE`-th column, one row per pixel across the bore.
struct Table {
    rows: usize,
    cols: usize,
    /// `values[t * cols + k]`, column `k` being picture column `k * stride`.
    values: Vec<f32>,
    width: usize,
    stride: usize,
}

impl Table {
    fn of(bore: &Bore, seen: &Plane) -> Self {
        // 400 columns decide a row's level to a twentieth of the noise; more only cost time.
        let stride = (bore.width / 400).max(1);
        let (rows, cols) = (bore.table_rows(), bore.width.div_ceil(stride));
        let mut values = vec![0.0; rows * cols];
        for t in 0..rows {
            for k in 0..cols {
                let u = (k * stride) as f64;
                values[t * cols + k] = seen.sample(u, bore.v_of(t as f64, u));
            }
        }
        Self { rows, cols, values, width: bore.width, stride }
    }

    fn x(&self, u: f64) -> f64 {
        2.0 * u / (self.width.max(2) - 1) as f64 - 1.0
    }

    fn y(&self, t: f64) -> f64 {
        2.0 * t / (self.rows - 1) as f64 - 1.0
    }

    /// The values of row `t` with the light's unevenness divided out.
    fn even_row(&self, t: usize, lit: &[f32], even: &mut Vec<f32>) {
        let row = t * self.cols..(t + 1) * self.cols;
        even.clear();
        even.extend(self.values[row.clone()].iter().zip(&lit[row]).map(|(grey, light)| grey / light));
    }

    /// The columns that are brightest as a whole, in ascending order.
    fn brightest_columns(&self, lit: &[f32]) -> Vec<usize> {
        let rows = MARGIN_PX + 2..self.rows.saturating_sub(MARGIN_PX + 2);
        let mut even = Vec::with_capacity(self.cols);
        let mut sums = vec![0.0f32; self.cols];
        for t in rows.clone() {
            self.even_row(t, lit, &mut even);
            for (sum, e) in sums.iter_mut().zip(&even) {
                *sum += e;
            }
        }
        // Neighbouring columns together: a bright speck is narrow.
        let reach = (self.cols / 100).max(1);
        let means: Vec<f32> = (0..self.cols)
            .map(|k| {
                let near = &sums[k.saturating_sub(reach)..(k + reach + 1).min(self.cols)];
                near.iter().sum::<f32>() / near.len() as f32
            })
            .collect();
        // A twentieth of the columns at least, and all that are within 1 % of the brightest.
        let bar = quantile(&mut means.clone(), 0.95).min(0.99 * quantile(&mut means.clone(), 0.98));
        (0..self.cols).filter(|&k| means[k] >= bar).collect()
    }

    /// First level of each row: its median over the columns believed to be free.
    fn medians(&self, free: &[usize], lit: &[f32]) -> Vec<f32> {
        let mut even = Vec::with_capacity(self.cols);
        (0..self.rows)
            .map(|t| {
                self.even_row(t, lit, &mut even);
                let mut greys: Vec<f32> = free.iter().map(|&k| even[k]).collect();
                quantile(&mut greys, 0.5).max(1.0)
            })
            .collect()
    }

    /// Slides each row's level to the mode beside it, by one standard deviation at most: a body that is nearly as bright as
    /// the light and fills its row must not become the background.
    fn modes(&self, from: &[f32], lit: &[f32], sigma: f32) -> Vec<f32> {
        let mut even = Vec::with_capacity(self.cols);
        from.iter()
            .enumerate()
            .map(|(t, &first)| {
                self.even_row(t, lit, &mut even);
                let mut level = first;
                for _ in 0..3 {
                    let near = even.iter().filter(|e| (*e - level).abs() <= 2.5 * sigma);
                    let (sum, n) = near.fold((0.0, 0), |(s, n), e| (s + e, n + 1));
                    if n > 0 {
                        level = (sum / n as f32).clamp(first - sigma, first + sigma);
                    }
                }
                level.max(1.0)
            })
            .collect()
    }

    fn fit_light(&self, profile: &[f32], before: &Light, tolerance: impl Fn(f32) -> f32) -> Light {
        let mut normal = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut right = SVector::<f64, TERMS>::zeros();
        let mut seen = 0.0f64;
        // Two rows of the glass on either side belong to the walls, whose darkness says little about the light.
        for t in (MARGIN_PX + 2..self.rows.saturating_sub(MARGIN_PX + 2)).step_by(2) {
            let level = profile[t];
            let reach = tolerance(level);
            for k in (t % 4..self.cols).step_by(4) {
                let ratio = f64::from(self.values[t * self.cols + k] / level);
                let basis = Light::basis(self.x((k * self.stride) as f64), self.y(t as f64));
                seen += 1.0;
                let off = (ratio - before.terms.dot(&basis)).abs() * f64::from(level / reach);
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
        }
        normal.fill_upper_triangle_with_lower_triangle();
        // A hundredth of all pixels pulls towards the light as it was believed, which decides only where nothing was seen.
        let pull = 0.01 * seen.max(1.0);
        for i in 0..TERMS {
            normal[(i, i)] += pull;
        }
        right += pull * before.terms;
        Light { terms: normal.cholesky().map_or(before.terms, |c| c.solve(&right)) }
    }

    /// Standard deviation of the free columns about the estimate, by their median distance.
    fn spread(&self, free: &[usize], profile: &[f32], lit: &[f32]) -> f32 {
        let mut off = Vec::with_capacity(free.len() * self.rows);
        let inner = self.rows.saturating_sub(2 * (MARGIN_PX + 2));
        for (t, level) in profile.iter().enumerate().skip(MARGIN_PX + 2).take(inner) {
            off.extend(free.iter().map(|k| t * self.cols + k).map(|at| (self.values[at] - level * lit[at]).abs()));
        }
        (quantile(&mut off, 0.5) / 0.6745).max(LEAST_NOISE)
    }

    fn render(&self, bore: &Bore, profile: &[f32], light: &Light, sigma: f32, free: Vec<bool>) -> Background {
        const MISPLACED_PX: f32 = 0.15;
        let slope: Vec<f32> =
            (0..self.rows).map(|t| (profile[(t + 1).min(self.rows - 1)] - profile[t.saturating_sub(1)]).abs() / 2.0).collect();
        let between = |of: &[f32], t: f64| {
            let t = t.clamp(0.0, (self.rows - 1) as f64);
            let (t0, part) = (t as usize, t.fract() as f32);
            of[t0] + part * (of[(t0 + 1).min(self.rows - 1)] - of[t0])
        };
        let mut level = Plane::filled(bore.width, bore.height(), bore.top, 0.0);
        let mut spread = level.clone();
        // The light changes so slowly that every eighth column is computed and the rest are interpolated.
        for v in 0..bore.height() {
            let row_v = (bore.top + v) as f64;
            let light_at = |u: usize| light.at(self.x(u as f64), self.y(bore.t_of(row_v, u as f64))) as f32;
            let (mut from, mut to) = (light_at(0), light_at(8));
            for u in 0..bore.width {
                if u > 0 && u % 8 == 0 {
                    (from, to) = (to, light_at(u + 8));
                }
                let t = bore.t_of(row_v, u as f64);
                let p = from + (to - from) * (u % 8) as f32 / 8.0;
                let at = v * bore.width + u;
                level.data[at] = between(profile, t) * p;
                spread.data[at] = (sigma * sigma + (MISPLACED_PX * between(&slope, t)).powi(2)).sqrt();
            }
        }
        Background { level, sigma: spread, noise: sigma, mid_level: profile[self.rows / 2], free }
    }
}
