//! Emulated Grbl 1.1h, or grblHAL, on a pty. It speaks the firmware's bytes and turns the true [`Shaft`](crate::shaft::Shaft) on axis X.

mod dialect;
mod firmware;
mod gcode;
mod report;
mod settings;
mod words;

pub(crate) use dialect::Dialect;
pub(crate) use firmware::Firmware;
pub use settings::Settings;
