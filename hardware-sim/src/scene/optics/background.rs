//! The picture without a specimen: uneven light and the glass walls.
//!
//! ```text
//!   v  -------------------------------   outer wall: weak dark line
//!      . . . . . . . . . . . . . . . .   glass: greyer, with a bright core
//!      ===============================   inner wall: strong dark line, with a colour fringe
//!                 bore
//! ```

use super::Optics;
use crate::scene::camera::Camera;
use crate::scene::capillary::Capillary;
use rayon::prelude::*;

/// Light per pixel and colour, in 8-bit units, before blur and noise.
pub fn background(camera: &Camera, capillary: &Capillary, optics: &Optics) -> Vec<[f32; 3]> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let middle = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
    let corner = middle.0.hypot(middle.1).max(1.0);
    let walls: Vec<WallColumn> = (0..width).map(|u| WallColumn::new(camera, capillary, u as f64)).collect();
    let mut light = vec![[0.0f32; 3]; width * height];
    light.par_chunks_mut(width).enumerate().for_each(|(v, row)| {
        for (u, pixel) in row.iter_mut().enumerate() {
            let (du, dv) = ((u as f64 - middle.0) / corner, (v as f64 - middle.1) / corner);
            let vignette = 1.0 - optics.vignetting * (du * du + dv * dv);
            // A slow slope and a slow wave: a lamp that is not quite centred behind its diffuser.
            let uneven = 1.0 + optics.unevenness * (0.5 * du - 0.3 * dv + 0.4 * (3.1 * du + 0.7).sin() * (2.3 * dv - 0.4).cos());
            let glass = walls[u].transmission(v as f64, capillary);
            *pixel = std::array::from_fn(|k| (optics.light_rgb[k] * vignette * uneven * glass[k]) as f32);
        }
    });
    light
}

/// Where the wall lines of one column of pixels are.
struct WallColumn {
    /// Upper and lower, of bore and of outside.
    inner: [f64; 2],
    outer: [f64; 2],
}

impl WallColumn {
    fn new(camera: &Camera, capillary: &Capillary, u_px: f64) -> Self {
        let view = camera.view(0.0);
        let x_um = (u_px - camera.ux_px) / camera.kx_px_per_um;
        // The ray that grazes a cylinder meets it before its widest place.
        let line = |radius_um: f64| {
            let grazing = radius_um / (1.0 - (radius_um / camera.f_um).powi(2)).max(1e-6).sqrt();
            [-grazing, grazing].map(|y| view.project([x_um, y, 0.0]).v_px)
        };
        Self { inner: line(capillary.bore_radius_um()), outer: line(capillary.bore_radius_um() + capillary.glass_um) }
    }

    fn transmission(&self, v_px: f64, capillary: &Capillary) -> [f64; 3] {
        let mut out = [1.0; 3];
        for side in 0..2 {
            let outward = if side == 0 { -1.0 } else { 1.0 };
            // Distance outside the bore, and depth below the outer wall.
            let from_inner = outward * (v_px - self.inner[side]);
            let thickness = outward * (self.outer[side] - self.inner[side]);
            let across = from_inner / thickness.max(1e-6);
            let glass = if (0.0..=1.0).contains(&across) {
                let core = (-((across - 0.55) / 0.2).powi(2)).exp();
                capillary.glass_shade * (1.0 - core)
            } else {
                0.0
            };
            // A halo fades outwards from the inner line, as light bent by the wall's foot is missing there.
            let halo = if from_inner > 0.0 { 0.5 * capillary.wall_contrast * (-from_inner / 3.0).exp() } else { 0.0 };
            for (k, value) in out.iter_mut().enumerate() {
                // Colours meet the wall at slightly different places: a fringe, red outside and blue inside.
                let fringe = capillary.fringe_px * (1.0 - k as f64);
                let line = |at: f64, depth: f64| 1.0 - depth * (-0.5 * ((from_inner - at - fringe) / capillary.wall_line_px).powi(2)).exp();
                *value *=
                    line(0.0, capillary.wall_contrast) * line(thickness, 0.45 * capillary.wall_contrast) * (1.0 - glass) * (1.0 - halo);
            }
        }
        out
    }
}
