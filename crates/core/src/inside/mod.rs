//! What lies inside a larva: organs that the views show through its body.
//!
//! ```text
//!  Picture + Profile ── Shade, per view: light that passed the specimen, of that beside it
//!                         │
//!  Shade x projections ─┬─ dark parts that all views agree on ── two ellipsoids ── Eyes
//!                       └─ dark rims with a bright middle ── one or two ellipsoids ── SwimBladder
//! ```
//! An organ that is not found is `None` with the reason. It is never 0.

mod bladder;
mod dark;
mod ellipsoid;
mod eyes;
mod fit;
mod shade;
#[cfg(test)]
mod tests;

pub(crate) use bladder::Trunk;
pub use bladder::{BladderMissing, BladderState, Lobe, SwimBladder};
pub use eyes::{BodySide, Eye, Eyes, EyesMissing};
pub use shade::Shade;

use crate::geometry::Projection;

/// A view of the specimen with its light.
#[derive(Clone, Copy)]
pub(crate) struct Lit<'a> {
    /// The calibrated projection.
    pub projection: &'a Projection,
    /// The light in it.
    pub shade: &'a Shade,
}
