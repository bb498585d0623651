//! The drivers against emulated controllers, cameras and samplers.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

#[path = "../common/mod.rs"]
mod common;

mod camera;
mod driver;
#[cfg(feature = "aravis")]
mod motion;
mod motion_bridge;
mod motion_grbl;
mod motion_relay;
mod motion_tmcl;
mod motion_zaber;
mod oracles;
mod outputs;
mod sampler;
mod sweep;
mod wire;
