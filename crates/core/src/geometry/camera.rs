//! The camera's parameter vector psi (paper, section 2.2; the orbiting form of the projection).

use super::glass::Through;
use super::{GlassTube, Projection, VoxelGrid};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// The vector psi without its angles omega, which come from the ledger, view by view. docs/calibration.md describes the geometry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Camera {
    /// Distance of the projection centre from the axis, um. It determines only the strength of the perspective.
    pub f: f64,
    /// Scale at the axis along the capillary, px/um.
    pub kx: f64,
    /// Scale at the axis across the capillary, px/um. It differs from `kx` where the glass refracts.
    pub ky: f64,
    /// Column of the principal point, px.
    pub ux: f64,
    /// Row of the principal point, px.
    pub uy: f64,
    /// Skew, px/um.
    #[serde(default)]
    pub s: f64,
    /// Tilt of the capillary towards the camera, rad; positive brings its +x end nearer.
    #[serde(default)]
    pub alpha: f64,
    /// Roll of the capillary in the image, rad; positive lowers its +x end.
    #[serde(default)]
    pub gamma: f64,
    /// Elevation of the projection centre, rad. Nominally a quarter turn: the camera looks straight at the axis.
    #[serde(default = "quarter_turn")]
    pub phi: f64,
    /// Width of the sensor, px.
    pub width: u32,
    /// Height of the sensor, px.
    pub height: u32,
    /// The glass tube that the specimen is seen through. Where it is left out, nothing turns the rays: recordings without it were measured so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub glass: Option<GlassTube>,
}

fn quarter_turn() -> f64 {
    std::f64::consts::FRAC_PI_2
}

/// Why values are not those of a camera.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CameraError {
    /// A value is not finite or out of its range.
    #[error("camera: {name} is {found}; it must be a finite number{rule}")]
    Value {
        /// Name of the value.
        name: &'static str,
        /// The value.
        found: f64,
        /// What it must be beside finite, for the message.
        rule: &'static str,
    },
    /// The sensor has no pixel.
    #[error("camera: the sensor is {width} x {height} px; both must be at least 1")]
    Sensor {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
    },
}

impl Camera {
    /// The camera of the published rig: 60 mm from the axis, 5.5 um per px, the axis in the middle of a sensor of this size
    /// (px).
    pub fn published(width: u32, height: u32) -> Self {
        Self {
            f: 60_000.0,
            kx: 1.0 / 5.5,
            ky: 1.0 / 5.5,
            ux: (f64::from(width) - 1.0) / 2.0,
            uy: (f64::from(height) - 1.0) / 2.0,
            s: 0.0,
            alpha: 0.0,
            gamma: 0.0,
            phi: quarter_turn(),
            width,
            height,
            glass: None,
        }
    }

    /// Checks the values.
    ///
    /// # Errors
    /// Names the first value that no camera can have.
    pub fn check(&self) -> Result<(), CameraError> {
        for (name, found) in [("f", self.f), ("kx", self.kx), ("ky", self.ky)] {
            if !(found.is_finite() && found > 0.0) {
                return Err(CameraError::Value { name, found, rule: " above 0" });
            }
        }
        for (name, found) in
            [("ux", self.ux), ("uy", self.uy), ("s", self.s), ("alpha", self.alpha), ("gamma", self.gamma), ("phi", self.phi)]
        {
            if !found.is_finite() {
                return Err(CameraError::Value { name, found, rule: "" });
            }
        }
        if let Some(tube) = self.glass {
            let GlassTube { bore_radius_um: bore, outer_radius_um: outer, inside, glass, outside } = tube;
            for (name, found) in [("glass.inside", inside), ("glass.glass", glass), ("glass.outside", outside)] {
                if !(1.0..=2.5).contains(&found) {
                    return Err(CameraError::Value { name, found, rule: " from 1 to 2.5, a refractive index" });
                }
            }
            if !(bore.is_finite() && bore > 0.0) {
                return Err(CameraError::Value { name: "glass.bore_radius_um", found: bore, rule: " above 0" });
            }
            if !(outer.is_finite() && outer >= bore) {
                return Err(CameraError::Value {
                    name: "glass.outer_radius_um",
                    found: outer,
                    rule: " that is not less than that of the bore",
                });
            }
        }
        if self.width == 0 || self.height == 0 {
            return Err(CameraError::Sensor { width: self.width, height: self.height });
        }
        Ok(())
    }

