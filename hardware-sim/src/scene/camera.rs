//! The pinhole camera of the scene: the projection of a point in the frame of the capillary to the sensor.
//!
//! ```text
//!          y down                 x~ = K [ R_Y(alpha) R_Z(gamma) R_X(omega) X + f (0, cos phi, sin phi) ]
//!          |                          K = [[f kx, s, ux], [0, f ky, uy], [0, 0, 1]]
//!   camera |   z away
//!     [>---+--/----------> x      pixel centres at integers, u right, v down; um and rad
//! ```
//! Positive omega moves the near wall to larger v. This code shares nothing with the programs that evaluate the frames, so that tests
//! detect a wrong sign or half a pixel in either.

use serde::{Deserialize, Serialize};

/// The parameters of the camera. The angle of the axis is a parameter of each exposure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    /// Distance of the projection centre from the axis, um.
    pub f_um: f64,
    /// Scale at the axis along the capillary.
    pub kx_px_per_um: f64,
    /// Scale at the axis across the capillary. It is larger than `kx` if air surrounds the glass.
    pub ky_px_per_um: f64,
    /// Principal point, u.
    pub ux_px: f64,
    /// Principal point, v.
    pub uy_px: f64,
    /// The skew s of the matrix K.
    pub skew: f64,
    /// Positive brings the +x end nearer.
    pub alpha_rad: f64,
    /// Positive lowers the +x end in the image.
    pub gamma_rad: f64,
    /// Direction from the projection centre to the axis, in the plane of y and z. It is pi/2 along +z.
    pub phi_rad: f64,
    /// Size of the sensor, px.
    pub width: u32,
    pub height: u32,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            f_um: 60_000.0,
            kx_px_per_um: 1.0 / 5.5,
            ky_px_per_um: 1.0 / 5.5,
            ux_px: 511.5,
            uy_px: 511.5,
            skew: 0.0,
            alpha_rad: 0.0,
            gamma_rad: 0.0,
            phi_rad: std::f64::consts::FRAC_PI_2,
            width: 1024,
            height: 1024,
        }
    }
}

/// The camera at one angle of the axis.
#[derive(Debug, Clone)]
pub struct View {
    rotation: [[f64; 3]; 3],
    shift: [f64; 3],
    fkx: f64,
    fky: f64,
    skew: f64,
    ux: f64,
    uy: f64,
}

/// A point on the sensor and its depth in front of the projection centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projected {
    pub u_px: f64,
    pub v_px: f64,
    pub depth_um: f64,
}

impl Camera {
    pub fn view(&self, omega_rad: f64) -> View {
        let (sa, ca) = self.alpha_rad.sin_cos();
        let (sg, cg) = self.gamma_rad.sin_cos();
        let (so, co) = omega_rad.sin_cos();
        let ry = [[ca, 0.0, sa], [0.0, 1.0, 0.0], [-sa, 0.0, ca]];
        let rz = [[cg, -sg, 0.0], [sg, cg, 0.0], [0.0, 0.0, 1.0]];
        let rx = [[1.0, 0.0, 0.0], [0.0, co, -so], [0.0, so, co]];
        View {
            rotation: product(&product(&ry, &rz), &rx),
            shift: [0.0, self.f_um * self.phi_rad.cos(), self.f_um * self.phi_rad.sin()],
            fkx: self.f_um * self.kx_px_per_um,
            fky: self.f_um * self.ky_px_per_um,
            skew: self.skew,
            ux: self.ux_px,
            uy: self.uy_px,
        }
    }
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

impl View {
    pub fn project(&self, point: [f64; 3]) -> Projected {
        let [x, y, depth]: [f64; 3] = std::array::from_fn(|i| (0..3).map(|j| self.rotation[i][j] * point[j]).sum::<f64>() + self.shift[i]);
        Projected { u_px: (self.fkx * x + self.skew * y) / depth + self.ux, v_px: self.fky * y / depth + self.uy, depth_um: depth }
    }

    /// The projection centre in the frame of the capillary, um.
    pub fn centre(&self) -> [f64; 3] {
        std::array::from_fn(|j| -(0..3).map(|i| self.rotation[i][j] * self.shift[i]).sum::<f64>())
    }

    /// Length of the ray through a pixel per unit of depth.
    pub fn ray_length_per_depth(&self, u_px: f64, v_px: f64) -> f64 {
        let [x, y, _] = self.slopes(u_px, v_px);
        (1.0 + x * x + y * y).sqrt()
    }

    /// The ray through a pixel in the frame of the capillary, per unit of depth.
    pub fn ray(&self, u_px: f64, v_px: f64) -> [f64; 3] {
        let slopes = self.slopes(u_px, v_px);
        std::array::from_fn(|j| (0..3).map(|i| self.rotation[i][j] * slopes[i]).sum())
    }

    /// The ray through a pixel in the frame of the camera, per unit of depth.
    fn slopes(&self, u_px: f64, v_px: f64) -> [f64; 3] {
        let y = (v_px - self.uy) / self.fky;
        [(u_px - self.ux - self.skew * y) / self.fkx, y, 1.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positive_angles_have_the_documented_directions() {
        let camera = Camera::default();
        let near = [0.0, 0.0, -300.0];
        assert!(camera.view(0.1).project(near).v_px > 511.5 + 4.0, "positive omega moves the near wall to larger v");
        let end = [1000.0, 0.0, 0.0];
        let rolled = Camera { gamma_rad: 0.01, ..camera.clone() };
        assert!(rolled.view(0.0).project(end).v_px > 512.0, "positive gamma lowers the +x end");
        let tilted = Camera { alpha_rad: 0.01, ..camera.clone() };
        assert!(tilted.view(0.0).project(end).depth_um < 60_000.0 - 9.0, "positive alpha brings the +x end nearer");
        let p = camera.view(2.0).project([55.0, 0.0, 0.0]);
        assert!((p.u_px - 521.5).abs() < 1e-9 && (p.v_px - 511.5).abs() < 1e-9, "55 um on the axis are 10 px");
    }

    #[test]
    fn a_nearer_object_is_larger() {
        let view = Camera::default().view(0.0);
        let half = |z: f64| view.project([0.0, 550.0, z]).v_px - 511.5;
        assert!((half(0.0) - 100.0).abs() < 1e-9);
        assert!((half(-600.0) - 100.0 / 0.99).abs() < 1e-9, "600 um nearer of 60 mm is 1/0.99 larger");
    }
}
