//! Configuration: raw TOML (unknown keys refused) becomes checked values once, at start.
//!
//! ```text
//! file ─> Raw (serde, deny_unknown_fields) ─> check: every breach is listed ─> Config
//! ```

mod check;
mod raw;
pub mod references;
#[cfg(test)]
mod tests;

pub use check::{Config, ConfigError, SecondCamera, StoreConfig};
pub use raw::{CalibrationConfig, CameraDriver, RotationDriver, SamplerDriver};
