//! Configuration: raw TOML is checked once, at start, and becomes typed values. Unknown keys are refused.
//!
//! ```text
//! file ─> Raw (serde, deny_unknown_fields) ─> check: every breach is listed ─> Config
//!          │                                   └─ plausible: values that no instrument has
//!          └─> schema: `carved config schema`, docs/configuration.md
//! ```

mod check;
mod http;
mod notify;
mod plausible;
mod private;
mod raw;
pub mod references;
mod schema;
#[cfg(test)]
mod tests;

pub use check::{Config, ConfigError, SecondCamera, StoreConfig};
pub use http::{Guard, HttpSettings, HttpSettingsError};
pub use notify::{NotifyFormat, NotifySettings, NotifySettingsError, Receiver};
pub use raw::{CalibrationConfig, CameraDriver, SamplerDriver};
pub use schema::{Key, keys, reference_page, schema};
