//! An emulated VAST behind its trigger bridge: an Arduino on a pty, and the machine that it triggers.
//!
//! ```text
//!   host ── pty ── Firmware (X? TT TS / OK R1 E0..E3) ── pulse ──► Vast ── steps ──► Shaft
//!                                                  ◄── in position ──┤
//!   host ── external.txt ── a person loads it into the machine's program ──┘
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
    /// How it goes from a position to a smaller one, such as from 356,40 to 0,00. Nobody has published that.
    pub to_smaller: ToSmaller,
    pub speed_deg_per_s: f64,
    pub acceleration_deg_per_s2: f64,
    pub knobs: Knobs,
}

/// The way to a position that is smaller than the present one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ToSmaller {
    /// On through 360 deg, where that is shorter.
    Shortest,
    /// Always back.
    Back,
}

impl Settings {
    /// A machine whose program loads `list`.
    pub fn reading(list: PathBuf) -> Self {
        Self { list, to_smaller: ToSmaller::Shortest, speed_deg_per_s: 360.0, acceleration_deg_per_s2: 3600.0, knobs: Knobs::default() }
    }
}
