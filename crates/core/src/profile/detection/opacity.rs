//! The share of missing light, on a grid of cells whose height is 1/48 of the bore.
//!
//! ```text
//!   pixels of the bore -> cells -> opacity 0 (clear) .. 1 (black), inside the mask or not, away from the walls or not
//! ```

use super::probability::logistic;
use crate::profile::Mask;
use crate::profile::body::bubble::Disc;
use crate::profile::bore::Bore;
use crate::profile::raster::chamfer;
use crate::profile::raster::plane::Plane;

/// Number of cells across the bore. An eye is ten of them wide.
const CELLS_ACROSS: f64 = 48.0;
/// Opacity from which a cell counts as filled without regard to the segmentation. A fin has less, every body more.
pub(in crate::profile) const BODY: f32 = 0.12;
/// Distance from a wall within which cells show the wall's own line, px.
const WALL_PX: f64 = 4.0;

#[derive(Debug, Default)]
pub(in crate::profile) struct Grid {
    pub width: usize,
    pub height: usize,
    /// Cells per bore, along either axis.
    pub per_bore: f64,
    pub opacity: Vec<f32>,
    /// Whether more than half of the cell is in the mask.
    pub masked: Vec<bool>,
    /// Whether the cell is clear of the walls' own lines.
    pub open: Vec<bool>,
    /// Whether the cell belongs to the mask or is darker than an empty bore can be.
    pub filled: Vec<bool>,
    /// Pixels of the mask in each cell of a row.
    covered: Vec<usize>,
    /// Darkness and number of pixels of the mask, of each column of pixels in a row of cells.
    dark: Vec<f32>,
    inside: Vec<u16>,
}

impl Grid {
    pub fn fill(&mut self, mask: &Mask, bore: &Bore, darkness: &Plane, all_light: f32, bubbles: &[Disc]) {
        let cell = ((bore.mean_px / CELLS_ACROSS) as usize).max(1);
        let (width, height) = (bore.width / cell, bore.height() / cell);
        let share = 1.0 / (cell * cell) as f32 / all_light;
        (self.width, self.height, self.per_bore) = (width, height, bore.mean_px / cell as f64);
        self.opacity.clear();
        self.opacity.resize(width * height, 0.0);
        for cells in [&mut self.masked, &mut self.open, &mut self.filled] {
            cells.clear();
            cells.resize(width * height, false);
        }
        // Six standard deviations of a cell's noise, where that is more.
        let least = BODY.max(6.0 / all_light / cell as f32);
        let specimen = mask.data().iter().any(|&p| p != 0);
        for row in 0..height {
            // First the sums of each column of pixels, many at once.
            self.dark.clear();
            self.dark.resize(width * cell, 0.0);
            self.inside.clear();
            self.inside.resize(width * cell, 0);
            for v in row * cell..(row + 1) * cell {
                self.dark.iter_mut().zip(darkness.row(v)).for_each(|(sum, dark)| *sum += dark);
                self.inside.iter_mut().zip(mask.row(bore.top + v)).for_each(|(n, inside)| *n += u16::from(*inside != 0));
            }
            let dark = self.dark.chunks_exact(cell).map(|pixels| share * pixels.iter().sum::<f32>());
            self.opacity[row * width..(row + 1) * width].iter_mut().zip(dark).for_each(|(opacity, dark)| *opacity = dark);
            self.covered.clear();
            self.covered.extend(self.inside.chunks_exact(cell).map(|pixels| pixels.iter().map(|n| usize::from(*n)).sum::<usize>()));
            for (column, covered) in self.covered.iter().enumerate() {
                let at = row * width + column;
                let (u, v) = ((column * cell + cell / 2) as f64, (bore.top + row * cell + cell / 2) as f64);
                self.open[at] = v - bore.walls.upper.inner.at(u) > WALL_PX && bore.walls.lower.inner.at(u) - v > WALL_PX;
                self.masked[at] = 2 * covered > cell * cell;
                // A bubble that was cut off the specimen is not part of it, and not a second specimen either.
                let cut_off = specimen && bubbles.iter().any(|b| b.near([u, v]));
                self.filled[at] = self.masked[at] || self.open[at] && self.opacity[at] > least && !cut_off;
            }
        }
    }

    /// Likelihood that what is in the mask leaves the picture to the left and to the right, from the light that the mask's
    /// cells next to the border take. A leak of the mask along clear water takes none.
    pub fn clipped(&self) -> [f64; 2] {
        // Three columns are used, because the outermost alone may be an artefact of the sensor.
        [0..3.min(self.width), self.width.saturating_sub(3)..self.width].map(|columns| {
            let (mut cells, mut taken) = (0.0, 0.0);
            for row in 0..self.height {
                for at in columns.clone().map(|column| row * self.width + column).filter(|&at| self.masked[at] && self.open[at]) {
                    cells += 1.0;
                    taken += f64::from(self.opacity[at].max(0.0));
                }
            }
            // The tip of a fin takes 4 % of the light, a body at least 30 %.
            if cells == 0.0 { 0.0 } else { logistic(taken / cells, 0.08, 0.04) }
        })
    }

    /// The depth of each cell within `set`, in cells.
    pub fn depth(&self, set: impl Fn(usize) -> bool, depth: &mut Vec<f32>) {
        chamfer::depth(self.width, (0..self.opacity.len()).map(set), depth);
    }
}
