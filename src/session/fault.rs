//! What ended a run, as the fault that people and schedulers read.

use super::worker::RunError;
use super::{Fault, SchedulerAction};
use crate::acquisition::AcquisitionError;
use crate::device::DeviceError;

/// A device that does not answer any more.
#[derive(Debug, Clone, Copy)]
pub enum Lost {
    Camera,
    Rotation,
}

impl Lost {
    pub fn way_out(self) -> &'static str {
        match self {
            Self::Camera => "the camera is lost: check its power and cable, then start carved again",
            Self::Rotation => "the rotation axis is lost: check its power and cable, then start carved again",
        }
    }
}

/// Which device this error says is gone, if any.
pub fn lost_device(error: &RunError) -> Option<Lost> {
    let (RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. })) = error else { return None };
    match e {
        DeviceError::ControlLost | DeviceError::NotController { .. } => Some(Lost::Camera),
        DeviceError::Gone { .. } | DeviceError::Silent { .. } => Some(Lost::Rotation),
        _ => None,
    }
}

pub fn of(seq: u64, error: &RunError) -> Fault {
    let (code, category) = match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => match e {
            DeviceError::NoFrame { .. }
            | DeviceError::Camera { .. }
            | DeviceError::ControlLost
            | DeviceError::NotController { .. }
            | DeviceError::NotArmed => ("camera_failed", "camera"),
            DeviceError::Sampler { .. } => ("sampler_failed", "sampler"),
            _ => ("rotation_failed", "motion"),
        },
        RunError::Acquisition(_) => ("revolution_failed", "motion"),
        RunError::Store(_) => ("store_failed", "storage"),
        RunError::SpecimenThread => ("internal_error", "software"),
    };
    Fault {
        seq,
        code: code.into(),
        category: category.into(),
        message: error.to_string(),
        recoverable: lost_device(error).is_none(),
        scheduler_action: SchedulerAction::PauseInstrument,
        operator_required: true,
        since: jiff::Timestamp::now().to_string(),
    }
}
