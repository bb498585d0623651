//! carved measures zebrafish larvae in 3D while they turn in the capillary of a VAST BioImager.
//!
//! Data flows one way:
//!
//! ```text
//! units, frame  <- geometry <- profile, carver <- calibration, surface <- measure <- quality <- reconstruction   science: values in, values out
//! units, frame  <- device <- acquisition                                                    instrument: blocking, no science
//! both          <- session <- http, cli                                                     edges: store, export, network
//! ```
//! The science knows no tokio, files, network or clock. `device` knows units and raw frames. Only `session` sees both
//! sides; `http` sees the session's handle and snapshots. `tests/house.rs` holds these rules.

pub mod acquisition;
pub mod calibration;
pub mod cancel;
pub mod carver;
pub mod cli;
pub mod config;
pub mod device;
pub mod export;
pub mod frame;
pub mod geometry;
pub mod hash;
pub mod http;
pub mod measure;
pub mod pipeline;
pub mod profile;
pub mod quality;
pub mod range;
pub mod reconstruction;
pub mod regular;
pub mod session;
pub mod statistics;
pub mod store;
pub mod surface;
pub mod units;
