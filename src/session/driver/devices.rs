//! Who has the instrument, which devices are lost, and what takes the instrument for a moment while no run has it.
//!
//! ```text
//!            begin_look, begin_preflight ──► BackgroundTask ──► done ─┐
//! at rest ───┤                                                        ├──► at rest
//!            take ──► the run's worker ──► give_back ─────────────────┘
//! ```

use super::super::Check;
use super::super::handle::Refusal;
use super::super::preflight::{self, DeviceReport};
use super::super::search::{self, DevicesFound, Search};
use super::super::worker::Instrument;
use carved_devices::views::ViewsError;
use carved_devices::{DeviceError, Link};
use carved_records::{Device, RunPlan, fault_table};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::task::{JoinError, JoinHandle};

/// The instrument, wherever it is now.
pub(super) struct Devices {
    /// At rest while there is no worker and no task.
    instrument: Option<Instrument>,
    task: Option<BackgroundTask>,
    /// Devices that do not answer any more, oldest first. Nothing runs without them.
    lost: Vec<Device>,
    /// Whether the camera is there, wherever the instrument is.
    camera: Link,
}

/// A plan that is checked on the instrument, and who waits for the answer.
pub(super) struct PreflightRequest {
    pub plan: RunPlan,
    pub answer: oneshot::Sender<Result<Vec<Check>, Refusal>>,
}

enum BackgroundTask {
    Search(Search),
    Preflight { look: JoinHandle<(Instrument, DeviceReport)>, request: Box<PreflightRequest> },
}

/// What a background task has found.
pub(super) enum Done {
    Searched(DevicesFound),
    Preflight(DeviceReport, Box<PreflightRequest>),
}

/// What a look says of a device.
#[derive(Debug)]
pub(super) enum Finding {
    There(Device),
    Lost(Device, DeviceError),
    /// A fault of this code is open for as long as it is found.
    Stands(&'static str, DeviceError),
}

impl Devices {
    pub fn new(instrument: Instrument) -> Self {
        Self { camera: instrument.rig.camera.link(), instrument: Some(instrument), task: None, lost: Vec::new() }
    }

    /// The instrument while nobody has it.
    pub fn at_rest(&self) -> Option<&Instrument> {
        self.instrument.as_ref()
    }

    /// Hands the instrument over, to a worker.
    pub fn take(&mut self) -> Option<Instrument> {
        self.instrument.take()
    }

    /// The worker hands the instrument back.
    pub fn give_back(&mut self, instrument: Instrument) {
        self.instrument = Some(instrument);
    }

    /// A run begins: its sampler forgets the run before.
    pub fn begin_run(&mut self) {
        self.instrument.iter_mut().for_each(|instrument| instrument.sampler.begin_run());
    }

    /// Whether the axis steps through a list of its controller, which takes no specimen up twice.
    pub fn steps_through_a_list(&self) -> bool {
        self.instrument.as_ref().is_some_and(|instrument| instrument.rig.rotation.capabilities().trigger_only)
    }

    /// Whether anything is under way beside a run.
    pub fn are_busy(&self) -> bool {
        self.task.is_some()
    }

    /// Whether commands wait: a look takes milliseconds, unless a device is away.
    pub fn are_looked_at(&self) -> bool {
        matches!(self.task, Some(BackgroundTask::Search(_))) && self.lost.is_empty()
    }

    /// Whether a plan is checked on the instrument, so that no run can start.
    pub fn are_checked(&self) -> bool {
        matches!(self.task, Some(BackgroundTask::Preflight { .. }))
    }

    /// Looks whether the devices at rest are still there.
    pub fn begin_look(&mut self) {
        self.task = self.instrument.take().map(|instrument| BackgroundTask::Search(search::begin(instrument)));
    }

    /// Checks a plan on the instrument; `deadline` is that of its frame. Gives the request back where the instrument is away.
    pub fn begin_preflight(&mut self, request: Box<PreflightRequest>, deadline: Duration) -> Result<(), Box<PreflightRequest>> {
        let Some(instrument) = self.instrument.take() else { return Err(request) };
        let look = tokio::task::spawn_blocking(move || preflight::look(instrument, deadline));
        self.task = Some(BackgroundTask::Preflight { look, request });
        Ok(())
    }

    /// The end of a background task, with the instrument at rest again; never, where none is under way.
    ///
    /// # Errors
    /// The task has panicked.
    pub async fn done(&mut self) -> Result<Done, JoinError> {
        // Waited for in place: what is given up half way is still there the next time.
        enum Brought {
            Search(DevicesFound),
            Preflight(DeviceReport),
        }
        let (instrument, brought) = match &mut self.task {
            None => return std::future::pending().await,
            Some(BackgroundTask::Search(search)) => search.await.map(|(instrument, found)| (instrument, Brought::Search(found)))?,
            Some(BackgroundTask::Preflight { look, .. }) => look.await.map(|(instrument, seen)| (instrument, Brought::Preflight(seen)))?,
        };
        self.instrument = Some(instrument);
        match (brought, self.task.take()) {
            (Brought::Search(found), _) => Ok(Done::Searched(found)),
            (Brought::Preflight(seen), Some(BackgroundTask::Preflight { request, .. })) => Ok(Done::Preflight(seen, request)),
            (Brought::Preflight(_), _) => std::future::pending().await,
        }
    }

