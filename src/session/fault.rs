//! What ended a run, as the fault that people and schedulers read; `docs/faults.md` has the table.

use super::worker::RunError;
use super::{Fault, SchedulerAction};
use crate::acquisition::AcquisitionError;
use crate::device::DeviceError;

/// A device that does not answer any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lost {
    Camera,
    Rotation,
}

/// Code of an axis whose controller does not answer.
const ROTATION_LOST: &str = "rotation_lost";
/// Code of a camera that does not answer, and of one that another program controls.
const CAMERA_LOST: &str = "camera_lost";
const CAMERA_TAKEN: &str = "camera_taken";

impl Lost {
    pub fn way_out(self) -> &'static str {
        match self {
            Self::Camera => {
                "the camera is lost: check its power and cable, and that no other program has it; it is opened again when it answers"
            }
            Self::Rotation => "the rotation axis is lost: check its power and cable; it is opened again when it answers",
        }
    }

    pub fn is_back(self) -> &'static str {
        match self {
            Self::Camera => "the camera is back",
            Self::Rotation => "the rotation axis is back",
        }
    }

    /// Whether a fault says no more than that this device is lost, so that it is over once the device is back.
    pub fn is_all_of(self, fault: &Fault) -> bool {
        match self {
            Self::Camera => [CAMERA_LOST, CAMERA_TAKEN].contains(&fault.code.as_str()),
            Self::Rotation => fault.code == ROTATION_LOST,
        }
    }
}

fn device_error(error: &RunError) -> Option<&DeviceError> {
    match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => Some(e),
        _ => None,
    }
}

/// Which device this error says is gone, if any.
pub fn lost_device(error: &RunError) -> Option<Lost> {
    match device_error(error)? {
        DeviceError::ControlLost
        | DeviceError::CameraSilent { .. }
        | DeviceError::NotController { .. }
        | DeviceError::Open { device: "camera", .. } => Some(Lost::Camera),
        DeviceError::Gone { .. } | DeviceError::Silent { .. } => Some(Lost::Rotation),
        _ => None,
    }
}

pub fn of(seq: u64, error: &RunError) -> Fault {
    use SchedulerAction::{EscalateOperator, PauseInstrument, Retry};
    let (code, category, action) = match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => match e {
            DeviceError::ControlLost | DeviceError::CameraSilent { .. } | DeviceError::Open { device: "camera", .. } => {
                (CAMERA_LOST, "camera", PauseInstrument)
            }
            DeviceError::NotController { .. } => (CAMERA_TAKEN, "camera", PauseInstrument),
            DeviceError::NoFrame { .. } => ("camera_no_frame", "camera", Retry),
            DeviceError::Camera { .. } | DeviceError::NotArmed => ("camera_refused", "camera", EscalateOperator),
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
                ("rotation_suspect", "motion", Retry)
            }
            _ => ("rotation_failed", "motion", PauseInstrument),
        },
        RunError::Acquisition(_) => ("revolution_failed", "motion", PauseInstrument),
        RunError::Second(_) => ("second_camera_failed", "camera", PauseInstrument),
        RunError::Store(_) => ("store_failed", "storage", PauseInstrument),
        RunError::SpecimenThread => ("internal_error", "software", PauseInstrument),
    };
    Fault {
        seq,
        code: code.into(),
        category: category.into(),
        message: error.to_string(),
        // What is lost comes back by itself.
        recoverable: true,
        scheduler_action: action,
        operator_required: action != Retry,
        since: jiff::Timestamp::now().to_string(),
    }
}
