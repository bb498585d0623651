//! The glass capillary: the room a specimen has, and how its walls look. It does not visibly turn, and lies as the camera's
//! gamma says: walls, axis and specimen are tilted together.

use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Capillary {
    pub bore_diameter_um: f64,
    /// Thickness of the glass.
    pub glass_um: f64,
    /// Darkness of the inner wall's line, as a part of 1.
    pub wall_contrast: f64,
    /// Standard deviation of a wall line's width.
    pub wall_line_px: f64,
    /// How far red and blue lines are apart from green.
    pub fringe_px: f64,
    /// Darkness of the glass beside its bright core, as a part of 1.
    pub glass_shade: f64,
}

impl Default for Capillary {
    fn default() -> Self {
        Self { bore_diameter_um: 650.0, glass_um: 60.0, wall_contrast: 0.72, wall_line_px: 1.2, fringe_px: 0.25, glass_shade: 0.22 }
    }
}

impl Capillary {
    pub fn bore_radius_um(&self) -> f64 {
        self.bore_diameter_um / 2.0
    }
}
