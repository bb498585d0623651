//! An emulated VAST rig. Other programs reach it through real protocols only: a motor controller on a pty and a GigE Vision camera
//! on loopback.
//!
//! ```text
//!   host ── serial ──► grbl, ... ── steps ──► shaft ── true angle ──► gige ── UDP ──► host
//!                                                                       │
//!                                                    Sight: the scene, a replay, a test card
//! ```
//! The camera sees the shaft at its true angle, so a wrong move gives a wrong image. Angle 0 is the reference switch. After homing
//! with the default settings this is machine position 0, and the shaft stands one pull-off before it.
//!
//! [`analytic`] does not belong to the rig. It computes profiles from formulas, with their ground truth, for tests that need
//! thousands of profiles and no images.

pub mod analytic;
pub mod bridge;
pub mod clock;
pub mod gige;
pub mod grbl;
pub mod motion;
mod motor_faults;
pub mod outputs;
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
pub mod vast_program;
pub mod zaber;

pub use motor_faults::MotorFaults;
pub use outputs::{OutputPin, Outputs};
pub use replay::{Replay, ReplayError};
pub use rig::{CameraAddress, Controller, Faults, Rig, RigError, RigSettings};
pub use sampler::{SamplerSettings, VendorSampler};
pub use scene::Exposure;
pub use shaft::ShaftSettings;
pub use sight::{PixelFormat, Pixels, Sight};
pub use slide::{Slide, SlideSettings};
pub use test_card::TestCard;
pub use truth::ExposureRecord;
