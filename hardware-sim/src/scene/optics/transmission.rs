//! The transmission of the specimens, per pixel and colour.

use super::{Optics, Window};
use crate::scene::camera::{Camera, View};
use crate::scene::phantom::{Material, Spot};
use rayon::prelude::*;

/// Transmission of all pixels of the window. `parts` are thickness planes of the window's samples with their materials.
pub fn transmission(
    parts: &[(Vec<f32>, Material)],
    spots: &[Spot],
    camera: &Camera,
    view: &View,
    optics: &Optics,
    window: &Window,
) -> Vec<[f32; 3]> {
    let (columns, rows) = (window.columns(), window.rows());
    let path: Vec<f32> = (0..columns * rows)
        .into_par_iter()
        .map(|i| parts.iter().map(|(plane, material)| plane[i] * material.index_step as f32).sum())
        .collect();
    let pigment = pigment(spots, camera, view, optics, window);
    // Slope of the optical path per um of object, by differences over two samples.
    let per_u = (camera.kx_px_per_um * window.fine_u as f64 / 2.0) as f32;
    let per_v = (camera.ky_px_per_um * window.fine_v as f64 / 2.0) as f32;
    let (aperture, stray, lamp) = (optics.aperture_rad as f32, optics.stray_light as f32, optics.lamp_tilt_rad as f32);
    let veil = optics.veil as f32;
    let samples_per_pixel = (window.fine_u * window.fine_v) as f32;

    let mut out = vec![[0.0f32; 3]; window.width * window.height];
    out.par_chunks_mut(window.width).enumerate().for_each(|(v, pixels)| {
        for row in v * window.fine_v..(v + 1) * window.fine_v {
            let (above, below) = (row.saturating_sub(1) * columns, (row + 1).min(rows - 1) * columns);
            for column in 0..columns {
                let i = row * columns + column;
                let mut density = [0.0f32; 3];
                let mut inside = false;
                for (plane, material) in parts {
                    if plane[i] > 0.0 {
                        inside = true;
                        for (d, a) in density.iter_mut().zip(material.absorption_per_mm) {
                            *d += plane[i] * 1e-3 * a as f32;
                        }
                    }
                }
                let pixel = &mut pixels[column / window.fine_u];
                if !inside {
                    for p in pixel.iter_mut() {
                        *p += 1.0;
                    }
                    continue;
                }
                let (left, right) = (column.saturating_sub(1), (column + 1).min(columns - 1));
                let slope_u = (path[row * columns + right] - path[row * columns + left]) * per_u;
                let slope_v = (path[below + column] - path[above + column]) * per_v;
                // The light comes a little from above, so that rays bent downwards miss the lens sooner.
                let lost = slope_u * slope_u + slope_v * (slope_v + 2.0 * lamp);
                let bent = lost.max(0.0) / (aperture * aperture);
                let caught = stray + (1.0 - stray) / (1.0 + bent * bent);
                for (p, d) in pixel.iter_mut().zip(density) {
                    *p += veil + (1.0 - veil) * caught * (-(d + pigment[i]).max(0.0)).exp();
                }
            }
        }
        for pixel in pixels.iter_mut() {
            for p in pixel.iter_mut() {
                *p /= samples_per_pixel;
            }
        }
    });
    out
}

/// A projected spot, in samples.
struct Disc {
    x: f64,
    y: f64,
    radius_x: f64,
    radius_y: f64,
    density: f64,
}

impl Disc {
    /// A spot out of focus is wider, and paler in proportion to its area.
    fn seen(spot: &Spot, camera: &Camera, view: &View, optics: &Optics, window: &Window) -> Self {
        let p = view.project(spot.at_um);
        let (x, y) = window.to_samples(p.u_px, p.v_px);
        let radius_um = spot.radius_um.hypot(optics.defocus_rad * (p.depth_um - camera.f_um));
        Self {
            x,
            y,
            radius_x: radius_um * camera.kx_px_per_um * window.fine_u as f64,
            radius_y: radius_um * camera.ky_px_per_um * window.fine_v as f64,
            density: spot.density * (spot.radius_um / radius_um).powi(2),
        }
    }

    /// Adds its density to the samples of some rows.
    fn draw(&self, columns: usize, first_row: usize, rows: &mut [f32]) {
        let last_row = first_row + rows.len() / columns;
        let span = |at: f64, radius: f64, from: usize, to: usize| {
            let first = (at - REACH * radius).ceil().max(from as f64) as usize;
            let end = (at + REACH * radius).floor().min(to as f64 - 1.0) + 1.0;
            first..end.max(0.0) as usize
        };
        for row in span(self.y, self.radius_y, first_row, last_row) {
            let dy = (row as f64 - self.y) / self.radius_y;
            let start = (row - first_row) * columns;
            for column in span(self.x, self.radius_x, 0, columns) {
                let dx = (column as f64 - self.x) / self.radius_x;
                // Flat in the middle, 0 at its border.
                let fall = (1.0 - ((dx * dx + dy * dy) / (REACH * REACH)).powi(2)).max(0.0);
                rows[start + column] += (self.density * fall) as f32;
            }
        }
    }
}

/// Reach of a spot, in its radii.
const REACH: f64 = 1.3;
/// Pigment consists of grains with gaps: a twentieth of the light passes through any number of cells.
const DENSEST: f32 = 3.0;
/// Rows of samples that one task draws.
const BAND: usize = 64;

/// Optical density of all spots per sample.
fn pigment(spots: &[Spot], camera: &Camera, view: &View, optics: &Optics, window: &Window) -> Vec<f32> {
    let columns = window.columns();
    let discs: Vec<Disc> = spots.iter().map(|spot| Disc::seen(spot, camera, view, optics, window)).collect();
    let mut plane = vec![0.0f32; columns * window.rows()];
    plane.par_chunks_mut(columns * BAND).enumerate().for_each(|(band, rows)| {
        for disc in &discs {
            disc.draw(columns, band * BAND, rows);
        }
        for density in rows.iter_mut().filter(|d| **d > 0.2) {
            *density = DENSEST * (1.0 - (-*density / DENSEST).exp());
        }
    });
    plane
}
