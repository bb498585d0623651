//! Maps the error that ended a run to the fault that people and schedulers read. Defines which error has which code of the fault table.

use super::worker::{OpticsFault, RunError};
use carved_devices::DeviceError;
use carved_devices::acquisition::AcquisitionError;
use carved_devices::views::ViewsError;
use carved_records::{Device, Fault, FaultCode, Phase, SchedulerAction, fault_table};

fn device_error(error: &RunError) -> Option<&DeviceError> {
    match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => Some(e),
        _ => None,
    }
}

/// The device that this error shows as lost. `None` if the error does not show a loss.
pub fn lost_device(error: &RunError) -> Option<Device> {
    match device_error(error)? {
        error if error.is_loss_of_camera() => Some(Device::Camera),
        DeviceError::Gone { .. } | DeviceError::Silent { .. } => Some(Device::Rotation),
        DeviceError::Views(ViewsError::FolderLost { .. }) => Some(Device::Pictures),
        _ => None,
    }
}

/// Whether only a person can remove the cause, whatever the fault table says about the code.
fn needs_a_person(error: &DeviceError) -> bool {
    matches!(error, DeviceError::OutOfStep { .. } | DeviceError::Late { .. })
}

fn code_of_device(error: &DeviceError) -> &'static FaultCode {
    match error {
        DeviceError::NotController { .. } => &fault_table::CAMERA_TAKEN,
        error if error.is_loss_of_camera() => &fault_table::CAMERA_LOST,
        DeviceError::StreamRestarted { .. } | DeviceError::CameraClock { .. } => &fault_table::CAMERA_CLOCK,
        DeviceError::CameraChanged { .. } => &fault_table::CAMERA_CHANGED,
        DeviceError::NoFrame { .. } | DeviceError::StreamSilent { .. } => &fault_table::CAMERA_NO_FRAME,
        DeviceError::Camera { .. } | DeviceError::NotArmed => &fault_table::CAMERA_REFUSED,
        DeviceError::Sampler { .. } | DeviceError::Unasked => &fault_table::SAMPLER_FAILED,
        DeviceError::Views(e) => match e {
            ViewsError::FolderLost { .. } => &fault_table::PICTURES_LOST,
            ViewsError::Earlier { .. } => &fault_table::PICTURES_EARLIER,
            ViewsError::Unfit { .. } => &fault_table::PICTURES_UNFIT,
            // The other errors end only their well and raise no fault.
            ViewsError::Late { .. }
            | ViewsError::Missing { .. }
            | ViewsError::Replaced { .. }
            | ViewsError::Unusable { .. }
            | ViewsError::NoWell => &fault_table::PICTURES_LATE,
        },
        // The commands or settings of the controller do not match its machine. A person must check it.
        DeviceError::Alarm { .. } | DeviceError::Skew { .. } | DeviceError::Stalled { .. } => &fault_table::ROTATION_ALARM,
        DeviceError::Intervention { .. } => &fault_table::ROTATION_INTERVENTION,
        DeviceError::VastList { .. } => &fault_table::VAST_LIST,
        DeviceError::VastProgram { .. } => &fault_table::VAST_PROGRAM,
        DeviceError::Mismatch { .. } => &fault_table::ROTATION_SETTINGS,
        DeviceError::Uneven { .. } => &fault_table::SETUP_UNUSABLE,
        DeviceError::Output { .. } => &fault_table::OUTPUT_FAILED,
        DeviceError::Gone { .. } | DeviceError::Silent { .. } | DeviceError::Open { .. } => &fault_table::ROTATION_LOST,
        DeviceError::OutOfStep { .. }
        | DeviceError::Late { .. }
        // The next reference finds the position again.
        | DeviceError::Translation { .. }
        | DeviceError::Suspect { .. }
        | DeviceError::Missed { .. }
        | DeviceError::Unexpected { .. } => &fault_table::ROTATION_SUSPECT,
        _ => &fault_table::ROTATION_FAILED,
    }
}

pub fn of(seq: u64, error: &RunError) -> Fault {
    let code = match error {
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => code_of_device(e),
        RunError::Acquisition(AcquisitionError::Sweep(e)) if e.is_of_frames() => &fault_table::CAMERA_NO_FRAME,
        RunError::Acquisition(AcquisitionError::Sweep(e)) if !e.may_be_tried_again() => &fault_table::SETUP_UNUSABLE,
        RunError::Acquisition(_) => &fault_table::REVOLUTION_FAILED,
        RunError::Overrun(e) if matches!(e.phase, Phase::Load | Phase::Eject | Phase::Wash) => &fault_table::SAMPLER_OVERRUN,
        RunError::Overrun(_) => &fault_table::POSITION_OVERRUN,
        RunError::Second(_) => &fault_table::SECOND_CAMERA_FAILED,
        RunError::Optics { fault, .. } => match fault {
            OpticsFault::Level(_) | OpticsFault::Light(_) => &fault_table::PICTURE_LIGHT,
            OpticsFault::Capillary(_) => &fault_table::CAPILLARY_NOT_SEEN,
            OpticsFault::Scale { .. } | OpticsFault::Bore { .. } | OpticsFault::Zoom { .. } => &fault_table::SCALE_OFF,
            OpticsFault::Frame(_) | OpticsFault::Near(_) | OpticsFault::Plan(_) | OpticsFault::Pipeline(_) => &fault_table::SETUP_UNUSABLE,
        },
        RunError::NotTurning { .. } => &fault_table::ROTATION_SUSPECT,
        RunError::Store(e) if e.is_full() => &fault_table::DISK_FULL,
        RunError::Store(_) => &fault_table::STORE_FAILED,
        RunError::SpecimenThread | RunError::NoThread(_) => &fault_table::INTERNAL_ERROR,
    };
    let fault = Fault::new(seq, code, error.to_string(), jiff::Timestamp::now().to_string());
    let is_for_a_person = matches!(error, RunError::NotTurning { .. }) || device_error(error).is_some_and(needs_a_person);
    if is_for_a_person {
        return Fault { scheduler_action: SchedulerAction::EscalateOperator, operator_required: true, ..fault };
    }
    fault
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_store::StoreError;

    fn full(kind: std::io::ErrorKind) -> RunError {
        RunError::Store(StoreError::Io { what: "write", path: "/data".into(), source: kind.into() })
    }

    #[test]
    fn an_error_has_its_code_and_all_that_the_table_says_of_it() {
        let fault = of(7, &full(std::io::ErrorKind::StorageFull));
        assert_eq!((fault.seq, fault.code.as_str(), fault.category.as_str()), (7, "disk_full", "storage"));
        assert_eq!(fault.what_to_do, fault_table::DISK_FULL.what_to_do());
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
