//! The shape of a specimen: numbers that need only its surface.
//!
//! ```text
//!  Mesh ─┬─ Solid       volume, area, centroid, principal moments and axes, sphericity
//!        └─ Axis ─┬──── Body        length, head, dorsal, bending, 100 slices across the axis, frame of its own
//!                 └──── Harmonics   power of the surface per degree of the spherical harmonics
//! ```
//! `docs/shape.md` has the formulas. Each part is either there or has a reason: what a mesh does not determine is not guessed.
//! All sums are in a fixed order, so that the same mesh gives the same bits on any number of threads.

mod axis;
mod body;
mod harmonics;
mod orientation;
mod section;
mod solid;

pub use axis::STATIONS;
pub use body::{Bending, Body, Station, ToBody};
pub use harmonics::{Harmonics, MAX_DEGREE};
pub use orientation::{Dorsal, End, Head};
pub use solid::Solid;

use super::Estimator;
use crate::surface::Mesh;
use serde::{Deserialize, Serialize};

type Vector = nalgebra::Vector3<f64>;

/// Shape of a closed mesh in um.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Shape {
    /// The estimator that made the surface. Its volume and area are `field_volume_um3` and `field_area_um2`, not `volume_um3` and
    /// `area_um2`.
    #[serde(default = "field")]
    pub estimator: Estimator,
    /// Numbers of the whole solid. `None` with `solid_reason`.
    pub solid: Option<Solid>,
    /// Why there is no `solid`. There is then no other part either.
    pub solid_reason: Option<String>,
    /// The body along its axis. `None` with `body_reason`.
    pub body: Option<Body>,
    /// Why there is no `body`.
    pub body_reason: Option<String>,
    /// Power of the surface per degree. `None` with `harmonics_reason`.
    pub harmonics: Option<Harmonics>,
    /// Why there are no `harmonics`.
    pub harmonics_reason: Option<String>,
}

/// Why a part of the shape cannot be computed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub(crate) enum Refusal {
    #[error("the surface is not closed: its area vectors leave {open_um2:.3e} um^2 instead of 0. Close its holes first")]
    Open { open_um2: f64 },
    #[error("{triangles} triangles enclose {volume_um3:.3e} um^3; a shape needs a solid whose triangles turn outwards")]
    NoVolume { triangles: usize, volume_um3: f64 },
    #[error("{empty} of 100 slices across the body hold nothing: the surface is in pieces, or bent so much that no axis was found")]
    Slices { empty: usize },
    #[error(
        "neighbouring slices across the body axis meet within the body ({corners} corners of triangles): it is bent more sharply than it is thick"
    )]
    Folded { corners: usize },
    #[error(
        "the slices across the body axis hold {share:.3} of the volume instead of 1: the body is bent or branched so much that they do not follow it"
    )]
    Volume { share: f64 },
    #[error("the harmonics need a body axis, and none was found")]
    NoAxis,
    #[error(
        "{rays} of {of} rays across the body axis meet the surface several times or never: its slices are not star-shaped around their centres"
    )]
    Star { rays: usize, of: usize },
}

impl Shape {
    /// Measures a closed mesh whose triangles turn counter-clockwise seen from outside, in um.
    pub fn of(mesh: &Mesh) -> Self {
        let (solid, solid_reason) = value_or_reason(Solid::of(mesh));
        // A fin that breaks off in noise leaves slices that hold nothing. Without what is loose, the slices must still hold the volume.
        let found = solid
            .as_ref()
            .map(|solid| along(mesh, solid).or_else(|why| mesh.largest_piece().and_then(|piece| along(&piece, solid).ok()).ok_or(why)));
        let (found, body_reason) = found.map_or((None, None), value_or_reason);
        let (body, harmonics) = found.unzip();
        let (harmonics, harmonics_reason) = match (harmonics, &body_reason) {
            (Some(harmonics), _) => value_or_reason(harmonics),
            (None, Some(_)) => value_or_reason(Err(Refusal::NoAxis)),
            (None, None) => (None, None),
        };
        Self { estimator: field(), solid, solid_reason, body, body_reason, harmonics, harmonics_reason }
    }
}

/// What is measured along the body axis.
fn along(mesh: &Mesh, solid: &Solid) -> Result<(Body, Result<Harmonics, Refusal>), Refusal> {
    let (body, slices) = body::measure(mesh, solid)?;
    Ok((body, Harmonics::of(mesh, &slices)))
}

/// The estimator of every surface that a shape is measured of.
fn field() -> Estimator {
    Estimator::Field
}

fn value_or_reason<T>(result: Result<T, Refusal>) -> (Option<T>, Option<String>) {
    match result {
        Ok(value) => (Some(value), None),
        Err(refusal) => (None, Some(refusal.to_string())),
    }
}

#[cfg(test)]
mod tests;
