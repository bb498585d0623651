//! Who uses the instrument, which devices are lost, and the background tasks that use the instrument between runs.
//!
//! ```text
//!            begin_look, begin_preflight, begin_picture ──► BackgroundTask ──► done ─┐
//! at rest ───┤                                                                       ├──► at rest
//!            take ──► the run's worker ──► give_back ────────────────────────────────┘
//! ```

use super::super::Check;
use super::super::Instrument;
use super::super::halt::Halt;
use super::super::handle::Refusal;
use super::super::preflight::{self, DeviceReport};
use super::super::search::{self, DevicesFound, Search};
use carved_devices::acquisition::SweepPlan;
use carved_devices::cancel::CancelToken;
use carved_devices::views::ViewsError;
use carved_devices::{DeviceError, Link};
use carved_records::{Device, RunPlan, fault_table};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::task::{JoinError, JoinHandle};

/// The instrument, the background task that uses it, and the lost devices.
pub(super) struct Devices {
    /// `None` while a worker or a background task uses it.
    instrument: Option<Instrument>,
    task: Option<BackgroundTask>,
    /// Devices that no longer answer, oldest loss first. No run can start without them.
    lost: Vec<Device>,
    /// State of the camera connection. It can be read while a worker uses the instrument.
    camera: Link,
    /// As `camera`, of the axis that the worker took.
    rotation: Link,
    /// The emergency stop was pressed while a background task used the instrument, which may have opened the axis again since.
    is_stop_due: bool,
}

/// A plan to check on the instrument, and the channel for the answer.
pub(super) struct PreflightRequest {
    pub plan: RunPlan,
    pub answer: oneshot::Sender<Result<Vec<Check>, Refusal>>,
}

enum BackgroundTask {
    Search(Search),
    Preflight { look: JoinHandle<(Instrument, DeviceReport)>, request: Box<PreflightRequest> },
    Picture { look: JoinHandle<(Instrument, PictureSeen)>, cancel: CancelToken, answer: PictureAnswer },
}

/// The channel for a picture at rest, JPEG.
pub(super) type PictureAnswer = oneshot::Sender<Result<Arc<Vec<u8>>, Refusal>>;

/// What the devices said while a picture was taken at rest, and the picture or why there is none.
type PictureSeen = (DeviceReport, Result<Arc<Vec<u8>>, String>);

/// The result of a background task.
pub(super) enum Done {
    Searched(DevicesFound),
    Preflight(DeviceReport, Box<PreflightRequest>),
    Picture(PictureSeen, PictureAnswer),
}

/// What a device check says about one device.
#[derive(Debug)]
pub(super) enum Finding {
    There(Device),
    Lost(Device, DeviceError),
    /// The device needs a person, or its settings are wrong. The fault of this code stays open until a check no longer finds it.
    Stands(&'static str, DeviceError),
}

impl Devices {
    pub fn new(instrument: Instrument) -> Self {
        Self {
            camera: instrument.rig.camera.link(),
            rotation: instrument.rig.rotation.stop_handle().link().clone(),
            instrument: Some(instrument),
            task: None,
            lost: Vec::new(),
            is_stop_due: false,
        }
    }

    /// The instrument. `None` while a worker or a background task uses it.
    pub fn at_rest(&self) -> Option<&Instrument> {
        self.instrument.as_ref()
    }

    /// Takes the instrument for a worker.
    pub fn take(&mut self) -> Option<Instrument> {
        let instrument = self.instrument.take()?;
        self.rotation = instrument.rig.rotation.stop_handle().link().clone();
        Some(instrument)
    }

    /// Returns the instrument of a worker.
    pub fn give_back(&mut self, instrument: Instrument) {
        self.instrument = Some(instrument);
    }

    /// Resets axis and sampler for a new run.
    pub fn begin_run(&mut self) {
        if let Some(instrument) = &mut self.instrument {
            instrument.rig.rotation.begin_run();
            instrument.sampler.begin_run();
        }
    }

    /// Whether the axis follows a position list of its own controller. Such an axis cannot take up a specimen twice.
    pub fn steps_through_a_list(&self) -> bool {
        self.instrument.as_ref().is_some_and(|instrument| instrument.rig.rotation.capabilities().trigger_only)
    }

    /// Whether a background task uses the instrument.
    pub fn are_busy(&self) -> bool {
        self.task.is_some()
    }

