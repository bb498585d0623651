//! Rotation axes: drivers behind [`super::RotationAxis`].
//!
//! ```text
//! Grbl (protocol, knowledge of the position) ── Link (bytes, lines, deadlines, the latched stop) ── Door (tty, TCP)
//! ```

mod bridge;
mod door;
mod grbl;
mod link;
mod pace;
mod relay;

pub use bridge::{Degrees, VastBridge, VastBridgeSettings};
pub use grbl::{AxisLetter, Grbl, GrblSettings, Reference};
pub use relay::{Relay, RelaySettings};
