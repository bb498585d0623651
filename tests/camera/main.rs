//! The camera driver against every fault of the emulated camera: real libaravis, real packets, and every accepted frame held against
//! what was truly exposed, and when.
#![cfg(feature = "aravis")]
// Helpers of tests fail like tests.
#![allow(clippy::unwrap_used)]

mod bench;
mod control;
mod frames;
mod numbers;
mod selection;
mod stale;
