//! An emulated VAST behind its trigger bridge: an Arduino on a pty, and the machine that it triggers.
//!
//! ```text
//!   host ── pty ── Firmware (X? TT TS / OK R1 E0..E3) ── pulse ──► Vast ── steps ──► Shaft
//!                                                  ◄── in position ──┤
//!   host ── external.txt ────────────────────────────────────────────┘  read when a specimen is loaded
//! ```
//! Without its USB cable the Arduino has no power, but the machine finishes its step. No command can stop it.

mod firmware;
mod knobs;
mod list;
mod vast;

pub(crate) use firmware::Firmware;
pub use knobs::Knobs;

use std::path::PathBuf;

/// The machine and its list.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Path of `external.txt`.
    pub list: PathBuf,
    /// Whether the degrees of a line are relative to the line before. Otherwise they are positions.
    pub relative: bool,
    pub speed_deg_per_s: f64,
    pub acceleration_deg_per_s2: f64,
    pub knobs: Knobs,
}

impl Settings {
    /// A machine that reads positions from `list`.
    pub fn reading(list: PathBuf) -> Self {
        Self { list, relative: false, speed_deg_per_s: 360.0, acceleration_deg_per_s2: 3600.0, knobs: Knobs::default() }
    }
}
