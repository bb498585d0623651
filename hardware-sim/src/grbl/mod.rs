//! Emulated Grbl 1.1h, or grblHAL, on a pty. It speaks the real protocol and turns the true [`Shaft`](crate::shaft::Shaft) on axis X.
//!
//! ```text
//!   serial port ── bytes ──► Firmware ──┬── words ──► gcode        lines
//!                                       ├── overrides              speeds in per cent
//!                                       ├── settings, dialect      `$` settings, Grbl or grblHAL
//!                                       ├── report                 status reports
//!                                       └──► shaft (X), slide (Y)
//! ```
//! Positions and lengths in "units" are in the unit of the settings: steps divided by `$100` to `$102`.

mod dialect;
mod firmware;
mod gcode;
mod overrides;
mod report;
mod settings;
mod words;

pub(crate) use dialect::Dialect;
pub(crate) use firmware::Firmware;
pub use settings::Settings;
