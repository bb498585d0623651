//! The rows of a picture between the capillary's walls.

use crate::profile::{Picture, Walls};
use std::ops::Range;

/// Rows of glass that the window contains on each side of the bore.
pub(in crate::profile) const MARGIN_PX: usize = 6;

/// Rows beside zeros whose missing colours were taken from these too.
const MIXED_PX: usize = 2;

/// The rows from the first to the last that are not zero throughout.
fn lit_rows(plane: &[u8], width: usize) -> Range<usize> {
    let is_lit = |row: &[u8]| row.iter().any(|grey| *grey > 0);
    let (rows, height) = (|| plane.chunks_exact(width), plane.len() / width);
    let (above, below) = (rows().position(is_lit).unwrap_or(0), rows().rev().position(is_lit).unwrap_or(0));
    let mixed = |zeros: usize| if zeros > 0 { zeros + MIXED_PX } else { 0 };
    let first = mixed(above).min(height);
    first..height.saturating_sub(mixed(below)).max(first)
}

/// The rows of a picture between the walls, and the map to rows along the walls.
#[derive(Debug, Clone)]
pub(in crate::profile) struct Bore {
    pub walls: Walls,
    pub width: usize,
    /// Rows `top .. bottom` of the picture.
    pub top: usize,
    pub bottom: usize,
    /// The rows of the picture that have light. Those of zeros above and below are not of the picture: a program that was stopped while it wrote
    /// leaves them, and no camera.
    pub lit: Range<usize>,
    /// Mean height of the bore, px.
    pub mean_px: f64,
}

impl Bore {
    pub fn of(picture: &Picture, walls: Walls) -> Self {
        let (last, height) = ((picture.width() - 1) as f64, picture.height());
        // Walls may be curved: their highest and lowest points are at the ends or near the middle.
        let columns = [0.0, last / 4.0, last / 2.0, 0.75 * last, last];
        let highest = columns.map(|u| walls.upper.inner.at(u)).into_iter().fold(f64::INFINITY, f64::min) - MARGIN_PX as f64;
        let lowest = columns.map(|u| walls.lower.inner.at(u)).into_iter().fold(f64::NEG_INFINITY, f64::max) + MARGIN_PX as f64;
        let top = (highest.floor().max(0.0) as usize).min(height - 1);
        let bottom = (lowest.ceil().max(0.0) as usize + 1).min(height);
        let lit = lit_rows(&picture.planes()[1], picture.width());
        Self { walls, width: picture.width(), lit, top, bottom: bottom.max(top + 1), mean_px: walls.bore_px(last / 2.0) }
    }

    pub fn height(&self) -> usize {
        self.bottom - self.top
    }

    /// Rows of the table along the walls: the bore and its margin.
    pub(in crate::profile) fn table_rows(&self) -> usize {
        self.mean_px.ceil() as usize + 2 * MARGIN_PX + 1
    }

    /// Row of the picture of table row `t` in column `u`.
    pub(in crate::profile) fn v_of(&self, t: f64, u: f64) -> f64 {
        self.walls.upper.inner.at(u) + (t - MARGIN_PX as f64) * self.walls.bore_px(u) / self.mean_px
    }
}
