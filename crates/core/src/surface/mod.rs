//! The surface of the hull as a mesh.
//!
//! ```text
//!  Carver ── Occupancy (binary, the paper's) ─┐
//!         ├─ Coarse (share of live voxels) ───┤
//!         └─ Distance (to the outlines, um) ──┴─ extract ── Mesh ── fair ── Mesh      Mesh + Projection ─┬─ silhouette
//!  Mask, outlines ── Contour ─┘                                                                     └─ with Picture: colours
//! ```
//! A [`Field`] tells which samples of a lattice are inside, block by block, and where its surface crosses between two of them.
//! [`extract`] runs welded marching cubes over the blocks that can contain surface. Meshes are closed, and their triangles turn
//! counter-clockwise seen from outside.

mod colours;
mod contour;
mod cube;
mod distance;
mod fairing;
mod field;
mod marching;
mod mesh;
mod occupancy;
mod silhouette;
#[cfg(test)]
pub(crate) mod topology;

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod tests;

pub use colours::Colours;
pub use contour::{Contour, ContourError};
pub use distance::Distance;
pub use fairing::{Fairing, FairingError, fair};
pub use field::{Field, Inside, SIDE};
pub use marching::extract;
pub use mesh::Mesh;
pub use occupancy::{Coarse, Occupancy};
pub use silhouette::silhouette;
