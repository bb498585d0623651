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

/// Code of an axis whose controller does not answer.
const ROTATION_LOST: &str = "rotation_lost";

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
    use SchedulerAction::{EscalateOperator, PauseInstrument};
    let (code, category, action) = match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => match e {
            DeviceError::NoFrame { .. }
            | DeviceError::Camera { .. }
            | DeviceError::ControlLost
            | DeviceError::NotController { .. }
            | DeviceError::NotArmed => ("camera_failed", "camera", PauseInstrument),
            DeviceError::Sampler { .. } => ("sampler_failed", "sampler", PauseInstrument),
            // What the controller was told or is set to is not what its machine allows: a person has to look.
            DeviceError::Alarm { .. } | DeviceError::Skew { .. } | DeviceError::Stalled { .. } => {
                ("rotation_alarm", "motion", EscalateOperator)
            }
            DeviceError::Mismatch { .. } => ("rotation_settings", "motion", EscalateOperator),
            DeviceError::Gone { .. } | DeviceError::Silent { .. } | DeviceError::Open { .. } => (ROTATION_LOST, "motion", PauseInstrument),
            // Nothing here ends what the machine is in: a person has to.
            DeviceError::OutOfStep { .. } | DeviceError::Late { .. } => ("rotation_suspect", "motion", EscalateOperator),
            // The next reference finds the axis again.
            DeviceError::Translation { .. } | DeviceError::Suspect { .. } | DeviceError::Missed { .. } | DeviceError::Unexpected { .. } => {
                ("rotation_suspect", "motion", SchedulerAction::Retry)
            }
            _ => ("rotation_failed", "motion", PauseInstrument),
        },
        RunError::Acquisition(_) => ("revolution_failed", "motion", PauseInstrument),
        RunError::Store(_) => ("store_failed", "storage", PauseInstrument),
        RunError::SpecimenThread => ("internal_error", "software", PauseInstrument),
    };
    Fault {
        seq,
        code: code.into(),
        category: category.into(),
        message: error.to_string(),
        recoverable: lost_device(error).is_none(),
        scheduler_action: action,
        operator_required: action != SchedulerAction::Retry,
        since: jiff::Timestamp::now().to_string(),
    }
}
