//! What may be tried again on a specimen that is still in the capillary, and what costs its well only.
//!
//! ```text
//!                              tried again    and if that fails too
//! a frame that did not come         x          the well fails
//! detect, revolve overran           x          the well fails
//! reconstruct, measure overran                 the well fails
//! a lost position, position overran x          the run is held
//! alarm, lost device, disk,
//! load, eject, wash overran                    the run is held
//! ```

use super::{Overrun, RunError};
use crate::acquisition::{AcquisitionError, LedgerError};
use crate::device::DeviceError;
use crate::session::Phase;

/// Whether a reference and another turn may do better: the specimen is there, and no person is needed first.
pub fn may_be_tried_again(error: &RunError) -> bool {
    match error {
        RunError::Overrun(Overrun { phase, .. }) => matches!(phase, Phase::Position | Phase::Detect | Phase::Revolve),
        RunError::Device(e) | RunError::Second(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => {
            matches!(
                e,
                DeviceError::NoFrame { .. }
                    | DeviceError::Translation { .. }
                    | DeviceError::Suspect { .. }
                    | DeviceError::Missed { .. }
                    | DeviceError::Unexpected { .. }
            )
        }
        RunError::Acquisition(AcquisitionError::Ledger(LedgerError::EpochChanged { .. })) => true,
        _ => false,
    }
}

/// Whether an error says nothing against the next well.
pub fn costs_its_well_only(error: &RunError) -> bool {
    match error {
        RunError::Overrun(Overrun { phase, .. }) => {
            matches!(phase, Phase::Detect | Phase::Revolve | Phase::Reconstruct | Phase::Measure)
        }
        RunError::Second(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => matches!(e, DeviceError::NoFrame { .. }),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn no_frame() -> DeviceError {
        DeviceError::NoFrame { waited_ms: 3000, attempts: 3, last: "nothing".into() }
    }

    fn overrun(phase: Phase) -> RunError {
        Overrun { phase, took_s: 2.0, allowed_s: 1.0 }.into()
    }

    #[test]
    fn a_lost_frame_is_tried_again_and_costs_a_well_and_an_alarm_or_a_lost_device_is_neither() {
        let in_view = |source| RunError::from(AcquisitionError::Device { view: 3, source });
        assert!(may_be_tried_again(&in_view(no_frame())) && costs_its_well_only(&in_view(no_frame())));
        // Before the first view it is the camera's, which the next well needs as well.
        assert!(may_be_tried_again(&no_frame().into()) && !costs_its_well_only(&no_frame().into()));
        let suspect = || DeviceError::Suspect { why: "it was restarted".into() };
        assert!(may_be_tried_again(&in_view(suspect())) && !costs_its_well_only(&in_view(suspect())));
        for error in [
            in_view(DeviceError::ControlLost),
            DeviceError::Alarm { device: "grbl", what: "ALARM:1".into() }.into(),
            DeviceError::Gone { device: "grbl", why: "pulled".into() }.into(),
        ] {
            assert!(!may_be_tried_again(&error) && !costs_its_well_only(&error), "{error}");
        }
        assert!(may_be_tried_again(&overrun(Phase::Position)) && !costs_its_well_only(&overrun(Phase::Position)));
        assert!(!may_be_tried_again(&overrun(Phase::Measure)) && costs_its_well_only(&overrun(Phase::Measure)));
        assert!(!may_be_tried_again(&overrun(Phase::Eject)) && !costs_its_well_only(&overrun(Phase::Eject)));
    }
}