    /// The device that is lost for the longest time.
    pub fn lost(&self) -> Option<Device> {
        self.lost.first().copied()
    }

    pub fn has_lost(&self, device: Device) -> bool {
        self.lost.contains(&device)
    }

    /// Notes that a device does not answer any more.
    pub fn lose(&mut self, device: Device) {
        if !self.lost.contains(&device) {
            self.lost.push(device);
        }
    }

    /// Notes that a device answers; returns whether it was lost.
    pub fn find(&mut self, device: Device) -> bool {
        let before = self.lost.len();
        self.lost.retain(|lost| *lost != device);
        self.lost.len() < before
    }

    /// Whether the camera is lost, wherever the instrument is.
    pub fn camera_is_lost(&self) -> bool {
        self.camera.is_lost()
    }

    #[cfg(test)]
    pub fn instrument_mut(&mut self) -> &mut Instrument {
        self.instrument.as_mut().unwrap()
    }
}

/// What a look says, the camera first. Errors that say nothing of a loss are logged.
pub(super) fn findings(found: DevicesFound) -> Vec<Finding> {
    let camera = match found.camera {
        Ok(()) => Some(Finding::There(Device::Camera)),
        Err(error) => {
            tracing::debug!(%error, "the camera is not back yet");
            None
        }
    };
    let rotation = match found.rotation {
        Ok(()) => Some(Finding::There(Device::Rotation)),
        Err(error @ DeviceError::Views(ViewsError::FolderLost { .. })) => Some(Finding::Lost(Device::Pictures, error)),
        Err(error @ (DeviceError::Gone { .. } | DeviceError::Silent { .. })) => Some(Finding::Lost(Device::Rotation, error)),
        Err(ref error) if error.is_in_a_persons_hands() => intervention(error),
        Err(error @ DeviceError::Mismatch { .. }) => Some(Finding::Stands(fault_table::ROTATION_SETTINGS.code, error)),
        Err(error) => {
            tracing::debug!(%error, "the rotation axis is not back yet");
            None
        }
    };
    // The check of an axis that another program turns is a look at the folder of its pictures.
    let pictures = matches!(rotation, Some(Finding::There(_))).then_some(Finding::There(Device::Pictures));
    camera.into_iter().chain(rotation).chain(pictures).collect()
}

/// A person or a safety circuit has the axis, or its machine's program waits for a person. The fault is open for as long as that lasts, also where it was acknowledged before it was
/// over. A lost axis counts as back only once it is free.
pub(super) fn intervention(error: &DeviceError) -> Option<Finding> {
    match error {
        DeviceError::Intervention { device, what, way_out } => Some(Finding::Stands(
            fault_table::ROTATION_INTERVENTION.code,
            DeviceError::Intervention { device, what: what.clone(), way_out },
        )),
        DeviceError::VastProgram { device, what, way_out } => {
            Some(Finding::Stands(fault_table::VAST_PROGRAM.code, DeviceError::VastProgram { device, what: what.clone(), way_out }))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::bench::{Arm, instrument};
    use super::*;
    use carved_devices::testing::FakeAxis;

    #[test]
    fn the_instrument_is_at_rest_or_somebody_has_it() {
        let mut devices = Devices::new(instrument(FakeAxis::new(), Arm::default()));
        assert!(devices.at_rest().is_some() && !devices.are_busy());
        let taken = devices.take().unwrap();
        assert!(devices.at_rest().is_none() && devices.take().is_none());
        devices.begin_look();
        assert!(!devices.are_busy(), "there is nothing to look at");
        devices.give_back(taken);
        assert!(devices.at_rest().is_some());
    }

    #[test]
    fn a_device_is_lost_once_and_found_once() {
        let mut devices = Devices::new(instrument(FakeAxis::new(), Arm::default()));
        assert!(!devices.find(Device::Camera));
        for device in [Device::Rotation, Device::Camera, Device::Rotation] {
            devices.lose(device);
        }
        assert_eq!((devices.lost(), devices.has_lost(Device::Camera)), (Some(Device::Rotation), true));
        assert!(devices.find(Device::Rotation) && !devices.find(Device::Rotation));
        assert_eq!(devices.lost(), Some(Device::Camera));
    }

    #[test]
    fn only_a_device_that_does_not_answer_is_lost() {
        let silent = || DeviceError::Silent { device: "rotation axis", request: "?".into(), waited_ms: 500 };
        let taken = DeviceError::Intervention { device: "axis", what: "feed hold".into(), way_out: "Release it." };
        let of = |rotation| findings(DevicesFound { rotation, camera: Err(DeviceError::ControlLost), outputs: Vec::new() });
        assert!(matches!(of(Ok(()))[..], [Finding::There(Device::Rotation), Finding::There(Device::Pictures)]));
        let gone = || DeviceError::from(ViewsError::FolderLost { path: "/mnt/vast".into(), why: "stale".into() });
        assert!(matches!(of(Err(gone()))[..], [Finding::Lost(Device::Pictures, _)]));
        assert!(matches!(of(Err(silent()))[..], [Finding::Lost(Device::Rotation, _)]));
        assert!(matches!(of(Err(taken))[..], [Finding::Stands(code, _)] if code == fault_table::ROTATION_INTERVENTION.code));
        assert!(of(Err(DeviceError::NotArmed)).is_empty());
    }
}
