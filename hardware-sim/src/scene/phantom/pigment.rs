//! Pigment cells and other small dark marks: soft absorbing balls at points of the specimen.

use crate::scene::seeded::Seeded;
use std::f64::consts::TAU;

/// A ball that absorbs all colours alike; `density` is its optical density through the middle (natural logarithm), below 0
/// where it is clearer than its surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    pub at_um: [f64; 3],
    pub radius_um: f64,
    pub density: f64,
}

/// A melanophore: a dark middle with arms that spread in the surface around it. `across` lies in that surface, across the body.
pub fn melanophore(at_um: [f64; 3], across: [f64; 3], size_um: f64, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
    spots.push(Spot { at_um, radius_um: size_um, density: 2.0 });
    let arms = 3 + seeded.between(0.0, 4.0) as u32;
    for _ in 0..arms {
        let (sin, cos) = seeded.between(0.0, TAU).sin_cos();
        let reach = seeded.between(0.8, 2.2) * size_um;
        // Arms spread along the body more than across it.
        let offset = [1.5 * reach * cos, reach * sin * across[1], reach * sin * across[2]];
        spots.push(Spot {
            at_um: std::array::from_fn(|i| at_um[i] + offset[i]),
            radius_um: size_um * seeded.between(0.4, 0.7),
            density: seeded.between(0.8, 1.6),
        });
    }
}
