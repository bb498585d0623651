//! Air in the capillary: round bubbles, and plugs that fill the bore.
//!
//! ```text
//!    round    (####)        plug   --(################)--   as wide as the bore but for a film of water,
//!             (#..#)                 (################)     with rounded ends
//!             (####)               --(################)--
//! ```
//! Air bends light so much that only rays next to its middle reach the lens. It is black with a small bright centre.

use super::{Material, Mesh, SizeError, Specimen, positive};
use std::f64::consts::{FRAC_PI_2, TAU};

impl Specimen {
    /// A round bubble.
    ///
    /// # Errors
    /// The diameter is not a positive length.
    pub fn bubble(diameter_um: f64) -> Result<Self, SizeError> {
        let r = positive("bubble diameter", diameter_um)? / 2.0;
        let mut bubble = Self::ellipsoid([r; 3])?.of_material(Material::AIR);
        bubble.name = format!("bubble of {diameter_um} um");
        bubble.truth = bubble.truth.of_sphere(diameter_um);
        Ok(bubble)
    }

    /// A bubble that fills the bore: a cylinder with rounded ends, `length_um` from tip to tip.
    ///
    /// # Errors
    /// A size is not a positive length.
    pub fn plug(length_um: f64, diameter_um: f64) -> Result<Self, SizeError> {
        let (length, r) = (positive("plug length", length_um)?, positive("plug diameter", diameter_um)? / 2.0);
        let mut plug = Self::mesh(capsule(length, r)).of_material(Material::AIR);
        plug.name = format!("plug of {length_um} um x {diameter_um} um");
        Ok(plug)
    }
}

/// Ends are half ellipsoids, and half spheres if the length allows it.
fn capsule(length: f64, radius: f64) -> Mesh {
    const RINGS: u32 = 48;
    let end = radius.min(length / 2.0);
    let ring = |x: f64, r: f64| -> Vec<[f64; 3]> {
        (0..192).map(|k| (TAU * f64::from(k) / 192.0).sin_cos()).map(|(sin, cos)| [x, r * cos, r * sin]).collect()
    };
    let cap = |side: f64| {
        (1..=RINGS).map(move |i| (FRAC_PI_2 * f64::from(i) / f64::from(RINGS)).sin_cos()).map(move |(sin, cos)| {
            let x = side * (length / 2.0 - end + end * cos);
            (x, radius * sin)
        })
    };
    let mut stations: Vec<_> = cap(-1.0).collect();
    let mut last: Vec<_> = cap(1.0).collect();
    last.reverse();
    if length > 2.0 * end {
        stations.append(&mut last);
    } else {
        // Both caps end in the same widest ring.
        stations.extend(last.into_iter().skip(1));
    }
    let rows: Vec<_> = stations.into_iter().map(|(x, r)| ring(x, r)).collect();
    Mesh::lofted([-length / 2.0, 0.0, 0.0], &rows, [length / 2.0, 0.0, 0.0])
}

#[cfg(test)]
mod tests {
    use super::super::solid;
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn a_plug_is_a_cylinder_with_half_balls_and_a_short_one_an_ellipsoid() {
        let (length, r) = (1500.0, 300.0);
        let exact = PI * r * r * (length - 2.0 * r) + 4.0 / 3.0 * PI * r * r * r;
        // 192 sides lose (2 pi / 192)^2 / 6 = 1.8e-4 of each section.
        let off = capsule(length, r).closed().unwrap().volume() / exact - 1.0;
        assert!(off.abs() < 5e-4, "{off:.2e}");
        let short = capsule(400.0, r).closed().unwrap().volume() / solid::ellipsoid_volume([200.0, r, r]) - 1.0;
        assert!(short.abs() < 8e-4, "{short:.2e}");
    }
}
