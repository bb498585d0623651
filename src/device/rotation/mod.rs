//! Rotation axes: drivers behind [`super::RotationAxis`].
//!
//! ```text
//! Grbl (protocol, knowledge of the position) ── Link (bytes, lines, deadlines, the latched stop) ── Door (tty, TCP)
//! ```

mod door;
mod grbl;
mod link;

pub use grbl::{AxisLetter, Grbl, GrblSettings, Reference};
