//! What ended a run, as the fault that people and schedulers read.

use super::worker::RunError;
use super::{Fault, SchedulerAction};
use crate::acquisition::AcquisitionError;
use crate::device::DeviceError;

pub fn of(seq: u64, error: &RunError) -> Fault {
    let (code, category) = match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => match e {
            DeviceError::NoFrame { .. } | DeviceError::Camera { .. } => ("camera_failed", "camera"),
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
        recoverable: true,
        scheduler_action: SchedulerAction::PauseInstrument,
        operator_required: true,
        since: jiff::Timestamp::now().to_string(),
    }
}
