//! The camera driver against every fault of the emulated camera, with real libaravis and real packets. Every accepted frame is compared
//! with the exposure and its time.
#![cfg(feature = "aravis")]

mod bench;
mod control;
mod features;
mod frames;
mod numbers;
mod selection;
mod stale;
mod stream;
