//! Device checks between runs, once a second: the axis, the cameras and the sampler's sensor. A lost device is searched until it answers.
//!
//! ```text
//! heartbeat ── at rest ──► blocking thread: check the axis, reopen a lost camera ──► found: its faults are cleared ── ready
//!   ▲                                                                          └──► lost: a fault is raised
//!   └──────────────────── next heartbeat ◄── the instrument comes back ──────────────┘
//! ```

use super::Instrument;
use carved_devices::DeviceError;
use carved_devices::outputs::{self, OutputStatus};
use std::time::Duration;
use tokio::task::JoinHandle;

/// Interval during a run in which it is checked whether a device is known to be lost. The check costs one system call.
pub const LOOK: Duration = Duration::from_millis(50);

/// The result of a device check.
pub struct DevicesFound {
    pub rotation: Result<(), DeviceError>,
    pub camera: Result<(), DeviceError>,
    /// Outputs of the controller. Empty while it is lost.
    pub outputs: Vec<OutputStatus>,
}

/// A device check in progress. It owns the instrument meanwhile.
pub type Search = JoinHandle<(Instrument, DevicesFound)>;

pub fn begin(mut instrument: Instrument) -> Search {
    tokio::task::spawn_blocking(move || {
        let rotation = instrument.rig.rotation.check();
        if rotation.is_ok() {
            // No pictures are taken between runs. A controller that was lost or restarted may have other output states than commanded.
            outputs::views_off(instrument.rig.rotation.as_mut());
        }
        let outputs = instrument.rig.rotation.outputs().map(|outputs| outputs.statuses()).unwrap_or_default();
        let found = DevicesFound { rotation, camera: instrument.rig.camera.reopen(), outputs };
        // Read the sensor also while a person has the axis: specimens may be exchanged by hand then.
        if found.rotation.as_ref().err().is_none_or(DeviceError::is_in_a_persons_hands)
            && let Err(error) = instrument.sampler.look(instrument.rig.rotation.as_mut())
        {
            tracing::debug!(%error, "the sampler's wire cannot be read");
        }
        (instrument, found)
    })
}
