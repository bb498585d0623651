//! Rotation axes: drivers behind [`super::RotationAxis`].
//!
//! ```text
//! Grbl (protocol, knowledge of the position) ── Link (bytes, lines, deadlines, the latched stop) ── Door (tty, TCP)
//! ```

mod bridge;
mod door;
mod grbl;
mod identify;
mod link;
mod pace;
mod port;
mod relay;

pub use bridge::{Degrees, VastBridge, VastBridgeSettings};
pub use grbl::{AxisLetter, Dialect, Grbl, GrblSettings, Reference, TranslationSettings};
pub use identify::{Answer, identify};
pub use port::{Port, UsbAdapter, list as serial_ports};
pub use relay::{Relay, RelaySettings};
