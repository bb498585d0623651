//! Emulated Trinamic module with TMCL firmware on a pty. Its two motors hold the capillary of the true
//! [`Shaft`](crate::shaft::Shaft) at both ends.

mod firmware;
#[cfg(test)]
mod firmware_tests;
mod frame;
mod motor;
mod settings;

pub(crate) use firmware::Firmware;
pub use settings::Settings;
