//! What open faults prevent, and how they are acknowledged. The faults are in [`OpenFaults`](carved_records::OpenFaults). The driver raises
//! them.

use super::super::Refusal;
use carved_records::{Asked, Device, FaultAcknowledged, HoldCause, OpenFaults, fault_table};

/// Refuses a run while a device is lost or a fault needs an operator.
///
/// # Errors
/// Names the lost device, or else the oldest fault that needs an operator.
pub(super) fn check_faults(faults: &OpenFaults, lost: Option<Device>) -> Result<(), Refusal> {
    if let Some(lost) = lost {
        return Err(Refusal::DeviceLost { why: lost.way_out().to_owned() });
    }
    match faults.open().iter().find(|f| f.operator_required) {
        Some(f) if f.is_of_storage() => of_the_disk(faults).map_or(Ok(()), Err),
        Some(f) => Err(Refusal::FaultStands { seq: f.seq, code: f.code.clone(), message: f.message.clone() }),
        None => Ok(()),
    }
}

/// The refusal of a command that must be written to disk, while the disk's fault is open.
pub(super) fn of_the_disk(faults: &OpenFaults) -> Option<Refusal> {
    let fault = faults.open().iter().find(|f| f.is_of_storage())?;
    Some(Refusal::Store { why: fault.message.clone(), full: fault.code == fault_table::DISK_FULL.code })
}

/// The event of an acknowledgement, and whether it clears the fault. `None` if the fault is cleared already.
///
/// # Errors
/// There was never a fault of this number.
pub(super) fn acknowledge(faults: &OpenFaults, seq: u64, asked: Asked) -> Result<Option<(FaultAcknowledged, bool)>, Refusal> {
    let newest = faults.newest();
    match faults.open().iter().find(|f| f.seq == seq) {
        Some(fault) => {
            let Asked { by, from } = asked;
            Ok(Some((FaultAcknowledged { seq, code: fault.code.clone(), by, from }, !fault.ends_by_itself())))
        }
        None if (1..=newest).contains(&seq) => Ok(None),
        None => Err(Refusal::UnknownFault { seq, newest }),
    }
}

/// Whether a fault of this code is open.
pub(super) fn is_open(faults: &OpenFaults, code: &str) -> bool {
    faults.open().iter().any(|fault| fault.code == code)
}

/// The cause of a hold that begins now: the newest fault, or an operator.
pub(super) fn cause_of_hold(faults: &OpenFaults, by_fault: bool) -> HoldCause {
    match faults.open().iter().rfind(|fault| fault.is_in_the_way()) {
        _ if !by_fault => HoldCause::operator(),
        Some(fault) => HoldCause { code: fault.code.clone(), words: fault.plainly().to_owned() },
        None => HoldCause::fault(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::{EventBody, EventData, Fault, FaultCode, InstrumentState};

    /// Faults 1, 2, ... of these codes.
    fn open(codes: &[&FaultCode]) -> OpenFaults {
        let mut state = InstrumentState::default();
        for (code, seq) in codes.iter().zip(1..) {
            let data = EventData::FaultRaised(Fault::new(seq, code, format!("found {seq}"), String::new()));
            state.apply(&EventBody { time: String::new(), run: None, well: None, data });
        }
        state.faults
    }

    #[test]
    fn a_lost_device_comes_before_a_fault_and_a_full_disk_is_named_as_the_disk() {
        let stop = open(&[&fault_table::EMERGENCY_STOP]);
        assert!(matches!(check_faults(&stop, Some(Device::Camera)), Err(Refusal::DeviceLost { .. })));
        assert!(matches!(check_faults(&stop, None), Err(Refusal::FaultStands { seq: 1, .. })));
        let full = open(&[&fault_table::DISK_FULL]);
        assert!(matches!(of_the_disk(&full), Some(Refusal::Store { full: true, .. })));
        assert!(matches!(of_the_disk(&open(&[&fault_table::STORE_FAILED])), Some(Refusal::Store { full: false, .. })));
        assert_eq!((of_the_disk(&stop), check_faults(&OpenFaults::default(), None)), (None, Ok(())));
    }

    #[test]
    fn an_acknowledgement_ends_a_fault_unless_it_ends_with_its_cause() {
        let faults = open(&[&fault_table::EMERGENCY_STOP, &fault_table::CAMERA_LOST]);
        let ends = |seq| acknowledge(&faults, seq, Asked::default()).map(|found| found.map(|(_, ends)| ends));
        assert_eq!((ends(1), ends(2)), (Ok(Some(true)), Ok(Some(false))));
        assert_eq!(
            (ends(0), ends(3)),
            (Err(Refusal::UnknownFault { seq: 0, newest: 2 }), Err(Refusal::UnknownFault { seq: 3, newest: 2 }))
        );
        let mut later = OpenFaults::default();
        later.number_from(7);
        assert_eq!(acknowledge(&later, 7, Asked::default()), Ok(None), "it is over already");
    }

    #[test]
    fn the_newest_fault_holds_a_run_unless_an_operator_does() {
        let faults = open(&[&fault_table::CAMERA_LOST, &fault_table::DISK_FULL]);
        assert_eq!(cause_of_hold(&faults, true).code, fault_table::DISK_FULL.code);
        assert_eq!(cause_of_hold(&faults, false), HoldCause::operator());
        assert_eq!(cause_of_hold(&OpenFaults::default(), true), HoldCause::fault(), "nobody asked for it");
    }
}
