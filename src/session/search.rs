//! Between runs the axis is asked once a second whether it is still there and the sampler's wire whether a specimen is, and what is
//! lost is looked for until it answers.
//!
//! ```text
//! beat ── at rest ──► blocking thread: check the axis, reopen a lost camera ──► there: its faults are over ── ready
//!   ▲                                                                     └──► lost: a fault of its own
//!   └────────────────────── next beat ◄── the instrument comes back ────────────┘
//! ```

use super::worker::Instrument;
use carved_devices::DeviceError;
use carved_devices::outputs::{self, OutputStatus};
use std::time::Duration;
use tokio::task::JoinHandle;

/// During a run, how often it is looked whether the camera is known to be lost.
pub const LOOK: Duration = Duration::from_millis(250);

/// What a look has found of each device.
pub struct DevicesFound {
    pub rotation: Result<(), DeviceError>,
    pub camera: Result<(), DeviceError>,
    /// Of the controller, which is none while it is lost.
    pub outputs: Vec<OutputStatus>,
}

/// One look at the devices; it owns the instrument meanwhile.
pub type Search = JoinHandle<(Instrument, DevicesFound)>;

pub fn begin(mut instrument: Instrument) -> Search {
    tokio::task::spawn_blocking(move || {
        let rotation = instrument.rig.rotation.check();
        if rotation.is_ok() {
            // At rest there are no pictures. A controller that was lost or restarted has other outputs than it was told.
            outputs::views_off(instrument.rig.rotation.as_mut());
        }
        let outputs = instrument.rig.rotation.outputs().map(|outputs| outputs.statuses()).unwrap_or_default();
        let found = DevicesFound { rotation, camera: instrument.rig.camera.reopen(), outputs };
        // The wire is watched also while a person has the axis: specimens may be exchanged by hand then.
        if found.rotation.as_ref().err().is_none_or(DeviceError::is_in_a_persons_hands)
            && let Err(error) = instrument.sampler.look(instrument.rig.rotation.as_mut())
        {
            tracing::debug!(%error, "the sampler's wire cannot be read");
        }
        (instrument, found)
    })
}
