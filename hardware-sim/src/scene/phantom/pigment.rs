//! Pigment cells and other small marks: soft absorbing spheres at points of the specimen.
//!
//! ```text
//!        o o
//!    o  o     o o          a melanophore: an uneven middle of some spheres, and arms that get thinner and fork
//!      O@@O oo   o
//!    o  @@O
//!   o      o o o
//! ```

use crate::scene::seeded::Seeded;
use std::f64::consts::TAU;

/// A sphere that absorbs all colours equally. `density` is its optical density through the middle (natural logarithm). It is negative if
/// the sphere is clearer than its surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    pub at_um: [f64; 3],
    pub radius_um: f64,
    pub density: f64,
}

/// A star-shaped cell of about `size_um` from its middle to the beginning of the arms. `place` returns the point of the skin at these
/// distances along and across the body from the middle of the cell.
pub fn melanophore(place: impl Fn(f64, f64) -> [f64; 3], size_um: f64, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
    let mut put = |at: [f64; 2], radius_um: f64, density: f64| spots.push(Spot { at_um: place(at[0], at[1]), radius_um, density });
    for _ in 0..5 {
        let at = [seeded.normal(0.42 * size_um), seeded.normal(0.42 * size_um)];
        put(at, size_um * seeded.between(0.35, 0.75), seeded.between(0.5, 1.8));
    }
    let arms = seeded.between(2.0, 7.0) as u32;
    let turn = seeded.between(0.0, TAU);
    for arm in 0..arms {
        let mut heading = turn + TAU * f64::from(arm) / f64::from(arms) + seeded.normal(0.5);
        let (sin, cos) = heading.sin_cos();
        let mut at = [0.5 * size_um * cos, 0.5 * size_um * sin];
        let mut radius_um = size_um * seeded.between(0.16, 0.30);
        for _ in 0..seeded.between(2.0, 7.0) as u32 {
            heading += seeded.normal(0.45);
            let (sin, cos) = heading.sin_cos();
            let step = 1.1 * radius_um.max(2.5);
            at = [at[0] + step * cos, at[1] + step * sin];
            put(at, radius_um.max(2.5), seeded.between(0.5, 1.4));
            radius_um *= 0.86;
            if seeded.between(0.0, 1.0) < 0.15 {
                // A fork: a branch beside the arm, with its own length.
                let (sin, cos) = (heading + if seeded.between(0.0, 1.0) < 0.5 { 0.9 } else { -0.9 }).sin_cos();
                put([at[0] + step * cos, at[1] + step * sin], (0.8 * radius_um).max(2.5), 0.9);
                put([at[0] + 2.0 * step * cos, at[1] + 2.0 * step * sin], (0.65 * radius_um).max(2.5), 0.7);
            }
        }
    }
}
