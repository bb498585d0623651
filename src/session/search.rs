//! A camera that is lost between runs, or was lost in one, is looked for until it answers.
//!
//! ```text
//! beat ── lost, at rest ──► blocking thread: reopen ──► there: its faults are over ── ready
//!   ▲                                             └──► not there: the instrument comes back
//!   └────────────────────── next beat ◄─────────────────────┘
//! ```

use super::worker::Instrument;
use crate::device::DeviceError;
use std::time::Duration;
use tokio::task::{JoinError, JoinHandle};

/// During a run, how often it is looked whether the camera is known to be lost.
pub const LOOK: Duration = Duration::from_millis(250);

/// One look for a lost camera; it owns the instrument meanwhile.
pub type Search = JoinHandle<(Instrument, Result<(), DeviceError>)>;

pub fn begin(mut instrument: Instrument) -> Search {
    tokio::task::spawn_blocking(move || {
        let found = instrument.rig.camera.reopen();
        (instrument, found)
    })
}

/// The end of a search; never, where none is under way.
pub async fn ended(search: &mut Option<Search>) -> Result<(Instrument, Result<(), DeviceError>), JoinError> {
    let Some(task) = search else { return std::future::pending().await };
    let result = task.await;
    *search = None;
    result
}
