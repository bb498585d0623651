//! A dot of ink on the outside of the glass. An operator marks a capillary with it to see the direction of rotation.
//!
//! ```text
//!        angle -90 deg  ___                 at omega 0 the dot stands at (x, R sin angle, -R cos angle):
//!                     /     \               0 faces the camera, positive is lower; at omega it is at angle + omega
//!   camera ---  0    |       |  180
//!                     \ ___ /
//!        angle +90 deg
//! ```
//! Every ray meets the glass twice. It is darkened if it meets the dot, in front of the contents or behind them.

use super::camera::Camera;
use super::optics::Optics;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Position, size and darkness of the dot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InkDot {
    /// Position along the capillary.
    pub x_um: f64,
    /// Position around the capillary: 0 faces the camera at omega 0, positive is lower.
    pub angle_rad: f64,
    /// Radius on the surface of the glass.
    pub radius_um: f64,
    /// Darkness, 0 to 1.
    pub opacity: f64,
}

impl Default for InkDot {
    fn default() -> Self {
        Self { x_um: 0.0, angle_rad: 0.0, radius_um: 60.0, opacity: 0.9 }
    }
}

/// Rays per pixel across the capillary, for a dot that is seen edge on.
const RAYS: i32 = 4;

impl InkDot {
    /// Darkens the image before blur where the dot is visible.
    pub(super) fn shade(&self, light: &mut [[f32; 3]], camera: &Camera, outer_um: f64, optics: &Optics, omega_rad: f64) {
        let view = camera.view(omega_rad);
        let (sin, cos) = self.angle_rad.sin_cos();
        let seen = view.project([self.x_um, outer_um * sin, -outer_um * cos]);
        // One pixel, and more if the dot is out of focus.
        let soft_um = (1.0 / camera.kx_px_per_um).hypot(2.0 * optics.defocus_rad * (seen.depth_um - camera.f_um));
        let reach_um = self.radius_um + soft_um;
        let span = |at: f64, k: f64, size: u32| {
            let reach = 1.1 * reach_um * k + 2.0;
            (at - reach).max(0.0) as usize..((at + reach).clamp(0.0, f64::from(size - 1)) + 1.0) as usize
        };
        let centre = view.centre();
        for v in span(seen.v_px, camera.ky_px_per_um, camera.height) {
            for u in span(seen.u_px, camera.kx_px_per_um, camera.width) {
                let of_ray = |i: i32| {
                    let ray = view.ray(u as f64, v as f64 + (f64::from(i) + 0.5) / f64::from(RAYS) - 0.5);
                    crossings(centre, ray, outer_um).map_or(0.0, |hits| hits.map(|at| self.covers(at, outer_um, soft_um)).iter().sum())
                };
                let covered = (0..RAYS).map(of_ray).sum::<f64>() / f64::from(RAYS);
                let left = (1.0 - self.opacity * covered.min(1.0)) as f32;
                let pixel = &mut light[v * camera.width as usize + u];
                *pixel = pixel.map(|p| p * left);
            }
        }
    }

    /// Coverage of the glass with ink at a point, 0 to 1.
    fn covers(&self, [x, y, z]: [f64; 3], outer_um: f64, soft_um: f64) -> f64 {
        let turned = y.atan2(-z) - self.angle_rad;
        let around = outer_um * (turned - TAU * (turned / TAU).round());
        ((self.radius_um - (x - self.x_um).hypot(around)) / soft_um + 0.5).clamp(0.0, 1.0)
    }
}

/// Where a ray meets a cylinder about the x axis.
fn crossings(from: [f64; 3], ray: [f64; 3], radius: f64) -> Option<[[f64; 3]; 2]> {
    let a = ray[1] * ray[1] + ray[2] * ray[2];
    let b = from[1] * ray[1] + from[2] * ray[2];
    let c = from[1] * from[1] + from[2] * from[2] - radius * radius;
    let root = (b * b - a * c).sqrt();
    (a > 0.0 && !root.is_nan()).then(|| [-1.0, 1.0].map(|side| std::array::from_fn(|i| from[i] + ray[i] * (side * root - b) / a)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Capillary, Exposure, Scene, SceneSettings};

    /// The centroid of the darkening by the dot, px.
    fn dot(camera: &Camera, ink: InkDot, omega: f64) -> [f64; 2] {
        let frame = |ink| {
            let capillary = Capillary { ink, ..Capillary::default() };
            let scene =
                Scene::new(SceneSettings { camera: camera.clone(), capillary, optics: Optics::exact(), ..SceneSettings::default() });
            scene.render(&Exposure { angle_rad: omega, number: 1 })
        };
        let (with, without) = (frame(Some(ink)), frame(None));
        let mut sum = [0.0; 3];
        for (i, (a, b)) in with.data.iter().zip(&without.data).enumerate() {
            let darker = f64::from(*b) / 255.0 - f64::from(*a) / 255.0;
            let at = i / 3;
            sum[0] += darker;
            sum[1] += darker * (at % camera.width as usize) as f64;
            sum[2] += darker * (at / camera.width as usize) as f64;
        }
        assert!(sum[0] > 50.0, "{sum:?} at {omega}");
        [sum[1] / sum[0], sum[2] / sum[0]]
    }

    #[test]
    fn the_dot_is_at_the_projection_of_its_point_on_the_glass() {
        let camera = Camera { height: 256, uy_px: 127.5, ..Camera::default() };
        let ink = InkDot { x_um: 1500.0, angle_rad: -0.6, radius_um: 40.0, opacity: 0.9 };
        let outer = Capillary::default().outer_radius_um();
        // Away from the lines of the walls, which a dot darkens only a little.
        for omega in [0.0_f64, 0.9, 2.9, 3.7, 4.3] {
            let expected = camera.view(0.0).project([1500.0, outer * (omega - 0.6).sin(), -outer * (omega - 0.6).cos()]);
            let [u, v] = dot(&camera, ink, omega);
            // Glass lines under it shift the middle a little; perspective moves u by 1.6 px from the near to the far side.
            assert!((u - expected.u_px).abs() < 0.25, "u {u} at {omega}, expected {}", expected.u_px);
            assert!((v - expected.v_px).abs() < 2.0, "v {v} at {omega}, expected {}", expected.v_px);
        }
    }
}
