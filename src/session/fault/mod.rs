//! What ended a run, as the fault that people and schedulers read: which error is which code of the table.

pub mod table;

use super::worker::{OpticsFault, RunError};
use super::{Fault, Phase, SchedulerAction};
use carved_devices::DeviceError;
use carved_devices::acquisition::AcquisitionError;
use table::FaultCode;

/// A device that does not answer any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lost {
    Camera,
    Rotation,
}

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
            Self::Camera => [table::CAMERA_LOST.code, table::CAMERA_TAKEN.code].contains(&fault.code.as_str()),
            Self::Rotation => fault.code == table::ROTATION_LOST.code,
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

/// Whether nothing here ends what the machine is in, so that a person has to, whatever the table says of the code.
fn needs_a_person(error: &DeviceError) -> bool {
    matches!(error, DeviceError::OutOfStep { .. } | DeviceError::Late { .. })
}

fn code_of_device(error: &DeviceError) -> &'static FaultCode {
    match error {
        DeviceError::ControlLost | DeviceError::CameraSilent { .. } | DeviceError::Open { device: "camera", .. } => &table::CAMERA_LOST,
        DeviceError::NotController { .. } => &table::CAMERA_TAKEN,
        DeviceError::NoFrame { .. } => &table::CAMERA_NO_FRAME,
        DeviceError::Camera { .. } | DeviceError::NotArmed => &table::CAMERA_REFUSED,
        DeviceError::Sampler { .. } | DeviceError::Unasked => &table::SAMPLER_FAILED,
        // What the controller was told or is set to is not what its machine allows: a person has to look.
        DeviceError::Alarm { .. } | DeviceError::Skew { .. } | DeviceError::Stalled { .. } => &table::ROTATION_ALARM,
        DeviceError::Intervention { .. } => &table::ROTATION_INTERVENTION,
        DeviceError::Mismatch { .. } => &table::ROTATION_SETTINGS,
        DeviceError::Gone { .. } | DeviceError::Silent { .. } | DeviceError::Open { .. } => &table::ROTATION_LOST,
        DeviceError::OutOfStep { .. }
        | DeviceError::Late { .. }
        // The next reference finds the axis again.
        | DeviceError::Translation { .. }
        | DeviceError::Suspect { .. }
        | DeviceError::Missed { .. }
        | DeviceError::Unexpected { .. } => &table::ROTATION_SUSPECT,
        _ => &table::ROTATION_FAILED,
    }
}

pub fn of(seq: u64, error: &RunError) -> Fault {
    let code = match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => code_of_device(e),
        RunError::Acquisition(_) => &table::REVOLUTION_FAILED,
        RunError::Overrun(e) if matches!(e.phase, Phase::Load | Phase::Eject | Phase::Wash) => &table::SAMPLER_OVERRUN,
        RunError::Overrun(_) => &table::POSITION_OVERRUN,
        RunError::Second(_) => &table::SECOND_CAMERA_FAILED,
        RunError::Optics { fault, .. } => match fault {
            OpticsFault::Level(_) | OpticsFault::Light(_) => &table::PICTURE_LIGHT,
            OpticsFault::Capillary(_) => &table::CAPILLARY_NOT_SEEN,
            OpticsFault::Scale { .. } | OpticsFault::Bore { .. } | OpticsFault::Zoom { .. } => &table::SCALE_OFF,
            OpticsFault::Frame(_) | OpticsFault::Near(_) | OpticsFault::Plan(_) | OpticsFault::Pipeline(_) => &table::SETUP_UNUSABLE,
        },
        RunError::Store(e) if e.is_full() => &table::DISK_FULL,
        RunError::Store(_) => &table::STORE_FAILED,
        RunError::SpecimenThread => &table::INTERNAL_ERROR,
    };
    let fault = Fault::new(seq, code, error.to_string());
    if device_error(error).is_some_and(needs_a_person) {
        return Fault { scheduler_action: SchedulerAction::EscalateOperator, operator_required: true, ..fault };
    }
    fault
}

impl Fault {
    /// A fault that begins now, as the table has it.
    pub fn new(seq: u64, code: &FaultCode, message: String) -> Self {
        Self {
            seq,
            code: code.code.into(),
            category: code.category.word().into(),
            message,
            recoverable: code.recoverable,
            scheduler_action: code.scheduler_action,
            operator_required: code.operator_required,
            meaning: code.meaning.into(),
            what_to_do: code.what_to_do.into(),
            since: jiff::Timestamp::now().to_string(),
        }
    }

    /// What is wrong, for people: what the code means, else (of a journal that did not keep it) what was found.
    pub fn plainly(&self) -> &str {
        if self.meaning.is_empty() { &self.message } else { &self.meaning }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::StoreError;

    fn full(kind: std::io::ErrorKind) -> RunError {
        RunError::Store(StoreError::Io { what: "write", path: "/data".into(), source: kind.into() })
    }

    #[test]
    fn an_error_has_its_code_and_all_that_the_table_says_of_it() {
        let fault = of(7, &full(std::io::ErrorKind::StorageFull));
        assert_eq!((fault.seq, fault.code.as_str(), fault.category.as_str()), (7, "disk_full", "storage"));
        assert_eq!(fault.what_to_do, table::DISK_FULL.what_to_do);
        assert_eq!(of(8, &full(std::io::ErrorKind::PermissionDenied)).code, "store_failed");
        let unarmed = of(9, &RunError::Device(DeviceError::NotArmed));
        assert_eq!((unarmed.code.as_str(), unarmed.recoverable), ("camera_refused", false));
    }

    #[test]
    fn a_machine_that_may_be_out_of_step_asks_for_a_person() {
        let late = DeviceError::Late { device: "rotation axis", what: "at rest", waited_ms: 5 };
        let fault = of(1, &RunError::Device(late));
        assert_eq!((fault.code.as_str(), fault.operator_required), ("rotation_suspect", true));
        assert_eq!(fault.scheduler_action, SchedulerAction::EscalateOperator);
    }
}
