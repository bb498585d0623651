//! The share of light that is missing, on a grid of cells that are a 48th of the bore high.
//!
//! ```text
//!   pixels of the bore -> cells -> opacity 0 (clear) .. 1 (black), inside the mask or not, away from the walls or not
//! ```

use super::Mask;
use super::background::Bore;
use super::bubble::Disc;
use super::detection::above;
use super::plane::Plane;

/// Cells across the bore: an eye is ten of them wide.
const CELLS_ACROSS: f64 = 48.0;
/// Opacity from which a cell shows something whatever the segmentation says: a fin takes less, every body more.
pub(super) const BODY: f32 = 0.12;
/// Cells this near to a wall show the wall's own line, px.
const WALL_PX: f64 = 4.0;

pub(super) struct Grid {
    pub width: usize,
    pub height: usize,
    /// Cells per bore, along either axis.
    pub per_bore: f64,
    pub opacity: Vec<f32>,
    /// More than half of the cell is in the mask.
    pub masked: Vec<bool>,
    /// The cell is clear of the walls' own lines.
    pub open: Vec<bool>,
    /// The cell belongs to the mask or is darker than an empty bore can be.
    pub filled: Vec<bool>,
}

impl Grid {
    pub fn of(mask: &Mask, bore: &Bore, darkness: &Plane, all_light: f32, bubbles: &[Disc]) -> Self {
        let cell = ((bore.mean_px / CELLS_ACROSS) as usize).max(1);
        let (width, height) = (bore.width / cell, bore.height() / cell);
        let share = 1.0 / (cell * cell) as f32 / all_light;
        let mut grid = Self {
            width,
            height,
            per_bore: bore.mean_px / cell as f64,
            opacity: vec![0.0; width * height],
            masked: vec![false; width * height],
            open: vec![false; width * height],
            filled: vec![false; width * height],
        };
        // Six standard deviations of a cell's noise, where that is more.
        let least = BODY.max(6.0 / all_light / cell as f32);
        let specimen = mask.data().iter().any(|&p| p != 0);
        let mut count = vec![0usize; width];
        for row in 0..height {
            count.fill(0);
            let sums = &mut grid.opacity[row * width..(row + 1) * width];
            for v in row * cell..(row + 1) * cell {
                let covered = &mask.data()[(bore.top + v) * bore.width..];
                for (u, (dark, inside)) in darkness.row(v).iter().zip(covered).take(width * cell).enumerate() {
                    sums[u / cell] += share * dark;
                    count[u / cell] += usize::from(*inside != 0);
                }
            }
            for (column, covered) in count.iter().enumerate() {
                let at = row * width + column;
                let (u, v) = ((column * cell + cell / 2) as f64, (bore.top + row * cell + cell / 2) as f64);
                grid.open[at] = v - bore.walls.upper.inner.at(u) > WALL_PX && bore.walls.lower.inner.at(u) - v > WALL_PX;
                grid.masked[at] = 2 * covered > cell * cell;
                // A bubble that was cut off the specimen is no part of it, and no second one.
                let cut_off = specimen && bubbles.iter().any(|b| b.near([u, v]));
                grid.filled[at] = grid.masked[at] || grid.open[at] && grid.opacity[at] > least && !cut_off;
            }
        }
        grid
    }

    /// How surely what is in the mask leaves the picture to the left and to the right: by how much light the mask's cells
    /// next to the border take. A leak of the mask along clear water takes none.
    pub fn clipped(&self) -> [f64; 2] {
        // Three columns: the outermost alone may be the sensor's.
        [0..3.min(self.width), self.width.saturating_sub(3)..self.width].map(|columns| {
            let (mut cells, mut taken) = (0.0, 0.0);
            for row in 0..self.height {
                for at in columns.clone().map(|column| row * self.width + column).filter(|&at| self.masked[at] && self.open[at]) {
                    cells += 1.0;
                    taken += f64::from(self.opacity[at].max(0.0));
                }
            }
            // A fin's tip takes 4 % of the light, a body 30 % and more.
            if cells == 0.0 { 0.0 } else { above(taken / cells, 0.08, 0.04) }
        })
    }

    /// Chamfer distance, in cells, of each cell of `set` from the nearest one outside; the border of the grid is no outside.
    pub fn depth(&self, set: impl Fn(usize) -> bool) -> Vec<f32> {
        const ASLANT: f32 = std::f32::consts::SQRT_2;
        let (w, h) = (self.width, self.height);
        let far = (w + h) as f32;
        let mut depth: Vec<f32> = (0..w * h).map(|at| if set(at) { far } else { 0.0 }).collect();
        let mut relax = |at: usize, from: Option<usize>, step: f32| {
            if let Some(from) = from {
                depth[at] = depth[at].min(depth[from] + step);
            }
        };
        for at in 0..w * h {
            let (up, left, right) = (at >= w, at % w > 0, at % w + 1 < w);
            relax(at, left.then(|| at - 1), 1.0);
            relax(at, up.then(|| at - w), 1.0);
            relax(at, (up && left).then(|| at - w - 1), ASLANT);
            relax(at, (up && right).then(|| at - w + 1), ASLANT);
        }
        for at in (0..w * h).rev() {
            let (down, left, right) = (at + w < w * h, at % w > 0, at % w + 1 < w);
            relax(at, right.then(|| at + 1), 1.0);
            relax(at, down.then(|| at + w), 1.0);
            relax(at, (down && right).then(|| at + w + 1), ASLANT);
            relax(at, (down && left).then(|| at + w - 1), ASLANT);
        }
        depth
    }
}
