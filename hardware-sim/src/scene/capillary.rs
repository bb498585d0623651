//! The glass capillary: the room a specimen has, and how its walls look. It does not visibly turn, unless a dot of ink is on it,
//! and lies as the camera's gamma says: walls, axis and specimen are tilted together.

use super::ink::InkDot;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Capillary {
    pub bore_diameter_um: f64,
    /// Thickness of the glass.
    pub glass_um: f64,
    /// Darkness of the upper inner wall's line, as a part of 1.
    pub wall_contrast: f64,
    /// The lower wall's darkness as a part of the upper's: the lamp shines a little from above.
    pub lower_share: f64,
    /// Standard deviation of a wall line's width.
    pub wall_line_px: f64,
    /// How far a wall's red image lies below its green one, and its blue one above: brownish above, bluish below.
    pub fringe_px: f64,
    /// Darkness of the glass between its two lines, as a part of 1.
    pub glass_shade: f64,
    /// Loss of light in the water beside a wall, as a part of 1, and how far it reaches.
    pub bore_shade: f64,
    pub bore_shade_px: f64,
    /// A dot of ink on the outside, which turns with the glass.
    pub ink: Option<InkDot>,
}

impl Default for Capillary {
    fn default() -> Self {
        Self {
            bore_diameter_um: 650.0,
            glass_um: 36.0,
            wall_contrast: 0.70,
            lower_share: 0.8,
            wall_line_px: 0.8,
            fringe_px: 0.28,
            glass_shade: 0.32,
            bore_shade: 0.12,
            bore_shade_px: 7.0,
            ink: None,
        }
    }
}

impl Capillary {
    pub fn bore_radius_um(&self) -> f64 {
        self.bore_diameter_um / 2.0
    }

    pub fn outer_radius_um(&self) -> f64 {
        self.bore_radius_um() + self.glass_um
    }
}
