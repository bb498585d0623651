//! A second renderer of frames.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

mod cases;
mod checks;
mod dust;
mod judge;
mod optics;
mod pictures;
mod random;
mod scene;
mod segmentation;
mod shape;
mod volume;
