//! Errors of devices. Each states what was expected, what was found, and what the operator can do.

use crate::views::ViewsError;
use carved_core::units::Steps;
use std::path::PathBuf;

/// An error of a device, as the operator reads it.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the fields are the words of the messages")]
pub enum DeviceError {
    /// A connection could not be opened.
    #[error("{device}: cannot open {address}: {why}. {remedy}")]
    Open { device: &'static str, address: String, why: String, remedy: &'static str },
    /// A thread that the phase needs could not be started.
    #[error(
        "a thread for the phase {phase} could not be started: {why}. Nothing was begun. Look which program uses all threads or all memory of this computer"
    )]
    Unwatched { phase: &'static str, why: String },
    /// The driver was left out of this build.
    #[error("{device}: this build has no driver for {driver:?}. {remedy}")]
    NotBuilt { device: &'static str, driver: &'static str, remedy: &'static str },
    /// A value of the configuration is out of range.
    #[error("{device}: {name} = {found} in the configuration; {rule}")]
    Setting { device: &'static str, name: String, found: String, rule: String },
    /// The controller did not answer, though the connection stands.
    #[error("{device}: no answer to {request:?} within {waited_ms} ms. {remedy}, then reference the axis again")]
    Silent { device: &'static str, request: String, waited_ms: u128, remedy: String },
    /// Something answers, but not as this controller would over a line of its own.
    #[error("{device}: no answer to {request:?} that can be read: {found}. {remedy}")]
    Unreadable { device: &'static str, request: String, found: String, remedy: String },
    /// The connection has ended.
    #[error("{device}: the connection is gone ({why}). Check power and cable")]
    Gone { device: &'static str, why: String },
    /// An answer that does not fit the request.
    #[error("{device}: expected {expected}, got {found:?}")]
    Unexpected { device: &'static str, expected: String, found: String },
    /// The controller's own settings differ from the configuration.
    #[error("{device}: its settings are not those of the configuration; it will not move until they agree:{}", rows(differences))]
    Mismatch { device: &'static str, differences: Vec<Difference> },
    /// The two motors of a pair are further apart than allowed.
    #[error(
        "{device}: the two motors of the pair stand at {first} and {second}; they may be {limit} steps apart. Both were stopped. Look for a \
         blocked motor, remove the twist of the capillary, then reference the axis again"
    )]
    Skew { device: &'static str, first: Steps, second: Steps, limit: u32 },
    /// A motor does not follow its steps.
    #[error("{device}: {motor} stalled at {at} on its way to {target} ({evidence}). Free the capillary, then reference the axis again")]
    Stalled { device: &'static str, motor: String, at: Steps, target: Steps, evidence: String },
    /// The controller is in an alarm.
    #[error("{device}: the controller reports {what}. Clear the cause, then reference the axis again")]
    Alarm { device: &'static str, what: String },
    /// A person, or a safety circuit that a person resets, holds the axis: feed hold, knob, emergency stop, door.
    #[error("{device}: {what}. The instrument waits and does not turn the axis. {way_out}")]
    Intervention { device: &'static str, what: String, way_out: &'static str },
    /// The axis was not referenced since it was opened.
    #[error("rotation axis: not referenced; its position is not known, so it refuses to move")]
    NotReferenced,
    /// The position may have changed without the controller's notice.
    #[error("rotation axis: its position cannot be trusted ({why}). Reference the axis again")]
    Suspect { why: String },
    /// A move ended at another position than its target.
    #[error("rotation axis: sent to {target}, stands at {achieved}. Look for a slipping or blocked shaft, then reference the axis again")]
    Missed { target: Steps, achieved: Steps },
    /// A trigger-stepped machine may be at another entry of its list.
    #[error("rotation axis: VAST may be out of step with its list ({why}). End the list at VAST, then start the specimen again")]
    OutOfStep { why: String },
    /// The machine did not finish in time.
    #[error("{device}: {what} within {waited_ms} ms. Check the machine, then start the specimen again")]
    Late { device: &'static str, what: &'static str, waited_ms: u128 },
    /// A trigger-stepped axis was sent elsewhere than to its next stop.
    #[error(
        "rotation axis: sent to {target}, but the next entry of its list is {}. A trigger cannot lead elsewhere",
        next.map_or("the end".into(), |n| n.to_string())
    )]
    NotNext { target: Steps, next: Option<Steps> },
    /// The list of a trigger-stepped axis cannot be read or written.
    #[error("{device}: {}: {why}. Check the folder, its share and the right to write there", path.display())]
    List { device: &'static str, path: PathBuf, why: String },
    /// A person must load the list of a trigger-stepped axis into the machine's own program.
    #[error(
        "rotation axis: VAST's program does not have the list {} yet. Load this file there (Imaging, Imaging with external device), tick \
         \"Enable external imaging\" and press \"Run external imaging\"",
        path.display()
    )]
    VastList { path: PathBuf },
    /// The program on VAST's computer waits for a person: VAST is not started, or not connected.
    #[error("{device}: {what}. {way_out}")]
    VastProgram { device: &'static str, what: String, way_out: &'static str },
    /// The axis along the capillary refuses or has lost its position.
    #[error("translation axis: {why}. Reference the axes again")]
    Translation { why: String },
    /// An output of the controller, such as that of the light, does not switch.
    #[error(
        "{device}: the output {name:?} was not switched {}: {why}. Check its pin in the configuration, and what is wired to it",
        if *on { "on" } else { "off" }
    )]
    Output { device: &'static str, name: String, on: bool, why: String },
    /// A constant speed that the axis cannot keep.
    #[error(
        "rotation axis: a sweep needs {steps_per_s:.1} steps/s at a constant speed; {}. Choose an order with stops, more views or a lower frame rate",
        fastest.map_or("this controller has no such move".into(), |f| format!("at most {f:.1} are possible"))
    )]
    Uneven { steps_per_s: f64, fastest: Option<f64> },
    /// A stop was requested.
    #[error("rotation axis: stopped")]
    Stopped,
    /// Another program controls the camera.
    #[error(
        "camera: {address} is controlled by another program, such as the program of a VAST. Exit that program, or wait until the camera's \
         heartbeat has run out"
    )]
    NotController { address: String },
    /// The camera was ours and is not any more.
    #[error("camera: control of the camera was lost; another program took it, or the cable is out. It is opened again when it answers")]
    ControlLost,
    /// The camera does not answer on its control channel.
    #[error("camera: no answer to {request} ({why}). Check its power and cable; it is opened again when it answers")]
    CameraSilent { request: String, why: String },
    /// A feature of the camera that changes the picture has another value than when it was opened.
    #[error(
        "camera: {name} is {found} and was {expected} when the camera was configured; another program, a knob or the camera itself changed it. It \
         is set back, and the specimen is begun anew"
    )]
    CameraChanged { name: String, expected: String, found: String },
    /// Another camera answers where the one of this process was.
    #[error(
        "camera: {found} answers in the place of {expected}. Put the first one back. To use the new one, check its scale and axis, and start \
         carved again"
    )]
    OtherCamera { expected: String, found: String },
    /// A frame was requested before an acquisition was started.
    #[error("camera: not armed")]
    NotArmed,
    /// No complete frame came before the deadline.
    #[error("camera: no whole frame within {waited_ms} ms after {attempts} triggers; last: {last}")]
    NoFrame { waited_ms: u128, attempts: u32, last: String },
    /// The frames of a stream stopped.
    #[error(
        "camera: no whole frame for {waited_ms} ms after {frames} frames of a stream; last: {last}. If it comes again, check the network \
         cable and the other traffic on its network"
    )]
    StreamSilent { waited_ms: u128, frames: u64, last: String },
    /// The camera's clock or its frame numbers began anew in the middle of a stream.
    #[error(
        "camera: its {counter} went from {before} to {after} in the middle of a stream; the camera restarted. The frames are not used. Check its \
         power supply. If it comes again, take the views one by one (`order = \"sequential\"`)"
    )]
    StreamRestarted { counter: &'static str, before: String, after: String },
    /// The camera's clock does not run at the frequency that the camera reports.
    #[error(
        "camera: its clock advanced by {camera_s:.3} s while {host_s:.3} s passed on this computer's clock, with {ticks_per_s} ticks per second as \
         the camera reports. The times of its frames are not used. Update the camera's firmware, or take the views one by one \
         (`order = \"sequential\"`)"
    )]
    CameraClock { camera_s: f64, host_s: f64, ticks_per_s: u64 },
    /// The camera refuses a value or a command.
    #[error("camera: {what}: {why}")]
    Camera { what: String, why: String },
    /// A specimen came in while no run was there to ask for it.
    #[error(
        "sampler: a specimen is in the capillary that no run asked for. It is not measured. Empty the capillary. If it is empty, the input \
         is stuck: check the wire"
    )]
    Unasked,
    /// Pictures of another program.
    #[error(transparent)]
    Views(#[from] ViewsError),
    /// The sampler did not do its part for a well.
    #[error("sampler: well {well}: {why}")]
    Sampler { well: String, why: String },
}

