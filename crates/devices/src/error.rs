//! What can go wrong at a device, with both numbers and the way out.

use carved_core::units::Steps;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    #[error("{device}: cannot open {address}: {why}. {remedy}")]
    Open { device: &'static str, address: String, why: String, remedy: &'static str },
    #[error("{device}: this build has no driver for {driver:?}. {remedy}")]
    NotBuilt { device: &'static str, driver: &'static str, remedy: &'static str },
    #[error("{device}: {name} = {found} in the configuration; {rule}")]
    Setting { device: &'static str, name: &'static str, found: String, rule: String },
    #[error("{device}: no answer to {request:?} within {waited_ms} ms. Check power and cable, then reference the axis again")]
    Silent { device: &'static str, request: String, waited_ms: u128 },
    #[error("{device}: the connection is gone ({why}). Check power and cable")]
    Gone { device: &'static str, why: String },
    #[error("{device}: expected {expected}, got {found:?}")]
    Unexpected { device: &'static str, expected: String, found: String },
    #[error("{device}: its settings are not those of the configuration; it will not move until they agree:{}", rows(differences))]
    Mismatch { device: &'static str, differences: Vec<Difference> },
    #[error(
        "{device}: the two motors of the pair stand at {first} and {second}; they may be {limit} steps apart. Both were stopped. Look for a blocked motor, turn the capillary free of twist, then reference the axis again"
    )]
    Skew { device: &'static str, first: Steps, second: Steps, limit: u32 },
    #[error("{device}: {motor} stalled at {at} on its way to {target} ({evidence}). Free the capillary, then reference the axis again")]
    Stalled { device: &'static str, motor: String, at: Steps, target: Steps, evidence: String },
    #[error("{device}: the controller reports {what}. Clear the cause, then reference the axis again")]
    Alarm { device: &'static str, what: String },
    /// A person, or a safety circuit that a person resets, has taken the axis over: feed hold, knob, emergency stop, door.
    #[error("{device}: {what}. The axis was stopped there and the instrument waits. {way_out}")]
    Intervention { device: &'static str, what: String, way_out: &'static str },
    #[error("rotation axis: not referenced; its position is not known, so it refuses to move")]
    NotReferenced,
    #[error("rotation axis: its position cannot be trusted ({why}). Reference the axis again")]
    Suspect { why: String },
    #[error("rotation axis: sent to {target}, stands at {achieved}. Look for a slipping or blocked shaft, then reference the axis again")]
    Missed { target: Steps, achieved: Steps },
    #[error("rotation axis: VAST may be out of step with its list ({why}). End the list at VAST, then begin the specimen anew")]
    OutOfStep { why: String },
    #[error("{device}: {what} within {waited_ms} ms. Look at the machine, then begin the specimen anew")]
    Late { device: &'static str, what: &'static str, waited_ms: u128 },
    #[error("rotation axis: sent to {target}, but its list goes on at {}; a trigger leads nowhere else", next.map_or("its end".into(), |n| n.to_string()))]
    NotNext { target: Steps, next: Option<Steps> },
    #[error("{device}: {}: {why}. Check the folder, its share and the right to write there", path.display())]
    List { device: &'static str, path: PathBuf, why: String },
    #[error("translation axis: {why}. Reference the axes again")]
    Translation { why: String },
    #[error("rotation axis: stopped")]
    Stopped,
    #[error("camera: {address} is controlled by another program. Close it, or wait until the camera's heartbeat has run out")]
    NotController { address: String },
    #[error("camera: control of the camera was lost; another program took it, or the cable is out. It is opened again when it answers")]
    ControlLost,
    #[error("camera: no answer to {request} ({why}). Check its power and cable; it is opened again when it answers")]
    CameraSilent { request: String, why: String },
    #[error("camera: not armed")]
    NotArmed,
    #[error("camera: no whole frame within {waited_ms} ms after {attempts} triggers; last: {last}")]
    NoFrame { waited_ms: u128, attempts: u32, last: String },
    #[error("camera: {what}: {why}")]
    Camera { what: String, why: String },
    #[error(
        "sampler: a specimen is in the capillary that no run asked for; nothing is measured of it. Empty the capillary; if it is empty, the input is stuck: look at the wire"
    )]
    Unasked,
    #[error("sampler: well {well}: {why}")]
    Sampler { well: String, why: String },
}

/// One setting of a device that is not what the configuration says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    pub name: String,
    pub configured: String,
    pub found: String,
}

impl Difference {
    pub fn new(name: impl Into<String>, configured: impl Into<String>, found: impl Into<String>) -> Self {
        Self { name: name.into(), configured: configured.into(), found: found.into() }
    }
}

/// A line for each.
fn rows(differences: &[Difference]) -> String {
    differences.iter().map(|d| format!("\n  {}: configured {}, found {}", d.name, d.configured, d.found)).collect()
}