    /// Whether commands wait for the device check. They do not wait while a device is lost, because the check then takes long.
    pub fn are_looked_at(&self) -> bool {
        matches!(self.task, Some(BackgroundTask::Search(_))) && self.lost.is_empty()
    }

    /// Ends the wait for a picture at rest. Returns whether one was being taken.
    pub fn end_picture(&self) -> bool {
        let Some(BackgroundTask::Picture { cancel, .. }) = &self.task else { return false };
        cancel.cancel();
        true
    }

    /// Whether a plan is being checked on the instrument. No run can start meanwhile.
    pub fn are_checked(&self) -> bool {
        matches!(self.task, Some(BackgroundTask::Preflight { .. }))
    }

    /// Begins a check of the devices between runs.
    pub fn begin_look(&mut self) {
        self.task = self.instrument.take().map(|instrument| BackgroundTask::Search(search::begin(instrument)));
    }

    /// Begins to check a plan on the instrument. `deadline` is the deadline of the frame that the check grabs. The emergency stop
    /// ends it. Returns the request if the instrument is in use.
    pub fn begin_preflight(
        &mut self,
        request: Box<PreflightRequest>,
        sweep: Option<SweepPlan>,
        deadline: Duration,
        halt: &Halt,
    ) -> Result<(), Box<PreflightRequest>> {
        let Some((instrument, cancel)) = self.take_aimed(halt) else { return Err(request) };
        let look = tokio::task::spawn_blocking(move || preflight::look(instrument, sweep, deadline, &cancel));
        self.task = Some(BackgroundTask::Preflight { look, request });
        Ok(())
    }

    /// Begins to take a picture at rest, as [`Self::begin_preflight`]. Returns the channel if the instrument is in use.
    pub fn begin_picture(&mut self, answer: PictureAnswer, deadline: Duration, halt: &Halt) -> Result<(), PictureAnswer> {
        let Some((instrument, cancel)) = self.take_aimed(halt) else { return Err(answer) };
        let ended = cancel.clone();
        let look = tokio::task::spawn_blocking(move || {
            let (instrument, seen) = preflight::look(instrument, None, deadline, &ended);
            let picture = seen
                .picture()
                .map_err(|why| if ended.is_cancelled() { "a command or an emergency stop came first".to_owned() } else { why });
            (instrument, (seen, picture))
        });
        self.task = Some(BackgroundTask::Picture { look, cancel, answer });
        Ok(())
    }

    /// Aims the emergency stop at the axis at rest. A check may have opened its port anew, also after the stop was written to the old one:
    /// then it is written again.
    pub fn aim(&mut self, halt: &Halt) {
        let Some(instrument) = &self.instrument else { return };
        halt.aim(instrument.rig.rotation.stop_handle(), CancelToken::default());
        if std::mem::take(&mut self.is_stop_due) {
            halt.stop_motors();
        }
    }

    /// Takes an emergency stop that was pressed. It is repeated when a background task that runs now has ended.
    pub fn note_stop(&mut self) {
        self.is_stop_due = self.are_busy();
    }

    /// Takes the instrument for a task that the emergency stop ends.
    fn take_aimed(&mut self, halt: &Halt) -> Option<(Instrument, CancelToken)> {
        let instrument = self.instrument.take()?;
        let cancel = CancelToken::new();
        halt.aim(instrument.rig.rotation.stop_handle(), cancel.clone());
        Some((instrument, cancel))
    }

    /// Waits for the background task and takes back the instrument. Pending forever if no task runs.
    ///
    /// # Errors
    /// The task panicked.
    pub async fn done(&mut self) -> Result<Done, JoinError> {
        // Borrows the task: if this future is dropped half-way, the next call waits for the same task.
        enum Brought {
            Search(DevicesFound),
            Preflight(DeviceReport),
            Picture(PictureSeen),
        }
        let (instrument, brought) = match &mut self.task {
            None => return std::future::pending().await,
            Some(BackgroundTask::Search(search)) => search.await.map(|(instrument, found)| (instrument, Brought::Search(found)))?,
            Some(BackgroundTask::Preflight { look, .. }) => look.await.map(|(instrument, seen)| (instrument, Brought::Preflight(seen)))?,
            Some(BackgroundTask::Picture { look, .. }) => look.await.map(|(instrument, seen)| (instrument, Brought::Picture(seen)))?,
        };
        self.instrument = Some(instrument);
        match (brought, self.task.take()) {
            (Brought::Search(found), _) => Ok(Done::Searched(found)),
            (Brought::Preflight(seen), Some(BackgroundTask::Preflight { request, .. })) => Ok(Done::Preflight(seen, request)),
            (Brought::Picture(seen), Some(BackgroundTask::Picture { answer, .. })) => Ok(Done::Picture(seen, answer)),
            (Brought::Preflight(_) | Brought::Picture(_), _) => std::future::pending().await,
        }
    }

