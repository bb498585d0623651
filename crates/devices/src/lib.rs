//! The instrument's devices behind narrow traits. They use units and raw frames, and no science. All calls block.
//!
//! ```text
//!             ┌─ RotationAxis ── (Watched) ── Lasting ── one_sided ── Grbl, Tmcl, Zaber, VastBridge, Relay ── link ── serial port, TCP
//! acquisition ┤     ├─ LinearAxis      a second axis of the same controller
//!             │     ├─ SpecimenInput   the sampler's two wires at the same controller ◄── TriggerSampler
//!             │     └─ Outputs         light and valves at the same controller
//!             └─ Camera ──────── AravisCamera ── libaravis ── GigE Vision
//!
//! any thread ── StopHandle ──► the stop on the wire, also while a move is waited for
//! ```
//! Every serial port, connection and camera has exactly one owner. `Watched` is there with a trigger sampler only. A new method of
//! `RotationAxis` must be forwarded by all three wrappers. `forward_axis` has those that are only passed on.

#![warn(missing_docs)]

#[macro_use]
mod forward;

pub mod acquisition;
pub mod camera;
pub mod cancel;
pub mod outputs;
pub mod rotation;
pub mod sampler;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
pub mod views;

mod clock;
mod error;
mod lasting;
mod rig;
mod setting;

pub use error::{DeviceError, Difference};
pub use lasting::Lasting;
pub use rig::Rig;

use crate::cancel::CancelToken;
use crate::outputs::Outputs;
use carved_core::frame::RawFrame;
use carved_core::units::Steps;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// What is known about the position of an axis. The controller's count alone is not enough: after a restart it counts from 0 again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Position {
    /// Never referenced since the port was opened.
    Unknown,
    /// The axis was referenced and stands at a known position.
    Referenced {
        /// From the reference position.
        steps: Steps,
        /// Of the reference. All views of one model must have the same epoch.
        epoch: u32,
    },
    /// Something happened that the controller may not have noticed, such as a restart or an unexplained position.
    Suspect {
        /// One more than the epoch of the position that was known before.
        epoch: u32,
    },
}

/// Where a move ended, as the controller reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Achieved {
    /// From the reference position.
    pub steps: Steps,
    /// Of the reference that the steps are counted from.
    pub epoch: u32,
}

/// What a controller can do and report. Callers ask for it and do not assume anything about a make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[allow(clippy::struct_excessive_bools)] // a list of answers, not a state
pub struct Capabilities {
    /// It reports its own count of steps.
    pub has_position: bool,
    /// It measures the angle of the shaft.
    pub has_encoder: bool,
    /// It detects a shaft that does not follow.
    pub has_stall: bool,
    /// It can end a move that is under way.
    pub can_stop: bool,
    /// It accepts absolute positions. Otherwise it accepts differences, and the driver keeps the count.
    pub absolute: bool,
    /// It goes to the next entry of a list at each trigger, and nowhere else. The list is given to it before.
    pub trigger_only: bool,
    /// Another program turns the capillary and takes the pictures. No view can be taken again and no turn can be ended early, but the
    /// pictures that exist can be read again.
    pub outside: bool,
}

/// The speeds of an axis that can turn at a constant speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EvenMotion {
    /// Fastest speed, steps/s.
    pub fastest_steps_per_s: f64,
    /// Acceleration of its ramps, steps/s^2.
    pub acceleration_steps_per_s2: f64,
}

/// A move at a constant speed that the controller has taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Begun {
    /// When the command was sent. The axis begins to turn between this and `taken`.
    pub sent: Instant,
    /// When the controller had acknowledged it.
    pub taken: Instant,
    /// The speed between the ramps, as the controller was told it, steps/s.
    pub steps_per_s: f64,
    /// Acceleration of the ramps, steps/s^2.
    pub acceleration_steps_per_s2: f64,
}

/// The clock of a camera at an instant of this computer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockReading {
    /// The camera's clock, ns, as in the frames of its stream.
    pub camera_ns: u64,
    /// The middle of the exchange that has read it.
    pub host: Instant,
    /// Seconds of the camera's clock per second of this computer's: 1, but for an emulated rig whose time runs faster or slower.
    pub scale: f64,
}

impl ClockReading {
    /// The camera's clock at another instant, ns.
    pub fn camera_ns_at(&self, host: Instant) -> f64 {
        let since_s = match host.checked_duration_since(self.host) {
            Some(since) => since.as_secs_f64(),
            None => -self.host.duration_since(host).as_secs_f64(),
        };
        self.camera_ns as f64 + since_s * self.scale * 1e9
    }
}

