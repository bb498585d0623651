//! Which errors allow another attempt at a specimen in the capillary, which end only its well, and whether the specimen stays inside.
//!
//! ```text
//!                                       retried   if the retry fails too   the specimen
//! a feature of the camera that changed     x       the run is held          stays: the run continues with it
//! a sweep that was held or began late      x       the run is held          is ejected
//! frames that did not come                 x       the run is held          stays: the run continues with it
//! any error of the second camera           frame   the run is held          stays: the run continues with it
//! detect, revolve overran                  x       the well fails           is ejected
//! reconstruct, measure overran                     the well fails           is ejected
//! a lost position, position overran        x       the run is held          is ejected
//! light, position of capillary, scale      x       the run is held          stays: the run continues with it
//! a stored picture that was replaced       x       the well fails           -
//! a stored picture that is missing or
//! cannot be used                                   the well fails           -
//! pictures late, unfit, or folder lost             the run is held          its pictures are read again
//! an output that is not switched on                the run is held          stays: the run continues with it
//! setup that measures no specimen                  the run is held          stays: the run continues with it
//! the specimen does not turn with the axis         the run is held          stays: the run continues with it
//! a person or a safety circuit has the axis        the run is held          stays: the run continues with it
//! alarm, lost device, disk,
//! load, eject, wash overran                        the run is held          is ejected
//! ```
//! A driven sampler ejects the specimen. Otherwise the loader is asked to take it out. `optics.rs` defines light, position, scale and
//! setup.

use super::{Overrun, RunError};
use carved_devices::DeviceError;
use carved_devices::acquisition::AcquisitionError;
use carved_records::LedgerError;
use carved_records::Phase;

/// A tenth of the views may be retaken. If more do not fit, the cause is not the single views.
const RETAKEN_SHARE: u32 = 10;

/// Maximum number of views of a turn that are retaken.
pub fn retaken_most(asd: u32) -> usize {
    asd.div_ceil(RETAKEN_SHARE) as usize
}