    /// The device that has been lost longest.
    pub fn lost(&self) -> Option<Device> {
        self.lost.first().copied()
    }

    pub fn has_lost(&self, device: Device) -> bool {
        self.lost.contains(&device)
    }

    /// Marks a device as lost.
    pub fn lose(&mut self, device: Device) {
        if !self.lost.contains(&device) {
            self.lost.push(device);
        }
    }

    /// Marks a device as found. Returns whether it was lost.
    pub fn mark_found(&mut self, device: Device) -> bool {
        let before = self.lost.len();
        self.lost.retain(|lost| *lost != device);
        self.lost.len() < before
    }

    /// Whether the camera is lost. It can be asked while a worker uses the instrument.
    pub fn camera_is_lost(&self) -> bool {
        self.camera.is_lost()
    }

    /// Whether the axis has hung up while a worker uses it.
    pub fn rotation_has_hung_up(&self) -> bool {
        self.instrument.is_none() && self.rotation.is_lost()
    }

    #[cfg(test)]
    pub fn instrument_mut(&mut self) -> &mut Instrument {
        self.instrument.as_mut().unwrap()
    }
}

/// The findings of a device check, the camera first. Errors that do not show a loss are only logged.
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
        Err(error @ DeviceError::Unreadable { .. }) => Some(Finding::Stands(fault_table::ROTATION_FAILED.code, error)),
        Err(error @ DeviceError::Mismatch { .. }) => Some(Finding::Stands(fault_table::ROTATION_SETTINGS.code, error)),
        Err(error) => {
            tracing::debug!(%error, "the rotation axis is not back yet");
            None
        }
    };
    // For an axis that another program turns, the check reads the folder of its pictures.
    let pictures = matches!(rotation, Some(Finding::There(_))).then_some(Finding::There(Device::Pictures));
    camera.into_iter().chain(rotation).chain(pictures).collect()
}

/// The axis is held by a person or a safety circuit, or the program of its machine waits for a person. The fault stays open while this
/// lasts, even if it was acknowledged. A lost axis counts as found only once it is free.
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
        assert!(!devices.mark_found(Device::Camera));
        for device in [Device::Rotation, Device::Camera, Device::Rotation] {
            devices.lose(device);
        }
        assert_eq!((devices.lost(), devices.has_lost(Device::Camera)), (Some(Device::Rotation), true));
        assert!(devices.mark_found(Device::Rotation) && !devices.mark_found(Device::Rotation));
        assert_eq!(devices.lost(), Some(Device::Camera));
    }

    #[test]
    fn only_a_device_that_does_not_answer_is_lost() {
        let silent = || DeviceError::Silent { device: "rotation axis", request: "?".into(), waited_ms: 500, remedy: "Check it".into() };
        let taken = DeviceError::Intervention { device: "axis", what: "feed hold".into(), way_out: "Release it." };
        let of = |rotation| findings(DevicesFound { rotation, camera: Err(DeviceError::ControlLost), outputs: Vec::new() });
        assert!(matches!(of(Ok(()))[..], [Finding::There(Device::Rotation), Finding::There(Device::Pictures)]));
        let gone = || DeviceError::from(ViewsError::FolderLost { path: "/mnt/vast".into(), why: "stale".into() });
        assert!(matches!(of(Err(gone()))[..], [Finding::Lost(Device::Pictures, _)]));
        assert!(matches!(of(Err(silent()))[..], [Finding::Lost(Device::Rotation, _)]));
        assert!(matches!(of(Err(taken))[..], [Finding::Stands(code, _)] if code == fault_table::ROTATION_INTERVENTION.code));
        let shared = DeviceError::Unreadable { device: "axis", request: "$$".into(), found: "it lacks $1".into(), remedy: "Exit".into() };
        assert!(matches!(of(Err(shared))[..], [Finding::Stands(code, _)] if code == fault_table::ROTATION_FAILED.code));
        assert!(of(Err(DeviceError::NotArmed)).is_empty());
    }
}
