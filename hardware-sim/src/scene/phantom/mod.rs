//! Specimens and clutter with their true values.
//!
//! ```text
//!   larva(dpf, seed)  bead  ellipsoid  mesh          each is a list of parts: closed mesh + material (what the optics see)
//!   dead_larva          \      |        /            plus spots of pigment,
//!   bubble  plug  chip  fibre  |       |             plus Truth (the reference for a measurement)
//! ```
//! Each specimen is made in its own frame (um; x along the capillary, y down, z away from the camera at angle 0) and then placed in the
//! bore once.

mod bubble;
mod dead;
mod debris;
mod hull;
mod larva;
mod mesh;
mod pigment;
mod placement;
mod solid;
mod spline;
mod truth;

pub use hull::{Hull, ideal_hull};
pub use larva::{Bladder, Condition, Larva, LarvaError, Look, OrganTruth};
pub use mesh::{Mesh, MeshError};
pub use pigment::Spot;
pub use placement::{Narrowest, Placement, PlacementError};
pub use truth::Truth;

use serde::{Deserialize, Serialize};
use truth::AskedTruth;

/// Optical properties of a part, relative to its surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Extinction of red, green and blue.
    pub absorption_per_mm: [f64; 3],
    /// Refractive index minus that of the surrounding part. It bends light, which makes dark rims.
    pub index_step: f64,
}

impl Material {
    /// Living tissue: pale yellowish-brown, index 1.36 in water.
    pub const TISSUE: Self = Self { absorption_per_mm: [1.05, 1.25, 1.65], index_step: 0.024 };
    /// Polystyrene of beads: translucent with a broad dark rim.
    pub const POLYSTYRENE: Self = Self { absorption_per_mm: [0.30, 0.32, 0.36], index_step: 0.045 };
    /// Air in water.
    pub const AIR: Self = Self { absorption_per_mm: [0.0; 3], index_step: -0.333 };
    /// Opaque chips and fibres: 30 um transmit a third of the light.
    pub const DEBRIS: Self = Self { absorption_per_mm: [34.0, 37.0, 42.0], index_step: 0.1 };
}

impl Material {
    /// The same material with its absorption times `factor`.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { absorption_per_mm: self.absorption_per_mm.map(|a| factor * a), ..self }
    }
}

/// A closed surface of one material.
#[derive(Debug, Clone)]
pub struct Part {
    pub mesh: Mesh,
    pub material: Material,
    pub within_body: Within,
}

/// The meaning of a part where it overlaps the body, which is the first part of a specimen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Within {
    /// An organ: its material is added to that of the body.
    Added,
    /// An outgrowth: only its part outside the body counts.
    Replaced,
}

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SizeError {
    #[error("{name} is {found} um; it must be a finite number above 0")]
    NotPositive { name: &'static str, found: f64 },
}

/// Something that can be loaded into the capillary.
#[derive(Debug, Clone)]
pub struct Specimen {
    pub(crate) name: String,
    pub(crate) parts: Vec<Part>,
    pub(crate) spots: Vec<Spot>,
    pub(crate) placement: Placement,
    truth: AskedTruth,
}

impl Specimen {
    /// A larva of 2 to 7 days, with its own variation by `seed`.
    ///
    /// # Errors
    /// Refuses other ages.
    pub fn larva(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        Ok(Larva::new(dpf, seed)?.specimen())
    }

    /// # Errors
    /// Refuses a diameter that is no positive length.
    pub fn bead(diameter_um: f64) -> Result<Self, SizeError> {
        let r = positive("bead diameter", diameter_um)? / 2.0;
        let mut bead = Self::ellipsoid([r; 3])?;
        bead.name = format!("bead of {diameter_um} um");
        bead.truth = bead.truth.of_sphere(diameter_um);
        bead.parts[0].material = Material::POLYSTYRENE;
        Ok(bead)
    }

    /// An ellipsoid with the given half axes along x, y and z.
    ///
    /// # Errors
    /// Refuses half axes that are no positive lengths.
    pub fn ellipsoid(half_axes_um: [f64; 3]) -> Result<Self, SizeError> {
        for a in half_axes_um {
            positive("ellipsoid half axis", a)?;
        }
        Ok(Self {
            name: format!("ellipsoid of half axes {half_axes_um:?} um"),
            parts: vec![Part {
                mesh: solid::ellipsoid_mesh([0.0; 3], half_axes_um, 200, 256),
                material: Material::TISSUE,
                within_body: Within::Added,
            }],
            spots: Vec::new(),
            placement: Placement::default(),
            // A convex solid is its own hull.
            truth: AskedTruth::by(move || {
                let (volume_um3, area_um2) = (solid::ellipsoid_volume(half_axes_um), solid::ellipsoid_area(half_axes_um));
                let length_um = 2.0 * half_axes_um[0];
                Truth { volume_um3, area_um2, hull_volume_um3: volume_um3, hull_area_um2: area_um2, length_um, diameter_um: None }
            }),
        })
    }

    /// A closed mesh, um, with x along the capillary. [`Mesh::laid_along_x`] rotates a mesh so.
    pub fn mesh(mesh: Mesh) -> Self {
        let measured = mesh.clone();
        Self {
            name: format!("mesh of {} triangles", mesh.triangles.len()),
            truth: AskedTruth::by(move || Truth::of_mesh(&measured)),
            parts: vec![Part { mesh, material: Material::TISSUE, within_body: Within::Added }],
            spots: Vec::new(),
            placement: Placement::default(),
        }
    }

    #[must_use]
    pub fn placed(mut self, placement: Placement) -> Self {
        self.placement = placement;
        self
    }

    #[must_use]
    pub fn of_material(mut self, material: Material) -> Self {
        if let Some(body) = self.parts.first_mut() {
            body.material = material;
        }
        self
    }

    pub fn truth(&self) -> Truth {
        self.truth.get()
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn placement(&self) -> Placement {
        self.placement
    }

    pub(crate) fn points(&self) -> impl Iterator<Item = &[f64; 3]> {
        self.parts.iter().flat_map(|part| &part.mesh.vertices)
    }

    pub(crate) fn move_all(&mut self, map: impl Fn([f64; 3]) -> [f64; 3]) {
        for part in &mut self.parts {
            for v in &mut part.mesh.vertices {
                *v = map(*v);
            }
        }
        for spot in &mut self.spots {
            spot.at_um = map(spot.at_um);
        }
    }
}

fn positive(name: &'static str, found: f64) -> Result<f64, SizeError> {
    if found.is_finite() && found > 0.0 { Ok(found) } else { Err(SizeError::NotPositive { name, found }) }
}

#[cfg(test)]
mod tests;
