//! Profiles of solids with known volume and area, without rendering. They make it possible to test a calibration and a measurement
//! with thousands of specimens.
//!
//! ```text
//!   Solid ── support function per slice ──► contour generator ──► project ──► union ──► outline (px)
//!     └────► truth: volume, area, ideal hull                                     │
//!                         Disturbance (seeded): camera error, slip, jitter ──────┴──► views
//!                                               shifts, uneven edges, faults
//! ```
//! Camera, angles and outlines are those of [`crate::scene`]; units um, px, rad.

mod contour;
mod disturbance;
mod larva;
mod loft;
mod phantom;
mod raster;
mod slice;
mod truth;
mod union;
mod views;

pub use disturbance::{Disturbance, Fault};
pub use phantom::{Phantom, Pose, SizeError};
pub use raster::coverage;
pub use views::View;
