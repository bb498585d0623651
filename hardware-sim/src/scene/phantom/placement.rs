//! The position of a specimen in the bore, and the narrowest bore that contains it.
//!
//! ```text
//!   own frame -> half a turn about y (faces_right) -> roll about x -> shift by x, y, z -> sink in +y (rests_on_wall)
//! ```

use super::Specimen;
use super::hull::convex_hull;
use serde::{Deserialize, Serialize};

/// Position and orientation of a specimen in the bore. It turns with the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Placement {
    pub x_um: f64,
    pub y_um: f64,
    pub z_um: f64,
    /// First turns the specimen by half a revolution about the y axis. The head of a larva is then at the right instead of the left.
    pub faces_right: bool,
    /// Turn about its own x axis before the shift.
    pub roll_rad: f64,
    /// Lets it sink in +y from `y_um` until it touches the bore.
    pub rests_on_wall: bool,
}

impl Placement {
    /// Applies the placement to a point, without the sinking.
    pub fn place(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let side = if self.faces_right { -1.0 } else { 1.0 };
        let (sin, cos) = self.roll_rad.sin_cos();
        let (x, z) = (side * x, side * z);
        [x + self.x_um, y * cos - z * sin + self.y_um, y * sin + z * cos + self.z_um]
    }
}

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PlacementError {
    #[error(
        "the {name} reaches {reach_um:.1} um from the capillary axis, the bore ends at {bore_radius_um:.1} um: choose a smaller specimen, another placement or a wider bore"
    )]
    OutsideBore { name: String, reach_um: f64, bore_radius_um: f64 },
}

/// The narrowest straight bore that contains a specimen in its placement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Narrowest {
    pub diameter_um: f64,
    /// Position of its axis.
    pub y_um: f64,
    pub z_um: f64,
}

impl Specimen {
    /// The specimen in the frame of the capillary, with its placement applied.
    ///
    /// # Errors
    /// A part of the specimen is outside the bore.
    pub(crate) fn settled(mut self, bore_radius_um: f64) -> Result<Self, PlacementError> {
        let placement = self.placement;
        self.move_all(|point| placement.place(point));
        if placement.rests_on_wall {
            let drop_um = self.depth_to_wall(bore_radius_um);
            self.move_all(|[x, y, z]| [x, y + drop_um, z]);
        }
        let reach_um = self.points().map(|v| v[1].hypot(v[2])).fold(0.0, f64::max);
        // A specimen that rests on the wall may be outside by a rounding error.
        if reach_um > bore_radius_um + 1e-6 {
            return Err(PlacementError::OutsideBore { name: self.name, reach_um, bore_radius_um });
        }
        Ok(self)
    }

    /// The longest way down that keeps every point within the bore.
    fn depth_to_wall(&self, bore_radius_um: f64) -> f64 {
        let room = |v: &[f64; 3]| (bore_radius_um.powi(2) - v[2].powi(2)).max(0.0).sqrt() - v[1];
        self.points().map(room).fold(f64::INFINITY, f64::min)
    }

    /// The smallest circle around all its points, seen along the capillary. The diameter is too large by less than a thousandth.
    pub fn narrowest_bore(&self) -> Narrowest {
        let seen: Vec<[f64; 2]> = self.points().map(|&point| self.placement.place(point)).map(|[_, y, z]| [y, z]).collect();
        let corners = convex_hull(&seen);
        let furthest = |[y, z]: [f64; 2]| {
            let away = |c: &[f64; 2]| (c[0] - y).hypot(c[1] - z);
            corners.iter().copied().max_by(|a, b| away(a).total_cmp(&away(b))).map_or(([y, z], 0.0), |c| (c, away(&c)))
        };
        // Badoiu and Clarkson 2003: after i steps of 1/(i+1) towards the furthest point the result is within 1/i of the optimum.
        let mut centre = corners.first().copied().unwrap_or_default();
        for i in 1..4000 {
            let (corner, _) = furthest(centre);
            let step = 1.0 / f64::from(i + 1);
            centre = std::array::from_fn(|k| centre[k] + step * (corner[k] - centre[k]));
        }
        Narrowest { diameter_um: 2.0 * furthest(centre).1, y_um: centre[0], z_um: centre[1] }
    }

    /// The specimen, shifted across so that the axis of its narrowest bore is the axis of the bore.
    #[must_use]
    pub fn centred(self) -> Self {
        let Narrowest { y_um, z_um, .. } = self.narrowest_bore();
        let p = self.placement;
        self.placed(Placement { y_um: p.y_um - y_um, z_um: p.z_um - z_um, ..p })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_narrowest_bore_of_an_ellipsoid_is_its_longer_axis_across() {
        let placement = Placement { y_um: 30.0, z_um: -20.0, roll_rad: 0.4, ..Placement::default() };
        let bore = Specimen::ellipsoid([900.0, 200.0, 120.0]).unwrap().placed(placement).narrowest_bore();
        assert!((bore.diameter_um - 400.0).abs() < 0.4, "{bore:?}");
        assert!((bore.y_um - 30.0).abs() < 0.4 && (bore.z_um + 20.0).abs() < 0.4, "{bore:?}");
    }

    #[test]
    fn a_centred_larva_fits_its_narrowest_bore_and_no_narrower_one() {
        for faces_right in [false, true] {
            let placement = Placement { roll_rad: 1.1, faces_right, ..Placement::default() };
            let larva = Specimen::larva(5, 3).unwrap().placed(placement).centred();
            let needed = larva.narrowest_bore().diameter_um;
            assert!(larva.clone().settled(needed / 2.0 * 1.001).is_ok(), "needs {needed}");
            assert!(larva.settled(needed / 2.0 * 0.998).is_err());
        }
    }
}
