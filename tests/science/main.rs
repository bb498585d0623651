//! Segmentation, calibration, measuring and quality on inputs whose truth is known.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

#[path = "../beads/mod.rs"]
mod beads;
#[path = "../closures/mod.rs"]
mod closures;
#[path = "../common/mod.rs"]
mod common;
#[path = "../truth/mod.rs"]
mod truth;

mod any_picture;
mod bead_gate;
mod calibrate_rig;
mod calibrate_specimen;
mod calibration;
mod detection;
mod independent;
mod profile_truth;
mod quality;
mod refine;
mod shape;
mod vrv;
