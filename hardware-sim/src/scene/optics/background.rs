//! The image without a specimen: uneven light and the glass walls.
//!
//! ```text
//!   v  -------------------------------   outer wall: weak dark line   } brownish above, bluish below:
//!      . . . . . . . . . . . . . . . .   glass: greyer                } the height depends on the colour
//!      ===============================   inner wall: strong dark line }
//!                 bore                   water: a little darker towards the walls
//! ```

use super::Optics;
use crate::scene::camera::Camera;
use crate::scene::capillary::{Capillary, Wall};
use rayon::prelude::*;

/// Light per pixel and colour, in 8-bit units, before blur and noise.
pub fn background(camera: &Camera, capillary: &Capillary, optics: &Optics) -> Vec<[f32; 3]> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let middle = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
    let corner = middle.0.hypot(middle.1).max(1.0);
    let walls: Vec<WallColumn> = (0..width).map(|u| WallColumn::new(camera, capillary, u as f64)).collect();
    let along: Vec<f64> = (0..width).map(|u| (u as f64 - middle.0) / corner).collect();
    let waves: Vec<f64> = along.iter().map(|du| 0.4 * (3.1 * du + 0.7).sin()).collect();
    let mut light = vec![[0.0f32; 3]; width * height];
    light.par_chunks_mut(width).enumerate().for_each(|(v, row)| {
        let dv = (v as f64 - middle.1) / corner;
        let wave = (2.3 * dv - 0.4).cos();
        for (u, pixel) in row.iter_mut().enumerate() {
            let du = along[u];
            let vignette = 1.0 - optics.vignetting * (du * du + dv * dv);
            // A slow slope and a slow wave, as of a lamp that is not centred behind its diffuser.
            let uneven = 1.0 + optics.unevenness * (0.5 * du - 0.3 * dv + waves[u] * wave);
            let glass = walls[u].transmission(v as f64, capillary);
            *pixel = std::array::from_fn(|k| (optics.light_rgb[k] * vignette * uneven * glass[k]) as f32);
        }
    });
    light
}

/// Positions of the wall lines in one column of pixels, px.
struct WallColumn {
    /// Upper and lower line, of the bore and of the outside.
    inner: [f64; 2],
    outer: [f64; 2],
    walls: [Wall; 2],
}

impl WallColumn {
    fn new(camera: &Camera, capillary: &Capillary, u_px: f64) -> Self {
        let view = camera.view(0.0);
        let x_um = (u_px - camera.ux_px) / camera.kx_px_per_um;
        // A tangent ray touches a cylinder in front of its widest point.
        let line = |radius_um: f64| {
            let grazing = radius_um / (1.0 - (radius_um / camera.f_um).powi(2)).max(1e-6).sqrt();
            [-grazing, grazing].map(|y| view.project([x_um, y, 0.0]).v_px)
        };
        let walls = capillary.walls();
        let [upper, lower] = walls.map(|wall| line(capillary.bore_radius_um() + wall.glass_um));
        Self { inner: line(capillary.bore_radius_um()), outer: [upper[0], lower[1]], walls }
    }

    fn transmission(&self, v_px: f64, capillary: &Capillary) -> [f64; 3] {
        let mut out = [1.0; 3];
        if capillary.bore_loss > 0.0 {
            let within = step_over((v_px - self.inner[0]) / 0.5) * step_over((self.inner[1] - v_px) / 0.5);
            out = [1.0 - capillary.bore_loss * within; 3];
        }
        for (side, strength) in [1.0, capillary.lower_share].into_iter().enumerate() {
            let outward = if side == 0 { -1.0 } else { 1.0 };
            let thickness = outward * (self.outer[side] - self.inner[side]);
            let wall = &self.walls[side];
            for (k, value) in out.iter_mut().enumerate() {
                let shifted = v_px - capillary.fringe_px * (1.0 - k as f64);
                // Distance outside the bore.
                let from_inner = outward * (shifted - self.inner[side]);
                let line = |at: f64, depth: f64| 1.0 - depth * decay(0.5 * ((from_inner - at) / wall.line_px).powi(2));
                // Grey between the lines, with half a pixel of transition.
                let within = step_over(from_inner / 0.5) * step_over((thickness - from_inner) / 0.5);
                // The wall bends light away on both sides of its line.
                let halo = if from_inner > 0.0 {
                    0.25 * capillary.wall_contrast * decay((from_inner - thickness).abs() / 1.6)
                } else {
                    wall.bore_shade * decay(-from_inner / capillary.bore_shade_px)
                };
                *value *= line(0.0, strength * capillary.wall_contrast)
                    * line(thickness, 0.6 * strength * capillary.wall_contrast)
                    * (1.0 - strength * capillary.glass_shade * within)
                    * (1.0 - strength * halo);
            }
        }
        out
    }
}

/// A smooth step from 0 to 1 around 0.
fn step_over(t: f64) -> f64 {
    // exp(9.5 * 4) does not differ from the limit either.
    if t < -9.5 { 0.0 } else { 1.0 / (1.0 + decay(4.0 * t)) }
}

/// exp(-x), and 0 where 1 - exp(-x) is 1 in f64. Most pixels are far from the walls.
fn decay(x: f64) -> f64 {
    if x > 38.0 { 0.0 } else { (-x).exp() }
}
