//! carved measures zebrafish larvae in 3D while they turn in the capillary of a VAST BioImager.
//!
//! This crate is the daemon and its commands. The science is `carved-core`, the types of records and messages are `carved-records`, the
//! devices are `carved-devices`, and the data folder is `carved-store`. `carved-offline` computes numbers without the instrument,
//! `carved-pictures` draws frames and models, and `carved-files` opens files. `hardware-sim` is the emulated rig:
//!
//! ```text
//! carved-core <- carved-records <- carved-devices, carved-store
//! carved-core, carved-records, carved-store <- carved-offline
//! carved-core, carved-files <- carved-pictures <- carved-store      carved-files <- carved-devices
//!
//! these crates <- config, api <- notify      config, api, export, notify <- session      export, tables <- report
//!                 api, config, notify, report, session, tables <- http      all <- cli
//! ```
//! An arrow points to what is used. Cargo's manifests enforce the arrows between the crates, `tests/house.rs` those between the modules
//! of this one. Only `session` runs specimens.

pub mod api;
pub mod cli;
pub mod config;
pub mod export;
pub mod http;
pub mod notify;
pub mod report;
pub mod session;
pub mod tables;
