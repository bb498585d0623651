//! A dead larva: opaque and clouded tissue, no fin fold, no air in its bladder, a curled tail.

use super::larva::{Larva, LarvaError};
use super::{Material, Specimen};
use crate::scene::seeded::{Seeded, mixed};

/// Clotted tissue: greyish brown, several times darker than living tissue.
const CLOTTED: Material = Material { absorption_per_mm: [4.2, 4.8, 5.8], index_step: 0.03 };

/// The part of the body that stays straight, and the angle by which the tail is curled.
const STRAIGHT: f64 = 0.3;
const CURL_UM: [f64; 2] = [200.0, 260.0];

/// Clouds in living tissue are fainter than this optical density. Darker spots are pigment.
const FAINT: f64 = 0.6;
/// Clouds of clotted tissue are stronger by this factor, and darker than their surroundings.
const CLOUDED: f64 = 3.5;
const CLEAREST: f64 = -0.2;

impl Specimen {
    /// A dead larva: the shape of the living one of this seed, with its tail curled to one side. Its true values are those of the drawn
    /// mesh.
    ///
    /// # Errors
    /// The age is not 2 to 7 dpf.
    pub fn dead_larva(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        let mut dead = Larva::new(dpf, seed)?.without_fins().specimen();
        let body = |dead: &Self| dead.parts.first().map(|part| part.mesh.clone()).unwrap_or_default();
        let [nose_um, tail_um] = body(&dead).bounds()[0];
        let mut seeded = Seeded::new(mixed(seed ^ 0xDEAD));
        // Towards the belly or to a side, because the tail is high in the bore.
        let (sin, cos) = seeded.between(-1.4, 1.4).sin_cos();
        let curl = seeded.between(CURL_UM[0], CURL_UM[1]);
        dead.move_all(|[x, y, z]| {
            let behind = (((x - nose_um) / (tail_um - nose_um) - STRAIGHT) / (1.0 - STRAIGHT)).max(0.0);
            let aside = curl * behind * behind;
            [x, y + aside * cos, z + aside * sin]
        });
        // Parts with a negative index step are air or clear tissue. A dead larva has neither.
        dead.parts.retain(|part| part.material.index_step >= 0.0);
        for spot in dead.spots.iter_mut().filter(|spot| spot.density.abs() < FAINT) {
            spot.density = (CLOUDED * spot.density).max(CLEAREST);
            spot.radius_um *= 1.2;
        }
        dead.truth = Self::mesh(body(&dead)).truth;
        dead.name = format!("dead larva of {dpf} dpf, seed {seed}");
        Ok(dead.of_material(CLOTTED))
    }
}
