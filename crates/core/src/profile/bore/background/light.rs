//! The smooth unevenness of the light over the bore.

use super::table::Table;
use crate::profile::bore::MARGIN_PX;
use nalgebra::{SMatrix, SVector};

/// Orders of the light's polynomial along and across the capillary: 5 x 3 terms.
pub(super) const ALONG: usize = 5;
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

    /// The polynomials along the capillary. Legendre polynomials are nearly orthogonal over the bore, so that the normal
    /// equations are well conditioned.
    pub fn along(x: f64) -> [f64; ALONG] {
        let x2 = x * x;
        [1.0, x, 1.5 * x2 - 0.5, x * (2.5 * x2 - 1.5), (35.0 * x2 * x2 - 30.0 * x2 + 3.0) / 8.0]
    }

    fn across(y: f64) -> [f64; ACROSS] {
        [1.0, y, 1.5 * y * y - 0.5]
    }

    /// The three terms across the bore in a column with these polynomials along the capillary.
    pub fn column(&self, along: &[f64; ALONG]) -> [f32; ACROSS] {
        std::array::from_fn(|j| (0..ALONG).map(|i| self.terms[i * ACROSS + j] * along[i]).sum::<f64>() as f32)
    }

    /// The light in every cell of a table, at least a tenth. `columns` is memory.
    pub fn over(&self, table: &Table, columns: &mut [Vec<f32>; ACROSS], grid: &mut Vec<f32>) {
        columns.iter_mut().for_each(Vec::clear);
        for along in &table.along {
            columns.iter_mut().zip(self.column(along)).for_each(|(terms, term)| terms.push(term));
        }
        grid.clear();
        let [c0, c1, c2] = columns;
        for t in 0..table.rows {
            let [_, y1, y2] = Self::across(table.y(t as f64)).map(|y| y as f32);
            grid.extend(c0.iter().zip(&*c1).zip(&*c2).map(|((c0, c1), c2)| (c0 + y1 * c1 + y2 * c2).max(0.1)));
        }
    }

    /// The light fitted to the cells that agree with this one. `levels` contains the level of each row of the table; a cell
    /// agrees if its difference from the level is less than the tolerance at that level.
    pub fn fitted(&self, table: &Table, levels: &[f32], tolerance: impl Fn(f32) -> f32) -> Self {
        let (rows, cols) = (table.rows, table.cols);
        let mut normal = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut right = SVector::<f64, TERMS>::zeros();
        let mut seen = 0usize;
        // Two rows of the glass on either side belong to the walls, whose darkness says little about the light.
        let mut t = MARGIN_PX + 2;
        while t + LIGHT_ROWS + MARGIN_PX + 2 <= rows {
            let across = Self::across(table.y(t as f64 + (LIGHT_ROWS - 1) as f64 / 2.0));
            let level = levels[t..t + LIGHT_ROWS].iter().sum::<f32>() / LIGHT_ROWS as f32;
            // Several rows together have half the noise of one.
            let unit = f64::from(level / (0.6 * tolerance(level)));
            let shares: [f32; LIGHT_ROWS] = std::array::from_fn(|row| 1.0 / (LIGHT_ROWS as f32 * levels[t + row]));
            let values: [&[f32]; LIGHT_ROWS] = std::array::from_fn(|row| &table.values[(t + row) * cols..][..cols]);
            let expected: [f64; ALONG] = std::array::from_fn(|i| (0..ACROSS).map(|j| self.terms[i * ACROSS + j] * across[j]).sum());
            // Along one row y is the same, so that only the products along the capillary are summed cell by cell.
            let (mut products, mut sums) = ([[0.0f64; ALONG]; ALONG], [0.0f64; ALONG]);
            for k in (t / LIGHT_ROWS % 2..cols).step_by(2) {
                let along = &table.along[k];
                let ratio = f64::from(values.iter().zip(&shares).map(|(row, share)| row[k] * share).sum::<f32>());
                let off = (ratio - expected.iter().zip(along).map(|(e, x)| e * x).sum::<f64>()) * unit;
                let weight = if off.abs() < 1.5 { 1.0 / (1.0 + off * off) } else { 0.0 };
                for i in 0..ALONG {
                    let share = weight * along[i];
                    sums[i] += share * ratio;
                    (0..=i).for_each(|j| products[i][j] += share * along[j]);
                }
                seen += 1;
            }
            for at in 0..TERMS {
                let (i, y) = (at / ACROSS, across[at % ACROSS]);
                right[at] += sums[i] * y;
                for other in 0..=at {
                    normal[(at, other)] += products[i][other / ACROSS] * y * across[other % ACROSS];
                }
            }
            t += LIGHT_ROWS;
        }
        normal.fill_upper_triangle_with_lower_triangle();
        // A hundredth of all cells pulls towards the previous light, which matters only where no cell agrees.
        let pull = 0.01 * seen.max(1) as f64;
        for i in 0..TERMS {
            normal[(i, i)] += pull;
        }
        right += pull * self.terms;
        Self { terms: normal.cholesky().map_or(self.terms, |c| c.solve(&right)) }
    }
}
