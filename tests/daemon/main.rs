//! The daemon, started as a user starts it, on emulated devices.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

#[path = "../common/mod.rs"]
mod common;

mod accepted;
mod bead_gate;
mod calibration_status;
mod camera_lost;
mod closed_pipe;
mod controllers;
mod disk_full;
mod early_stop;
mod folder;
mod live_estimate;
#[cfg(feature = "aravis")] // the tests that use it need a camera
mod monitoring;
mod one_well;
mod optics;
mod outputs;
mod replay;
mod run_life;
mod second_camera;
mod serve;
mod start;
mod stuck_camera;
mod sweep;
mod systemd;
mod taken_out;
mod translation;
mod vast;
