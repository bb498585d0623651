//! Configuration: raw TOML (unknown keys refused) becomes checked values once, at start.
//!
//! ```text
//! file ─> Raw (serde, deny_unknown_fields) ─> check: every breach is listed ─> Config
//! ```

mod check;
mod method;
mod policy;
mod raw;
pub mod references;

pub use check::{Config, ConfigError, SecondCamera, StoreConfig};
pub use method::{CameraTooNear, Method};
pub use policy::{BeadGate, Clipped, Deadlines, Interrupted, Policy, Resume};
pub use raw::{CalibrationConfig, CameraDriver, RotationDriver, SamplerDriver};
