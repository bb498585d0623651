//! An emulated VAST rig, seen from outside only through real bytes: a motor controller on a pty and a GigE Vision camera on
//! loopback.
//!
//! ```text
//!   host ── serial ──► grbl, ... ── steps ──► shaft ── true angle ──► gige ── UDP ──► host
//!                                                                       │
//!                                                    Sight: the scene, a replay, a test card
//! ```
//! The camera looks at where the shaft truly is, so a wrong move gives a wrong picture. Angle 0 is the reference switch:
//! after homing with the default settings that is machine position 0, and the shaft stands one pull-off before it.
//!
//! [`analytic`] stands beside the rig: profiles by formulas, with their truth, where thousands are needed and no picture.

pub mod analytic;
pub mod bridge;
pub mod clock;
pub mod gige;
pub mod grbl;
pub mod motion;
mod motor_faults;
pub mod relay;
pub mod replay;
pub mod rig;
pub mod sampler;
pub mod scene;
pub mod serial;
pub mod shaft;
pub mod sight;
pub mod slide;
pub mod test_card;
pub mod tmcl;
pub mod truth;
pub mod zaber;

pub use motor_faults::MotorFaults;
pub use replay::{Replay, ReplayError};
pub use rig::{CameraAddress, Controller, Faults, Rig, RigError, RigSettings};
pub use sampler::{SamplerSettings, VendorSampler};
pub use scene::Exposure;
pub use shaft::ShaftSettings;
pub use sight::{PixelFormat, Pixels, Sight};
pub use slide::{Slide, SlideSettings};
pub use test_card::TestCard;
pub use truth::ExposureRecord;
