//! The instrument's devices behind narrow traits. They know units and raw frames, nothing of the science.
//!
//! ```text
//! acquisition ── RotationAxis ── grbl ── link (one owner per serial port) ── /dev/tty...
//!             └─ Camera ──────── aravis (one owner per camera) ──────────── GigE
//! ```
//! `stop` of an axis is reachable from any thread at any moment, through its [`StopHandle`].

pub mod acquisition;
pub mod camera;
pub mod cancel;
pub mod hash;
pub mod regular;
pub mod rotation;
pub mod sampler;

mod error;
mod lasting;
mod rig;

pub use error::{DeviceError, Difference};
pub use lasting::Lasting;
pub use rig::Rig;

use crate::cancel::CancelToken;
use carved_core::frame::RawFrame;
use carved_core::units::Steps;
use std::time::Duration;

/// What is known of an axis' position. A number alone is not knowledge: a controller that restarted counts from 0 again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Position {
    /// Never referenced since the port was opened.
    Unknown,
    /// Referenced; every view of one model must carry the same epoch.
    Referenced { steps: Steps, epoch: u32 },
    /// Something happened that the controller may not have noticed (a restart, an unexplained position).
    Suspect { epoch: u32 },
}

/// Where a move ended, by the controller's own account.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Achieved {
    pub steps: Steps,
    pub epoch: u32,
}

/// What a controller can do and tell. Who drives an axis asks; nothing is assumed of a make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[allow(clippy::struct_excessive_bools)] // a list of answers, not a state
pub struct Capabilities {
    /// It reports where it counts itself to stand.
    pub has_position: bool,
    /// It measures where the shaft stands.
    pub has_encoder: bool,
    /// It notices a shaft that does not follow.
    pub has_stall: bool,
    /// A move under way can be ended.
    pub can_stop: bool,
    /// It takes positions; else it takes differences, and the driver keeps count.
    pub absolute: bool,
    /// It steps through a list that was given to it before, at each trigger.
    pub trigger_only: bool,
}

/// The axis that turns the capillary.
///
/// Only what most axes truly do not have has a default: a list of stops to be told (`announce`, `let_go`), a second axis, a
/// wire from the sampler. Whoever wraps an axis passes all of them on.
pub trait RotationAxis: Send {
    /// What the controller says of itself, for the record.
    fn identity(&self) -> &str;
    fn capabilities(&self) -> Capabilities;
    /// Tells where the next revolution will stop, in order, before its first move. A trigger-stepped axis needs it before
    /// its reference, best before the specimen is there; the same stops may be told again.
    fn announce(&mut self, _stops: &[Steps]) -> Result<(), DeviceError> {
        Ok(())
    }
    /// Finds the axis' reference and makes it step 0 of a new epoch. It lifts an earlier stop, but never one whose caller
    /// has cancelled `cancel`: who stops for good cancels first, then stops.
    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError>;
    /// Moves to an absolute position and returns once the axis has arrived.
    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError>;
    /// Says that the specimen is done with: a trigger-stepped axis goes through what is left of its list, so that its own
    /// program goes on. Its next reference then waits for another specimen. It lifts an earlier stop as the reference does.
    fn let_go(&mut self, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
    /// The axis that moves the capillary along the picture, where the same controller drives it: a port has one owner.
    fn linear(&mut self) -> Option<&mut dyn LinearAxis> {
        None
    }
    /// The wire that says that a specimen is in the capillary, where it ends at this controller.
    fn specimen_input(&mut self) -> Option<&mut dyn SpecimenInput> {
        None
    }
    /// Asks the controller whether it is there, without moving anything; for the time between runs and while one is held. A
    /// stopped controller is asked too. Each driver has a question of its own; one that has none says so in its code and looks
    /// at the connection. What a person did at the controller is told as [`DeviceError::Intervention`], once.
    fn check(&mut self) -> Result<(), DeviceError>;
    fn position(&self) -> Position;
    /// A handle by which any thread stops the motor at once, also while `move_to` is waiting. Where nothing can stop it
    /// ([`Capabilities::can_stop`]), it ends the step under way by itself and is told no other.
    fn stop_handle(&self) -> StopHandle;
}

/// The axis that moves the capillary along the picture. It is stopped by the [`StopHandle`] of its controller.
pub trait LinearAxis {
    /// Finds its step 0, where that is not known.
    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError>;
    /// Moves to an absolute position within the limits and returns once the axis has arrived.
    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError>;
    /// The first and the last step that it may be sent to.
    fn limits(&self) -> [Steps; 2];
    fn position(&self) -> Position;
    /// Whole steps of a length.
    fn steps_of(&self, um: f64) -> Steps;
}

/// Two wires between the controller and who brings specimens.
pub trait SpecimenInput {
    /// Lifts an earlier stop as a reference does; comes before a specimen is waited for.
    fn begin(&mut self, cancel: &CancelToken) -> Result<(), DeviceError>;
    /// Whether the input is active at this moment; it may bounce.
    fn is_active(&mut self) -> Result<bool, DeviceError>;
    /// The same of a controller at rest, which may be stopped or in an alarm and is left so; nothing where its answer cannot be read.
    fn is_active_at_rest(&mut self) -> Result<Option<bool>, DeviceError>;
    /// Switches the output that says that the specimen is done with.
    fn say_done(&mut self, done: bool) -> Result<(), DeviceError>;
}

/// Stops a motor from any thread.
#[derive(Clone)]
pub struct StopHandle {
    stop: std::sync::Arc<dyn Fn() + Send + Sync>,
    end_motion: std::sync::Arc<dyn Fn() + Send + Sync>,
}

impl StopHandle {
    /// A handle whose two stops are the same.
    pub fn new(stop: impl Fn() + Send + Sync + 'static) -> Self {
        let stop: std::sync::Arc<dyn Fn() + Send + Sync> = std::sync::Arc::new(stop);
        Self { end_motion: std::sync::Arc::clone(&stop), stop }
    }

