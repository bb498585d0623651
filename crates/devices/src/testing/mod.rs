//! Fake devices in memory, for the tests of this crate and of the daemon. They answer at once and need no port.
//!
//! ```text
//!   test ── knobs, closures ──► FakeAxis ──┬── RotationAxis ──► the code under test
//!     ▲                           │        └── FakeInput (SpecimenInput)
//!     └──────── AxisLog ◄─────────┘
//!   test ── closures ─────────► FakeCamera ─── Camera ────────► the code under test
//! ```
//! Controllers that speak their real protocol are in the crate `hardware-sim`.

mod axis;
mod camera;
mod input;

pub use axis::{AxisLog, FakeAxis};
pub use camera::{FakeCamera, Scripted};
pub use input::FakeInput;
