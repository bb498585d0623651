//! Spheres and ellipsoids: exact values, and fine meshes.

use super::Mesh;
use std::f64::consts::{PI, TAU};

pub fn ellipsoid_volume([a, b, c]: [f64; 3]) -> f64 {
    4.0 / 3.0 * PI * a * b * c
}

/// Surface of an ellipsoid: `Int sqrt((b c n_x)^2 + (a c n_y)^2 + (a b n_z)^2)` over the unit sphere. By the midpoint rule in
/// the height (smooth) and the trapezoid rule around (periodic): 1e-7 with these counts for half axes within 1 : 10.
pub fn ellipsoid_area([a, b, c]: [f64; 3]) -> f64 {
    let (heights, turns) = (4000, 256);
    let mut sum = 0.0;
    for i in 0..heights {
        let h = -1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(heights);
        let ring = (1.0 - h * h).sqrt();
        for k in 0..turns {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(turns)).sin_cos();
            sum += ((b * c * h).powi(2) + (a * c * ring * cos).powi(2) + (a * b * ring * sin).powi(2)).sqrt();
        }
    }
    sum * (2.0 / f64::from(heights)) * (TAU / f64::from(turns))
}

/// An ellipsoid around `centre` as `rings` rings of `segments` points on its surface.
pub fn ellipsoid_mesh(centre: [f64; 3], half_axes: [f64; 3], rings: u32, segments: u32) -> Mesh {
    let point = |polar: f64, turn: f64| {
        let unit = [-polar.cos(), polar.sin() * turn.cos(), polar.sin() * turn.sin()];
        std::array::from_fn(|i| centre[i] + half_axes[i] * unit[i])
    };
    let rows: Vec<Vec<[f64; 3]>> = (1..rings)
        .map(|i| (0..segments).map(|k| point(PI * f64::from(i) / f64::from(rings), TAU * f64::from(k) / f64::from(segments))).collect())
        .collect();
    Mesh::lofted(point(0.0, 0.0), &rows, point(PI, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_integral_gives_the_sphere_and_the_spheroid() {
        let r: f64 = 250.0;
        assert!((ellipsoid_area([r; 3]) / (4.0 * PI * r * r) - 1.0).abs() < 1e-7);
        // Prolate spheroid: 2 pi a^2 (1 + c / (a e) asin e).
        let (a, c): (f64, f64) = (100.0, 300.0);
        let e = (1.0 - a * a / (c * c)).sqrt();
        let exact = 2.0 * PI * a * a * (1.0 + c / (a * e) * e.asin());
        assert!((ellipsoid_area([c, a, a]) / exact - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_mesh_is_the_ellipsoid_within_its_facets() {
        let half = [400.0, 200.0, 150.0];
        let mesh = ellipsoid_mesh([10.0, 20.0, 30.0], half, 200, 256).closed().unwrap();
        // Inscribed facets lose (2 pi / 256)^2 / 6 of each section and (pi / 200)^2 / 6 or so along the axis: 1.5e-4.
        assert!((1.0 - mesh.volume() / ellipsoid_volume(half)).abs() < 3e-4);
        assert!((1.0 - mesh.area() / ellipsoid_area(half)).abs() < 3e-4);
    }
}
