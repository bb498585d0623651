//! Rotation axes: drivers behind [`super::RotationAxis`].
//!
//! ```text
//! Grbl (protocol, knowledge of the position) ── SerialLink (bytes, lines, deadlines, the latched stop) ── tty
//! ```

mod grbl;
mod link;

pub use grbl::{AxisLetter, Grbl, GrblSettings, Reference};
