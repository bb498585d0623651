//! The bore divided into cells.

use super::bore::Bore;
use super::known_light::KnownLight;

/// The window in cells: the walls are level, with one row per pixel across the bore and several columns per cell.
#[derive(Debug, Default)]
pub(super) struct Table {
    pub rows: usize,
    pub cols: usize,
    pub stride: usize,
    pub width: usize,
    /// `values[t * cols + k]`: mean ratio of grey value to the known light, times the typical grey value of that light.
    pub values: Vec<f32>,
    pub typical: f32,
}

impl Table {
    pub fn fill(&mut self, bore: &Bore, plane: &[u8], known: &KnownLight) {
        self.width = bore.width;
        // 256 cells determine a row's level to a twentieth of the noise. More of them only cost time.
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
                let before = columns.clone().map(|u| known.at(t as f64, u)).sum::<f32>() / columns.len() as f32;
                sum += f64::from(before);
                self.values[t * self.cols + k] = (a + part * (b - a)) / before.max(1.0);
            }
        }
        self.typical = ((sum / self.values.len() as f64) as f32).max(1.0);
        self.values.iter_mut().for_each(|value| *value *= self.typical);
    }

    pub fn x(&self, k: usize) -> f64 {
        let mid = (k * self.stride) as f64 + (self.stride - 1) as f64 / 2.0;
        2.0 * mid / (self.width.max(2) - 1) as f64 - 1.0
    }

    pub fn y(&self, t: f64) -> f64 {
        2.0 * t / (self.rows - 1) as f64 - 1.0
    }
}
