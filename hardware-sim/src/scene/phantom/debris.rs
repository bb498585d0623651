//! Debris: small opaque objects in the tubing. Chips have a few flat faces, fibres are thin and curved.
//!
//! ```text
//!      __               ______
//!     /  \__           /      \____
//!     \____/    chip  /            \   fibre
//! ```

use super::{Material, Mesh, SizeError, Specimen, positive};
use crate::scene::seeded::{Seeded, mixed};
use std::f64::consts::{PI, TAU};

impl Specimen {
    /// A chip that fits into a sphere of the diameter `size_um`.
    ///
    /// # Errors
    /// The size is not a positive length.
    pub fn chip(size_um: f64, seed: u64) -> Result<Self, SizeError> {
        let radius = positive("chip size", size_um)? / 2.0;
        Ok(Self::debris(format!("chip of {size_um} um, seed {seed}"), chip(radius, seed)))
    }

    /// A fibre that fits into a sphere of the diameter `length_um`.
    ///
    /// # Errors
    /// The length is not positive.
    pub fn fibre(length_um: f64, seed: u64) -> Result<Self, SizeError> {
        Ok(Self::debris(format!("fibre of {length_um} um, seed {seed}"), fibre(positive("fibre length", length_um)?, seed)))
    }

    fn debris(name: String, mesh: Mesh) -> Self {
        let mut debris = Self::mesh(mesh).of_material(Material::DEBRIS);
        debris.name = name;
        debris
    }
}

/// A sphere that is cut by a few planes.
fn chip(radius: f64, seed: u64) -> Mesh {
    let mut seeded = Seeded::new(mixed(seed ^ 0xC41F));
    let faces: Vec<([f64; 3], f64)> = (0..11)
        .map(|_| {
            let height = seeded.between(-1.0, 1.0);
            let (sin, cos) = seeded.between(0.0, TAU).sin_cos();
            let ring = (1.0f64 - height * height).sqrt();
            ([height, ring * cos, ring * sin], radius * seeded.between(0.3, 0.85))
        })
        .collect();
    let surface = |polar: f64, turn: f64| {
        let unit = [-polar.cos(), polar.sin() * turn.cos(), polar.sin() * turn.sin()];
        let r = faces.iter().fold(radius, |r, (normal, distance)| {
            let towards: f64 = (0..3).map(|i| normal[i] * unit[i]).sum();
            if towards > 0.0 { r.min(distance / towards) } else { r }
        });
        unit.map(|u| u * r)
    };
    let (rings, segments) = (40u32, 56u32);
    let rows: Vec<Vec<[f64; 3]>> = (1..rings)
        .map(|i| (0..segments).map(|k| surface(PI * f64::from(i) / f64::from(rings), TAU * f64::from(k) / f64::from(segments))).collect())
        .collect();
    Mesh::lofted(surface(0.0, 0.0), &rows, surface(PI, 0.0))
}

/// A tube along a bent line in a random direction, 6 to 16 um thick.
fn fibre(length: f64, seed: u64) -> Mesh {
    let mut seeded = Seeded::new(mixed(seed ^ 0xF1B3));
    let radius = (length / 20.0).min(seeded.between(3.0, 8.0));
    let (bow, wave) = (seeded.between(-0.25, 0.25), seeded.between(-0.06, 0.06));
    let phase = seeded.between(0.0, TAU);
    let (yaw, pitch) = (seeded.between(-1.2, 1.2), seeded.between(-0.6, 0.6));
    let rings = 60u32;
    // The chord is 0.8 of the diameter, so that bow, wave and thickness stay within the sphere.
    let row = |i: u32| -> Vec<[f64; 3]> {
        let t = f64::from(i) / f64::from(rings) * 2.0 - 1.0;
        let (y, z) = (length * bow * (0.5 - t * t), length * wave * (3.0 * t + phase).sin());
        let r = radius * (1.0 - t.powi(8)).max(0.0).sqrt();
        (0..16).map(|k| (TAU * f64::from(k) / 16.0).sin_cos()).map(|(sin, cos)| [0.4 * length * t, y + r * cos, z + r * sin]).collect()
    };
    let rows: Vec<_> = (1..rings).map(row).collect();
    let tip = |i: u32| row(i)[0];
    let (sin_yaw, cos_yaw) = yaw.sin_cos();
    let (sin_pitch, cos_pitch) = pitch.sin_cos();
    Mesh::lofted(tip(0), &rows, tip(rings)).mapped(|[x, y, z]| {
        let (x, y) = (x * cos_yaw - y * sin_yaw, x * sin_yaw + y * cos_yaw);
        [x * cos_pitch - z * sin_pitch, y, x * sin_pitch + z * cos_pitch]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debris_is_closed_and_fits_into_its_sphere() {
        for seed in 0..30 {
            for size in [30.0, 120.0, 300.0] {
                for mesh in [chip(size / 2.0, seed), fibre(size, seed)] {
                    let mesh = mesh.closed().unwrap();
                    let reach = mesh.vertices.iter().map(|v| v[0].hypot(v[1]).hypot(v[2])).fold(0.0, f64::max);
                    assert!(reach <= size / 2.0 + 1e-9, "seed {seed}, {size} um: reaches {reach}");
                    assert!(reach > size / 5.0, "seed {seed}, {size} um: reaches only {reach}");
                }
            }
        }
        assert_ne!(chip(50.0, 1), chip(50.0, 2));
    }
}