    /// Least depth of the grid's outermost voxels in front of the projection centre, over one turn of the grid, um. It is 0 or
    /// less where they reach the plane of the camera.
    pub fn nearest_um(&self, grid: &VoxelGrid) -> f64 {
        let furthest = |axis: usize| grid.centre(axis, 0).abs().max(grid.centre(axis, grid.counts()[axis] - 1).abs());
        let radius = furthest(1).hypot(furthest(2));
        // The third row of `projection`, at the angle at which a corner is nearest.
        let along = (self.gamma.cos() * self.alpha.sin()).abs();
        let across = (self.gamma.sin() * self.alpha.sin()).hypot(self.alpha.cos());
        self.f * self.phi.sin() - along * furthest(0) - across * radius
    }

    /// The 3 x 4 projection of the view at angle `omega` (rad).
    pub fn projection(&self, omega: f64) -> Projection {
        let k = Matrix3::new(self.f * self.kx, self.s, self.ux, 0.0, self.f * self.ky, self.uy, 0.0, 0.0, 1.0);
        let r = Rotation3::from_axis_angle(&Vector3::y_axis(), self.alpha)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), self.gamma)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), omega);
        let centre = Vector3::new(0.0, self.phi.cos(), self.phi.sin()) * self.f;
        let mut p = nalgebra::Matrix3x4::zeros();
        p.fixed_columns_mut::<3>(0).copy_from(&(k * r.matrix()));
        p.set_column(3, &(k * centre));
        let through = self.glass.map(|tube| Through { tube, turned: [omega.cos(), omega.sin()], axis_um: [centre.y, centre.z] });
        Projection::from_rows(std::array::from_fn(|i| std::array::from_fn(|j| p[(i, j)])), through)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_signs_are_those_of_the_conventions() {
        let cam = Camera::published(1024, 1024);
        let at = |c: &Camera, omega: f64, x: [f64; 3]| c.projection(omega).project(x).unwrap();
        let near = [0.0, 0.0, -275.0];
        assert!(at(&cam, 0.1, near).1 > at(&cam, 0.0, near).1, "positive omega moves the near wall to larger v");
        let right_end = [1000.0, 0.0, 0.0];
        let rolled = Camera { gamma: 0.01, ..cam.clone() };
        assert!(at(&rolled, 0.0, right_end).1 > 511.5, "positive gamma lowers the +x end");
        let tilted = Camera { alpha: 0.01, ..cam.clone() };
        assert!(tilted.projection(0.0).depth(right_end) < cam.projection(0.0).depth(right_end), "positive alpha brings the +x end nearer");
        let (u, v) = at(&cam, 1.0, [55.0, 0.0, 0.0]);
        assert!((u - 521.5).abs() < 1e-9 && (v - 511.5).abs() < 1e-9, "55 um on the axis are 10 px");
    }

    /// Against the depths themselves, every degree of a turn: between two of them a corner comes nearer by less than 1 - cos 0.5 deg.
    #[test]
    fn the_nearest_voxel_is_that_of_a_whole_turn() {
        let grid = VoxelGrid::new(crate::geometry::BoxUm { min: [-900.0, -300.0, -500.0], max: [900.0, 300.0, 500.0] }, 10.0).unwrap();
        for (alpha, gamma) in [(0.0, 0.0), (0.3, -0.2), (-0.4, 0.5)] {
            let camera = Camera { alpha, gamma, ..Camera::published(1024, 1024) };
            let ends = |axis: usize| [grid.centre(axis, 0), grid.centre(axis, grid.counts()[axis] - 1)];
            let mut nearest = f64::INFINITY;
            for degree in 0..360 {
                let projection = camera.projection(f64::from(degree).to_radians());
                for (x, y, z) in (0..8).map(|n| (ends(0)[n & 1], ends(1)[n >> 1 & 1], ends(2)[n >> 2])) {
                    nearest = nearest.min(projection.depth([x, y, z]));
                }
            }
            let found = camera.nearest_um(&grid);
            assert!(found <= nearest + 1e-9 && nearest - found < 600.0 * (1.0 - 0.5f64.to_radians().cos()), "{found} is not {nearest}");
        }
    }

    #[test]
    fn values_no_camera_can_have_are_named() {
        let bad = Camera { ky: -1.0, ..Camera::published(1024, 1024) };
        assert_eq!(bad.check(), Err(CameraError::Value { name: "ky", found: -1.0, rule: " above 0" }));
        assert!(Camera::published(1024, 1024).check().is_ok());
    }
}