/// The axis that turns the capillary.
///
/// Only functions that most axes do not have come with a default: the list of stops (`announce`, `let_go`), the begin of a run
/// (`begin_run`), a constant speed, a second axis, a wire from the sampler, outputs. A wrapper must forward all of them.
pub trait RotationAxis: Send {
    /// Name and version of the controller, for the record. It may become longer once a controller could be asked.
    fn identity(&self) -> &str;
    /// What this controller can do.
    fn capabilities(&self) -> Capabilities;
    /// A new run begins. What a person was asked during the run before, and did not answer, is asked again.
    fn begin_run(&mut self) {}
    /// Announces the stops of the next revolution, in order, before its first move. A trigger-stepped axis needs them before
    /// its reference, and best before the specimen is there. The same stops may be announced again.
    ///
    /// # Errors
    /// The list cannot be written, or the machine already goes by another one. [`DeviceError::VastList`] once for each new list: a
    /// person must load it into the machine's program. To announce the same stops again in the same run says that this was done.
    fn announce(&mut self, _stops: &[Steps]) -> Result<(), DeviceError> {
        Ok(())
    }
    /// Finds the reference position and makes it step 0 of a new epoch. It releases an earlier stop, unless `cancel` is cancelled.
    /// To stop for good, cancel first and then stop.
    ///
    /// # Errors
    /// The controller's fault, or [`DeviceError::Intervention`] while a person or a safety circuit holds the axis.
    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError>;
    /// Moves to an absolute position, counted from the reference, and returns once the axis has arrived.
    ///
    /// # Errors
    /// The axis is not referenced, did not arrive, or was stopped. It then needs a new reference.
    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError>;
    /// The speeds at which [`Self::move_evenly`] can turn; `None` for an axis that cannot.
    fn even_motion(&self) -> Option<EvenMotion> {
        None
    }
    /// Moves forward to an absolute position, at a constant speed between two ramps, and returns once the axis has arrived. `begun` is
    /// called as soon as the controller has taken the command, on the calling thread.
    ///
    /// # Errors
    /// As `move_to`; [`DeviceError::Uneven`] for an axis that cannot, or a speed above [`EvenMotion::fastest_steps_per_s`].
    fn move_evenly(&mut self, _target: Steps, steps_per_s: f64, _begun: &mut dyn FnMut(Begun)) -> Result<Achieved, DeviceError> {
        Err(DeviceError::Uneven { steps_per_s, fastest: None })
    }
    /// Ends the work on a specimen. A trigger-stepped axis steps through the rest of its list, so that the machine's own program
    /// continues. Its next reference waits for another specimen. It releases an earlier stop as `reference` does.
    ///
    /// # Errors
    /// As `move_to`.
    fn let_go(&mut self, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
    /// The axis that moves the capillary along the picture, if the same controller drives it. A port has one owner.
    fn linear(&mut self) -> Option<&mut dyn LinearAxis> {
        None
    }
    /// The input that tells whether a specimen is in the capillary, if it is wired to this controller.
    fn specimen_input(&mut self) -> Option<&mut dyn SpecimenInput> {
        None
    }
    /// The outputs of this controller, if any are configured. `None` also while the controller is lost.
    fn outputs(&mut self) -> Option<&mut dyn Outputs> {
        None
    }
    /// Asks the controller whether it is there, between runs and while a run is held. Nothing moves. A stopped controller is asked
    /// too. Each driver has its own question. A driver without one checks the connection only.
    ///
    /// # Errors
    /// [`DeviceError::Intervention`] if a person or a safety circuit holds the axis, [`DeviceError::VastProgram`] if the machine's program
    /// waits for a person: each time while it lasts, or once, depending on the driver. [`DeviceError::Gone`] and [`DeviceError::Silent`] if the controller is lost.
    fn check(&mut self) -> Result<(), DeviceError>;
    /// What is known about the position. Nothing is asked of the controller.
    fn position(&self) -> Position;
    /// A handle by which any thread stops the motor at once, also while `move_to` waits. If the machine cannot be stopped
    /// ([`Capabilities::can_stop`]), it finishes the current step and gets no further one.
    fn stop_handle(&self) -> StopHandle;
}

/// The axis that moves the capillary along the picture. The [`StopHandle`] of its controller stops it.
pub trait LinearAxis {
    /// Finds step 0, unless it is known.
    ///
    /// # Errors
    /// As [`RotationAxis::reference`].
    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError>;
    /// Moves to an absolute position within the limits and returns once the axis has arrived.
    ///
    /// # Errors
    /// A target outside the limits, and as [`RotationAxis::move_to`].
    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError>;
    /// The first and the last permitted step.
    fn limits(&self) -> [Steps; 2];
    /// What is known about the position.
    fn position(&self) -> Position;
    /// The number of whole steps nearest to a length, um.
    fn steps_of(&self, um: f64) -> Steps;
}

/// Two wires between the controller and the sampler: an input "a specimen is there" and an output "the specimen is done".
pub trait SpecimenInput {
    /// Prepares the controller to wait for a specimen. It releases an earlier stop as [`RotationAxis::reference`] does.
    ///
    /// # Errors
    /// As [`RotationAxis::reference`].
    fn begin(&mut self, cancel: &CancelToken) -> Result<(), DeviceError>;
    /// Whether the input is active at this moment. The contact may bounce.
    ///
    /// # Errors
    /// The controller's fault, or a stop.
    fn is_active(&mut self) -> Result<bool, DeviceError>;
    /// Whether the input is active, while nothing runs. The controller may be stopped or in an alarm, and stays so. `None` if its
    /// answer cannot be read.
    ///
    /// # Errors
    /// The controller does not answer.
    fn is_active_at_rest(&mut self) -> Result<Option<bool>, DeviceError>;
    /// Switches the output.
    ///
    /// # Errors
    /// The controller's fault, or [`DeviceError::Intervention`] while a person holds the axis.
    fn say_done(&mut self, done: bool) -> Result<(), DeviceError>;
}

/// Stops a motor from any thread, and tells whether its controller is known to be lost.
#[derive(Clone)]
pub struct StopHandle {
    stop: std::sync::Arc<dyn Fn() + Send + Sync>,
    end_motion: std::sync::Arc<dyn Fn() + Send + Sync>,
    link: Link,
}

impl StopHandle {
    /// A handle whose [`Self::stop`] and [`Self::end_motion`] do the same.
    pub fn new(stop: impl Fn() + Send + Sync + 'static) -> Self {
        let stop: std::sync::Arc<dyn Fn() + Send + Sync> = std::sync::Arc::new(stop);
        Self { end_motion: std::sync::Arc::clone(&stop), stop, link: Link::new(|| false) }
    }

