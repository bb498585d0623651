//! Pixels: pictures, planes of numbers, masks, regions, outlines.
//!
//! ```text
//!   RawFrame ── bayer ──> Picture ──> Plane      Mask <── outline <── polygons
//!                      └──> damage                 └──> region, chamfer, columns
//! ```

pub(super) mod bayer;
pub(super) mod chamfer;
pub(super) mod columns;
pub(super) mod damage;
pub(super) mod mask;
pub(super) mod outline;
pub(super) mod path;
pub(super) mod picture;
pub(super) mod plane;
pub(super) mod region;
