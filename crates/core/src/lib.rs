//! The science of carved: from frames of a specimen that turns in a glass capillary to its volume and surface area, with their standard
//! uncertainties, and to its shape, without one.
//!
//! ```text
//! units, frame, range, statistics, flag ──> assay
//!        │
//!    geometry ──> profile ──> inside ──> carver ──> calibration ──> fins ──> surface ──> measure ──> quality ──> reconstruction ──> pipeline
//! ```
//! Each module uses only modules to its left or above (`tests/house.rs` of the workspace checks this).
//!
//! The crate takes values and returns values. It uses no async runtime, files, network or clock, so the same input gives the
//! same bytes wherever it runs.

#![warn(missing_docs)]

pub mod assay;
pub mod calibration;
pub mod carver;
pub mod fins;
pub mod flag;
pub mod frame;
pub mod geometry;
pub mod inside;
pub mod measure;
mod parallel;
pub mod pipeline;
pub mod profile;
pub mod quality;
pub mod range;
pub mod reconstruction;
pub mod statistics;
pub mod surface;
pub mod units;