    /// A handle for a controller on which a stop also ends what a person has done there, such as a feed hold.
    #[must_use]
    pub fn with_end_of_motion(self, end_motion: impl Fn() + Send + Sync + 'static) -> Self {
        Self { end_motion: std::sync::Arc::new(end_motion), ..self }
    }

    /// Puts the stop on the wire, whatever the axis does; it then refuses to move until it is referenced again. For a stop that
    /// a person asks for.
    pub fn stop(&self) {
        (self.stop)();
    }

    /// Ends a motion that the program has begun, if there is one; the axis then refuses to move until it is referenced again. For
    /// stops that the program decides on: they leave alone what a person has done at the controller.
    pub fn end_motion(&self) {
        (self.end_motion)();
    }
}

/// Whether a device is known to be lost, for any thread; it asks nothing of the device.
#[derive(Clone)]
pub struct Link(std::sync::Arc<dyn Fn() -> bool + Send + Sync>);

impl Link {
    pub fn new(is_lost: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self(std::sync::Arc::new(is_lost))
    }

    pub fn is_lost(&self) -> bool {
        (self.0)()
    }
}

/// A frame that passed the acceptance rule: whole, of the configured geometry and format.
#[derive(Debug, Clone, PartialEq)]
pub struct Grabbed {
    pub frame: RawFrame,
    /// The stream's own number of the frame.
    pub frame_id: u64,
    /// Triggers that this frame took; more than 1 after a lost frame.
    pub attempts: u32,
    /// Until the camera had acknowledged the last of them, ms; the rest of the time is exposure, readout and transfer.
    pub trigger_ms: f64,
}

/// What the stream counted since it was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StreamCounters {
    pub completed: u64,
    pub failed: u64,
    pub underrun: u64,
    pub resent_packets: u64,
    pub missing_packets: u64,
    pub ignored_packets: u64,
}

/// The camera that looks at the capillary.
pub trait Camera: Send {
    /// Vendor, model and serial number, for the record.
    fn identity(&self) -> &str;
    /// Starts the one acquisition of a run: the camera then waits for triggers. One that was lost is opened again first.
    fn arm(&mut self) -> Result<(), DeviceError>;
    /// Triggers one exposure and returns its frame; a lost frame is triggered again until the deadline has passed.
    fn grab(&mut self, deadline: Duration) -> Result<Grabbed, DeviceError>;
    /// Tells any thread whether the device is still ours; once it is not, only `reopen` or `arm` help.
    fn link(&self) -> Link;
    fn is_lost(&self) -> bool {
        self.link().is_lost()
    }
    /// Opens and configures a lost camera again, where it answers; does nothing with one that is not lost.
    fn reopen(&mut self) -> Result<(), DeviceError>;
    fn counters(&self) -> StreamCounters;
    fn disarm(&mut self) -> Result<(), DeviceError>;
}
