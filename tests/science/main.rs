//! Segmentation, calibration, measuring and quality on inputs whose truth is known.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

#[path = "../common/mod.rs"]
mod common;

mod any_picture;
mod bead_gate;
mod beads;
mod calibrate_rig;
mod calibrate_specimen;
mod calibration;
mod closures;
mod detection;
mod independent;
mod inside;
mod profile_truth;
mod quality;
mod refine;
mod shape;
mod standard;
mod truth;
mod turning;
mod vrv;
#[path = "../../crates/core/tests/second_renderer/wrong_turns.rs"]
mod wrong_turns;
