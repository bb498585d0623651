//! Configuration: raw TOML (unknown keys refused) becomes checked values once, at start.
//!
//! ```text
//! file ─> Raw (serde, deny_unknown_fields) ─> check: every breach is listed ─> Config
//! ```

mod check;
mod method;
mod raw;
pub mod references;

pub use carved_records::{BeadGate, Clipped, Deadlines, Interrupted, Policy, Resume};
pub use check::{Config, ConfigError, SecondCamera, StoreConfig};
pub use method::{CameraTooNear, Method};
pub use raw::{CalibrationConfig, CameraDriver, RotationDriver, SamplerDriver};
