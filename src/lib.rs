//! carved measures zebrafish larvae in 3D while they turn in the capillary of a VAST BioImager.
//!
//! This crate is the daemon and its commands. The science is `carved-core`, the devices are `carved-devices`, and what is written
//! down and said is `carved-records`:
//!
//! ```text
//! carved-core <- carved-devices, carved-records <- store, config <- session <- http, cli
//! ```
//! Cargo's manifests hold the arrows between the crates, `tests/house.rs` those between the modules of this one. Only
//! `session` runs specimens. `config`, `store`, `http` and `cli` use plain types and helpers of the three crates.

pub mod cli;
pub mod config;
pub mod export;
pub mod http;
pub mod session;
pub mod store;
