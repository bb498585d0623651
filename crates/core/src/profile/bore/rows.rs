//! The rows of a picture between the capillary's walls.

use crate::profile::{Picture, Walls};

/// Rows of glass that the window contains on each side of the bore.
pub(in crate::profile) const MARGIN_PX: usize = 6;

/// The rows of a picture between the walls, and the map to rows along the walls.
#[derive(Debug, Clone)]
pub(in crate::profile) struct Bore {
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
        // Walls may be curved: their highest and lowest points are at the ends or near the middle.
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

    /// Rows of the table along the walls: the bore and its margin.
    pub(in crate::profile) fn table_rows(&self) -> usize {
        self.mean_px.ceil() as usize + 2 * MARGIN_PX + 1
    }

    /// Row of the picture of table row `t` in column `u`.
    pub(in crate::profile) fn v_of(&self, t: f64, u: f64) -> f64 {
        self.walls.upper.inner.at(u) + (t - MARGIN_PX as f64) * self.walls.bore_px(u) / self.mean_px
    }
}