    /// A handle that knows the connection to the controller.
    #[must_use]
    pub fn with_link(self, link: Link) -> Self {
        Self { link, ..self }
    }

    /// The connection to the controller. Without one that can be watched, it is never lost.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// A handle for a controller on which a stop would also end a person's action, such as a feed hold.
    #[must_use]
    pub fn with_end_of_motion(self, end_motion: impl Fn() + Send + Sync + 'static) -> Self {
        Self { end_motion: std::sync::Arc::new(end_motion), ..self }
    }

    /// Writes the stop to the wire in any state of the axis, for a stop that a person requests. The axis then refuses to move until it
    /// is referenced again.
    pub fn stop(&self) {
        (self.stop)();
    }

    /// Ends a motion that this program has started, if there is one, for a stop that the program decides on. It does not change what a
    /// person has done at the controller. The axis then refuses to move until it is referenced again.
    pub fn end_motion(&self) {
        (self.end_motion)();
    }
}

/// Tells any thread whether a device is known to be lost. It sends nothing to the device.
#[derive(Clone)]
pub struct Link(std::sync::Arc<dyn Fn() -> bool + Send + Sync>);

impl Link {
    /// A link that asks `is_lost`.
    pub fn new(is_lost: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self(std::sync::Arc::new(is_lost))
    }

    /// Whether the device is known to be lost.
    pub fn is_lost(&self) -> bool {
        (self.0)()
    }
}

/// A frame that was accepted: complete, in the configured geometry and format.
#[derive(Debug, Clone, PartialEq)]
pub struct Grabbed {
    /// The pixels as the camera sent them.
    pub frame: RawFrame,
    /// The number that the stream gave the frame.
    pub frame_id: u64,
    /// Number of triggers for this frame. It is more than 1 after a lost frame.
    pub attempts: u32,
    /// Time until the camera acknowledged the last trigger, ms. The rest is exposure, readout and transfer.
    pub trigger_ms: f64,
}

/// A frame of a camera that runs free: complete, in the configured geometry and format.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamedFrame {
    /// The pixels as the camera sent them.
    pub frame: RawFrame,
    /// Number of the frame in its stream. It counts on where the camera's own number of 16 bits wraps. Frames that the camera took and
    /// that did not arrive have their numbers too.
    pub frame_id: u64,
    /// The camera's own clock when it took the frame, ns. It counts on where the camera's clock wraps. Its highest bit is left out, so
    /// that it does not wrap itself.
    pub camera_ns: u64,
    /// When its first packet was received.
    pub received: Instant,
}

