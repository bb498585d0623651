//! The bore divided into cells.

use super::known_light::KnownLight;
use super::light::{ALONG, Light};
use crate::profile::bore::Bore;

/// The window in cells: the walls are level, with one row per pixel across the bore and several columns per cell.
#[derive(Debug, Default)]
pub(super) struct Table {
    pub rows: usize,
    pub cols: usize,
    pub stride: usize,
    /// `values[t * cols + k]`: mean ratio of grey value to the known light, times the typical grey value of that light.
    pub values: Vec<f32>,
    pub typical: f32,
    /// The light's polynomials along the capillary in each column of cells.
    pub along: Vec<[f64; ALONG]>,
    /// Sums of the pixels of each cell, for every row of the picture in the window.
    sums: Vec<u32>,
    /// Picture row of table row 0 in each column of cells, and picture rows per table row.
    courses: Vec<(f64, f64)>,
    /// The light beside the capillary in each column of cells: at table row 0, and its slope per row.
    beside: Vec<[f32; 2]>,
}

impl Table {
    pub fn fill(&mut self, bore: &Bore, plane: &[u8], known: &KnownLight) {
        // 256 cells determine a row's level to a twentieth of the noise. More of them only cost time.
        self.stride = (bore.width / 256).max(1);
        (self.rows, self.cols) = (bore.table_rows(), bore.width / self.stride);
        let (stride, cols) = (self.stride, self.cols);
        self.along.clear();
        self.along.extend((0..cols).map(|k| Light::along(2.0 * mid(k, stride) / (bore.width.max(2) - 1) as f64 - 1.0)));
        self.courses.clear();
        self.courses.extend((0..cols).map(|k| {
            let first = bore.v_of(0.0, mid(k, stride));
            (first, bore.v_of(1.0, mid(k, stride)) - first)
        }));
        self.sums.clear();
        for row in plane[bore.top * bore.width..bore.bottom * bore.width].chunks_exact(bore.width) {
            self.sums.extend(row.chunks_exact(stride).take(cols).map(|cell| cell.iter().map(|&p| u32::from(p)).sum::<u32>()));
        }
        self.beside.clear();
        if let KnownLight::Surroundings(beside) = known {
            let mean = |cell: &[[f32; 2]]| [0, 1].map(|i| cell.iter().map(|column| column[i]).sum::<f32>() / stride as f32);
            self.beside.extend(beside.columns.chunks_exact(stride).take(cols).map(mean));
        }
        self.values.clear();
        let (last, share) = ((bore.height() - 1) as f64, 1.0 / stride as f32);
        let mut sum = 0.0f64;
        for t in 0..self.rows {
            for (k, &(first, per_row)) in self.courses.iter().enumerate() {
                let v = (first + t as f64 * per_row - bore.top as f64).clamp(0.0, last);
                let v0 = v as i32 as usize;
                let part = (v - v0 as f64) as f32;
                let v1 = (v0 + 1).min(bore.height() - 1);
                let (a, b) = (self.sums[v0 * cols + k] as f32, self.sums[v1 * cols + k] as f32);
                let before = match known {
                    KnownLight::Surroundings(_) => self.beside[k][0] + t as f32 * self.beside[k][1],
                    KnownLight::EmptyCapillary { .. } => (k * stride..(k + 1) * stride).map(|u| known.at(t as f64, u)).sum::<f32>() * share,
                };
                sum += f64::from(before);
                self.values.push((a + part * (b - a)) * share / before.max(1.0));
            }
        }
        self.typical = ((sum / self.values.len() as f64) as f32).max(1.0);
        self.values.iter_mut().for_each(|value| *value *= self.typical);
    }

    pub fn y(&self, t: f64) -> f64 {
        2.0 * t / (self.rows - 1) as f64 - 1.0
    }
}

/// Column of the picture of a cell's middle.
fn mid(k: usize, stride: usize) -> f64 {
    (k * stride) as f64 + (stride - 1) as f64 / 2.0
}
