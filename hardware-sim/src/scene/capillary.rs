//! The glass capillary: its bore and the appearance of its walls. Its turn is visible only with a dot of ink or marks on the glass. The
//! angle gamma of the camera tilts walls, axis and specimen together.

use super::ink::InkDot;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Capillary {
    pub bore_diameter_um: f64,
    /// Thickness of the glass wall.
    pub glass_um: f64,
    /// Darkness of the line of the upper inner wall, 0 to 1.
    pub wall_contrast: f64,
    /// Darkness of the lower wall over that of the upper wall. It is below 1 because the lamp shines a little from above.
    pub lower_share: f64,
    /// Standard deviation of the Gaussian profile of a wall line.
    pub wall_line_px: f64,
    /// How far the red image of a wall lies below the green one, and the blue one above it. Walls are brownish above and bluish below.
    pub fringe_px: f64,
    /// Darkness of the glass between its two lines, 0 to 1.
    pub glass_shade: f64,
    /// Loss of light in the water beside a wall, 0 to 1.
    pub bore_shade: f64,
    /// How far from the wall this loss reaches.
    pub bore_shade_px: f64,
    /// Loss of light in the whole bore against the light outside the capillary, 0 to 1.
    pub bore_loss: f64,
    /// The lower wall, if it does not look like the upper one. [`Capillary::lower_share`] applies in addition.
    pub lower: Option<Wall>,
    /// A dot of ink on the outside, which turns with the glass.
    pub ink: Option<InkDot>,
}

/// The appearance of one wall. The glass of a real capillary looks thicker on one side than on the other, because it is not exactly
/// perpendicular to the line of sight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Distance of the outer line from the inner one. Below 20 um the two blend into one.
    pub glass_um: f64,
    /// As [`Capillary::wall_line_px`].
    pub line_px: f64,
    /// As [`Capillary::bore_shade`].
    pub bore_shade: f64,
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
            bore_loss: 0.0,
            lower: None,
            ink: None,
        }
    }
}

impl Capillary {
    pub fn bore_radius_um(&self) -> f64 {
        self.bore_diameter_um / 2.0
    }

    /// The upper and the lower wall.
    pub fn walls(&self) -> [Wall; 2] {
        let upper = Wall { glass_um: self.glass_um, line_px: self.wall_line_px, bore_shade: self.bore_shade };
        [upper, self.lower.unwrap_or(upper)]
    }

    /// Radius of the outside of the glass.
    pub fn outer_radius_um(&self) -> f64 {
        self.bore_radius_um() + self.glass_um
    }
}
