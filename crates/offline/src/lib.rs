//! Numbers of recordings and of silhouettes, computed beside the instrument. The commands and the Python module call the same functions,
//! so that they give the same bytes.
//!
//! ```text
//!  recording ── recording ──┐
//!  frames ──────────────────┴─ frames ────── numbers, surface, voxels
//!  silhouettes, cameras ────── silhouettes ─ numbers, surface, voxels, report
//!  silhouettes, psi ────────── calibrate ─── psi, report
//!  one picture ─────────────── picture ───── profile, doubts
//! ```
//! Pictures are decoded and files are written by the caller. Only `recording` reads files, through the store.

#![warn(missing_docs)]

pub mod calibrate;
pub mod frames;
pub mod picture;
pub mod recording;
pub mod silhouettes;
mod subset;

pub use subset::SubsetError;

/// The caller ended a computation between two of its steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the computation was ended by its caller")]
pub struct Stopped;
