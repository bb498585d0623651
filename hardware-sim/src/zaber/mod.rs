//! Emulated Zaber controller with one axis and an encoder, on a pty. It speaks the ASCII protocol and turns the true
//! [`Shaft`](crate::shaft::Shaft).

mod axis;
mod firmware;
#[cfg(test)]
mod firmware_tests;
mod settings;

pub(crate) use firmware::Firmware;
pub use settings::Settings;
