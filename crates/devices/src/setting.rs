//! Settings of devices: what their ranges have in common, and the error about one that is out of its range.

use crate::DeviceError;
use carved_core::range::Ranged;

/// Slowest serial line, baud.
pub const BAUD_LEAST: f64 = 300.0;
/// Fastest serial line of a USB adapter, baud.
pub const BAUD_MOST: f64 = 4_000_000.0;
/// Longest wait for an answer that is meant, ms: ten minutes.
pub const ANSWER_MOST_MS: f64 = 600_000.0;
/// Longest homing that is meant, ms: an hour.
pub const HOMING_MOST_MS: f64 = 3_600_000.0;

/// Checks the numbers of a device's settings.
///
/// # Errors
/// The first number that is out of its range.
pub fn in_range(device: &'static str, settings: &impl Ranged) -> Result<(), DeviceError> {
    settings.outside().into_iter().next().map_or(Ok(()), |breach| {
        let rule = format!("it must be from {} to {} {}", breach.least, breach.most, breach.unit);
        Err(DeviceError::Setting { device, name: breach.key, found: breach.found.to_string(), rule })
    })
}