/// Whether a new reference and another turn may succeed. The specimen is there, and no person is needed first.
pub fn may_be_tried_again(error: &RunError) -> bool {
    match error {
        RunError::Overrun(Overrun { phase, .. }) => matches!(phase, Phase::Position | Phase::Detect | Phase::Revolve),
        RunError::Device(e) | RunError::Second(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => {
            matches!(e, DeviceError::Views(e) if e.may_be_tried_again())
                || e.is_of_frames()
                || matches!(
                    e,
                    DeviceError::Translation { .. }
                        | DeviceError::Suspect { .. }
                        | DeviceError::Missed { .. }
                        | DeviceError::Unexpected { .. }
                )
        }
        RunError::Acquisition(AcquisitionError::Ledger(LedgerError::EpochChanged { .. })) => true,
        RunError::Acquisition(AcquisitionError::Sweep(e)) => e.may_be_tried_again(),
        RunError::Optics { fault, .. } => fault.may_pass(),
        _ => false,
    }
}

/// Whether an error ends only its well and does not affect the next one.
pub fn costs_its_well_only(error: &RunError) -> bool {
    match error {
        RunError::Overrun(Overrun { phase, .. }) => {
            matches!(phase, Phase::Detect | Phase::Revolve | Phase::Reconstruct | Phase::Measure)
        }
        RunError::Device(DeviceError::Views(e)) | RunError::Acquisition(AcquisitionError::Device { source: DeviceError::Views(e), .. }) => {
            e.is_of_one_well()
        }
        _ => false,
    }
}

/// Whether a camera delivered no frame. The specimen is not the cause.
fn is_camera(error: &RunError) -> bool {
    match error {
        RunError::Second(_) => true,
        RunError::Device(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => {
            e.is_of_frames() || matches!(e, DeviceError::Views(_))
        }
        RunError::Acquisition(AcquisitionError::Sweep(e)) => e.is_of_frames(),
        _ => false,
    }
}

/// Whether a person or a safety circuit has taken over the axis. Then no command is sent to it.
pub fn is_intervention(error: &RunError) -> bool {
    match error {
        RunError::Device(e) | RunError::Second(e) | RunError::Acquisition(AcquisitionError::Device { source: e, .. }) => {
            e.is_in_a_persons_hands()
        }
        _ => false,
    }
}

/// Whether the rig cannot do the sweep of its method. Nothing has turned.
fn is_unfit_for_sweep(error: &RunError) -> bool {
    match error {
        RunError::Acquisition(AcquisitionError::Sweep(e)) => !e.may_be_tried_again(),
        RunError::Acquisition(AcquisitionError::Device { source, .. }) => matches!(source, DeviceError::Uneven { .. }),
        _ => false,
    }
}

/// Whether an output that the pictures need was not switched on. The specimen is not the cause.
fn is_output(error: &RunError) -> bool {
    matches!(error, RunError::Device(DeviceError::Output { .. }))
}

/// Whether the specimen stays in the capillary, and the run continues with it once a person has removed the cause.
pub fn keeps_specimen(error: &RunError) -> bool {
    matches!(error, RunError::Optics { .. } | RunError::NotTurning { .. })
        || is_camera(error)
        || is_output(error)
        || is_unfit_for_sweep(error)
        || is_intervention(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::worker::OpticsFault;
    use carved_core::profile::ProfileError;
    use carved_devices::acquisition::SweepError;

    fn no_frame() -> DeviceError {
        DeviceError::NoFrame { waited_ms: 3000, attempts: 3, last: "nothing".into() }
    }

    fn overrun(phase: Phase) -> RunError {
        Overrun { phase, took_s: 2.0, allowed_s: 1.0 }.into()
    }

    #[test]
    fn a_lost_frame_is_tried_again_and_then_holds_the_run_and_an_alarm_or_a_lost_device_is_not_tried_again() {
        let in_view = |source| RunError::from(AcquisitionError::Device { view: 3, source });
        // The next well needs the camera too.
        for lost in [in_view(no_frame()), no_frame().into(), RunError::Second(no_frame())] {
            assert!(may_be_tried_again(&lost) && !costs_its_well_only(&lost) && keeps_specimen(&lost), "{lost}");
        }
        assert!(keeps_specimen(&RunError::Second(DeviceError::ControlLost)));
        let swept = |e: SweepError| RunError::from(AcquisitionError::from(e));
        let missing = swept(SweepError::Missing { missing: 20, planned: 84, longest: 9, allowed: 8, allowed_in_a_row: 4 });
        assert!(may_be_tried_again(&missing) && keeps_specimen(&missing));
        let held = swept(SweepError::Pace { late_ms: 900.0 });
        assert!(may_be_tried_again(&held) && !keeps_specimen(&held), "its position is lost");
        for unfit in [swept(SweepError::NoFreeRun), in_view(DeviceError::Uneven { steps_per_s: 179.0, fastest: None })] {
            assert!(!may_be_tried_again(&unfit) && keeps_specimen(&unfit), "{unfit}");
        }
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

    #[test]
    fn a_specimen_stays_where_the_instrument_could_not_see_it_or_a_person_has_the_axis() {
        let optics = |fault| RunError::Optics { well: "A01".into(), fault };
        let dark = optics(OpticsFault::Light(ProfileError::Black { brightest: 9, needed: 30 }));
        let setup = optics(OpticsFault::Frame(ProfileError::TooSmall { width: 9, height: 9, least: 48 }));
        assert!(may_be_tried_again(&dark) && !may_be_tried_again(&setup));
        let hand = || DeviceError::Intervention { device: "rotation axis", what: "feed hold".into(), way_out: "Release it." };
        let hands = [RunError::from(hand()), RunError::from(AcquisitionError::Device { view: 3, source: hand() })];
        let refused = DeviceError::Output { device: "axis", name: "light".into(), on: true, why: "error:20".into() };
        let refused = RunError::from(refused);
        for error in hands.iter().chain([&dark, &setup, &refused]) {
            assert!(keeps_specimen(error) && !costs_its_well_only(error), "{error}");
        }
        assert!(hands.iter().all(|e| is_intervention(e) && !may_be_tried_again(e)) && !is_intervention(&dark));
        for error in [overrun(Phase::Position), DeviceError::Alarm { device: "grbl", what: "ALARM:1".into() }.into()] {
            assert!(!keeps_specimen(&error), "{error}");
        }
    }
}