/// How a camera is to run free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamPlan {
    /// Frames per second.
    pub rate_hz: f64,
    /// Number of frames that may wait for the sink.
    pub buffers: u32,
    /// Longest time without a complete frame, after which the stream has failed.
    pub silence: Duration,
}

/// Facts of a stream that has ended.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StreamEnd {
    /// The rate that the camera reported, Hz.
    pub rate_hz: f64,
    /// Numbers of the frames that came incomplete, although lost packets were requested again.
    pub incomplete: Vec<u64>,
}

/// Takes the frames of a stream. A break ends the stream.
pub type FrameSink<'a> = &'a mut dyn FnMut(StreamedFrame) -> ControlFlow<()>;

/// Counters of all streams since the camera was opened, as Aravis counts them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StreamCounters {
    /// Complete frames.
    pub completed: u64,
    /// Incomplete frames.
    pub failed: u64,
    /// Frames for which there was no free buffer.
    pub underrun: u64,
    /// Packets that were lost and sent again.
    pub resent_packets: u64,
    /// Packets that stayed lost.
    pub missing_packets: u64,
    /// Packets that belong to no frame under way.
    pub ignored_packets: u64,
}

/// The camera that looks at the capillary.
pub trait Camera: Send {
    /// Vendor, model and serial number, for the record.
    fn identity(&self) -> &str;
    /// The camera's own features that change the picture, such as exposure and gain, for the record. Empty if none are known.
    fn features(&self) -> std::collections::BTreeMap<String, String> {
        std::collections::BTreeMap::new()
    }
    /// Compares these features with their values when the camera was opened, and sets back what differs. It takes some milliseconds, so
    /// `grab` compares only those that change by themselves or are changed most easily.
    ///
    /// # Errors
    /// [`DeviceError::CameraChanged`] with the first difference, or the camera is lost.
    fn check_features(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
    /// Starts an acquisition: the camera then waits for triggers. A lost camera is opened again first.
    ///
    /// # Errors
    /// The camera is lost, or refuses.
    fn arm(&mut self) -> Result<(), DeviceError>;
    /// Triggers one exposure and returns its frame. A lost frame is triggered again until the deadline.
    ///
    /// # Errors
    /// No complete frame came before the deadline, the camera is not armed, or it is lost.
    fn grab(&mut self, deadline: Duration) -> Result<Grabbed, DeviceError>;
    /// The most frames per second that the camera takes at its present region and exposure, as it reports. `None` if it cannot run
    /// free.
    ///
    /// # Errors
    /// The camera is lost.
    fn highest_rate_hz(&mut self) -> Result<Option<f64>, DeviceError> {
        Ok(None)
    }
    /// Lets the camera run free and gives `sink` each complete frame, in the order of their numbers, until it breaks. A frame that
    /// does not arrive leaves a gap in the numbers and changes no other number. Afterwards the camera waits for triggers again, as
    /// after `arm`.
    ///
    /// # Errors
    /// The camera cannot run free or refuses the rate, it is lost, its clock cannot be trusted, or no complete frame came for
    /// `plan.silence`.
    fn stream(&mut self, _plan: &StreamPlan, _sink: FrameSink<'_>) -> Result<StreamEnd, DeviceError> {
        Err(DeviceError::Camera { what: "a stream".into(), why: format!("{} takes pictures by trigger only", self.identity()) })
    }
    /// Tells any thread whether this program still controls the camera. After a loss only `reopen` or `arm` help.
    fn link(&self) -> Link;
    /// Whether the camera is known to be lost.
    fn is_lost(&self) -> bool {
        self.link().is_lost()
    }
    /// Opens and configures a lost camera again. It does nothing if the camera is not lost.
    ///
    /// # Errors
    /// The camera does not answer, another program controls it, or another camera answers.
    fn reopen(&mut self) -> Result<(), DeviceError>;
    /// Counters since the camera was opened.
    fn counters(&self) -> StreamCounters;
    /// Reads the camera's own clock; `None` if it has none that runs.
    ///
    /// # Errors
    /// The camera is lost.
    fn clock(&mut self) -> Result<Option<ClockReading>, DeviceError> {
        Ok(None)
    }
    /// Ends the acquisition.
    ///
    /// # Errors
    /// The camera is lost, or refuses.
    fn disarm(&mut self) -> Result<(), DeviceError>;
}
