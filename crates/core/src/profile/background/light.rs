//! The smooth unevenness of the light over the bore.

use super::bore::MARGIN_PX;
use super::table::Table;
use nalgebra::{SMatrix, SVector};

/// Orders of the light's polynomial along and across the capillary: 5 x 3 terms.
const ALONG: usize = 5;
pub(super) const ACROSS: usize = 3;
const TERMS: usize = ALONG * ACROSS;
/// Rows that are averaged before the light is fitted to them.
const LIGHT_ROWS: usize = 4;

/// The smooth unevenness of the light over `x, y` in -1..1.
pub(super) struct Light {
    terms: SVector<f64, TERMS>,
}

impl Light {
    pub fn even() -> Self {
        let mut terms = SVector::zeros();
        terms[0] = 1.0;
        Self { terms }
    }

    fn basis(x: f64, y: f64) -> SVector<f64, TERMS> {
        // Legendre polynomials are nearly orthogonal over the bore, so that the normal equations are well conditioned.
        let (x2, y2) = (x * x, y * y);
        let px = [1.0, x, 1.5 * x2 - 0.5, x * (2.5 * x2 - 1.5), (35.0 * x2 * x2 - 30.0 * x2 + 3.0) / 8.0];
        let py = [1.0, y, 1.5 * y2 - 0.5];
        SVector::from_fn(|i, _| px[i / ACROSS] * py[i % ACROSS])
    }

    /// The three terms across the bore in the column at `x`.
    pub fn column(&self, x: f64) -> [f32; ACROSS] {
        let along = Self::basis(x, 0.0);
        // At y = 0 the terms across are 1, 0 and -1/2; the terms along the capillary are read from the first.
        std::array::from_fn(|j| (0..ALONG).map(|i| self.terms[i * ACROSS + j] * along[i * ACROSS]).sum::<f64>() as f32)
    }

    /// The light in every cell of a table, at least a tenth.
    pub fn over(&self, table: &Table, grid: &mut Vec<f32>) {
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

    /// The light fitted to the cells that agree with this one. `levels` contains the level of each row of the table; a cell
    /// agrees if its difference from the level is less than the tolerance at that level.
    pub fn fitted(&self, table: &Table, levels: &[f32], tolerance: impl Fn(f32) -> f32) -> Self {
        let (rows, cols) = (table.rows, table.cols);
        let mut normal = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut right = SVector::<f64, TERMS>::zeros();
        let mut seen = 0.0f64;
        // Two rows of the glass on either side belong to the walls, whose darkness says little about the light.
        let mut t = MARGIN_PX + 2;
        while t + LIGHT_ROWS + MARGIN_PX + 2 <= rows {
            let y = table.y(t as f64 + (LIGHT_ROWS - 1) as f64 / 2.0);
            let level = levels[t..t + LIGHT_ROWS].iter().sum::<f32>() / LIGHT_ROWS as f32;
            let reach = tolerance(level);
            for k in (t / LIGHT_ROWS % 2..cols).step_by(2) {
                let ratio = (t..t + LIGHT_ROWS).map(|t| f64::from(table.values[t * cols + k] / levels[t])).sum::<f64>() / LIGHT_ROWS as f64;
                let basis = Self::basis(table.x(k), y);
                seen += 1.0;
                // Several rows together have half the noise of one.
                let off = (ratio - self.terms.dot(&basis)).abs() * f64::from(level / (0.6 * reach));
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
        // A hundredth of all cells pulls towards the previous light, which matters only where no cell agrees.
        let pull = 0.01 * seen.max(1.0);
        for i in 0..TERMS {
            normal[(i, i)] += pull;
        }
        right += pull * self.terms;
        Self { terms: normal.cholesky().map_or(self.terms, |c| c.solve(&right)) }
    }
}
