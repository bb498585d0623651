//! carved measures zebrafish larvae in 3D while they turn in the capillary of a VAST BioImager.
//!
//! This crate is the daemon and its commands. The science is `carved-core`, the devices are `carved-devices`:
//!
//! ```text
//! carved-core     <- carved-devices     values in, values out <- motors, cameras, samplers
//!        both     <- session <- http, cli                        edges: store, export, network
//! ```
//! Cargo's manifests hold the arrows between the crates, `tests/house.rs` those between the modules of this one. Only
//! `session` uses both the science and the devices; `http` sees the session's handle and snapshots.

pub mod cli;
pub mod config;
pub mod export;
pub mod http;
pub mod session;
pub mod store;