impl DeviceError {
    /// Whether the camera does not answer, or is not ours. It is opened again when it answers.
    pub fn is_loss_of_camera(&self) -> bool {
        matches!(
            self,
            Self::ControlLost
                | Self::CameraSilent { .. }
                | Self::NotController { .. }
                | Self::OtherCamera { .. }
                | Self::Open { device: "camera", .. }
        )
    }

    /// Whether the frames of a turn did not come or cannot be used, though the camera is there. Another turn may succeed.
    pub fn is_of_frames(&self) -> bool {
        matches!(
            self,
            Self::NoFrame { .. }
                | Self::StreamSilent { .. }
                | Self::StreamRestarted { .. }
                | Self::CameraClock { .. }
                | Self::CameraChanged { .. }
        )
    }

    /// Whether a person or a safety circuit has the axis, or its machine's program waits for a person. Nothing is sent to the axis then.
    pub fn is_in_a_persons_hands(&self) -> bool {
        matches!(self, Self::Intervention { .. } | Self::VastList { .. } | Self::VastProgram { .. })
    }
}

/// One setting of a device that differs from the configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Its name in the device.
    pub name: String,
    /// The value in the configuration, or the rule that follows from it.
    pub configured: String,
    /// The value in the device.
    pub found: String,
}

impl Difference {
    /// A difference of these three texts.
    pub fn new(name: impl Into<String>, configured: impl Into<String>, found: impl Into<String>) -> Self {
        Self { name: name.into(), configured: configured.into(), found: found.into() }
    }
}

/// One line per difference.
fn rows(differences: &[Difference]) -> String {
    differences.iter().map(|d| format!("\n  {}: configured {}, found {}", d.name, d.configured, d.found)).collect()
}
