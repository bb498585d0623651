//! The state of the instrument as one sentence for people.

use super::{Hold, State, Status};
use crate::api::{Phase, WellCounts};

pub fn of(s: &Status) -> String {
    let motors = match s.hardware.rotation.can_stop {
        Some(false) => "no further turn is asked for; the one under way ends by itself. The",
        _ => "the motors are stopped, the",
    };
    let not_yet = s.not_ready_reason.as_deref().map(|why| format!("No run can start yet: {}.", why.trim_end_matches('.')));
    let by_operator = s.run.as_ref().is_some_and(|r| r.held_by_operator);
    let hold = s.run.as_ref().and_then(|r| r.hold.as_ref());
    let well = s.specimen.as_ref().map_or("", |x| x.well.as_str());
    match s.state {
        State::Idle => format!("Idle. {}", not_yet.as_deref().unwrap_or("Ready for a plate.")),
        State::Starting => "Starting the run: the camera is being set up.".into(),
        State::Suspended => format!("Waiting for the loader: {}.", s.plate.needs.as_deref().unwrap_or("a specimen")),
        State::Execute if !s.hardware.camera.connected => "The camera is lost: it is opened again if it answers within ten seconds.".into(),
        State::Execute if s.hardware.rotation.outside && s.specimen.as_ref().is_none_or(|x| x.phase == Phase::Load) => {
            format!(
                "Waiting for the pictures of the next well from {}.",
                s.hardware.rotation.identity.as_deref().unwrap_or("another program")
            )
        }
        State::Execute => match &s.specimen {
            None => "Preparing the first well.".into(),
            Some(x) => match x.phase {
                Phase::Load => format!("Loading well {well}."),
                Phase::Position => format!("Well {well}: finding the reference of the rotation axis."),
                Phase::Detect => format!("Well {well}: looking what is in the capillary."),
                Phase::Revolve if s.hardware.rotation.outside => {
                    format!("Well {well}: reading the pictures of another program, view {} of {}.", x.view, x.views_planned)
                }
                Phase::Revolve if x.view == 0 => format!("Well {well}: turning the capillary to the first of {} views.", x.views_planned),
                Phase::Revolve => format!("Well {well}: turning the capillary, view {} of {}.", x.view, x.views_planned),
                // The computation may be behind the camera.
                Phase::Reconstruct if x.view < x.views_planned => {
                    format!("Well {well}: its views are taken, {} of {} are in the model.", x.view, x.views_planned)
                }
                Phase::Reconstruct => format!("Well {well}: building the surface."),
                Phase::Measure => format!("Well {well}: measuring."),
                Phase::Eject if x.view == 0 => format!("Well {well}: taking the specimen out."),
                Phase::Eject if x.view < x.views_planned => {
                    format!("Well {well}: taking the specimen out after view {} of {}.", x.view, x.views_planned)
                }
                Phase::Eject => format!("Well {well}: done, taking the specimen out."),
                Phase::Wash => format!("Well {well}: washing."),
            },
        },
        State::Completing if s.run.as_ref().is_some_and(|r| r.wells.pending > 0) => {
            "No specimen is left; the last numbers are made from stored frames.".into()
        }
        State::Completing => "All wells are done; closing the record.".into(),
        State::Complete => {
            s.run.as_ref().map_or_else(String::new, |r| format!("Run {} is complete: {}. {}", r.id, counted(&r.wells), of_plate(s)))
        }
        State::Aborting => format!("Aborting: {motors} record is being closed."),
        State::Aborted => {
            if let Some(f) = s.faults.last() {
                format!("Aborted. {}", f.plainly())
            } else {
                let plate = s.plate.needs.as_ref().filter(|_| not_yet.is_none()).map(|needs| format!(" The plate waits for {needs}."));
                let next = not_yet.as_deref().unwrap_or("A new run may be started.");
                format!("Aborted. The motors stand. {next}{}", plate.unwrap_or_default())
            }
        }
        State::Stopping => match &s.specimen {
            Some(_) if !s.is_ending() => format!("Stopping after the specimen of well {well}."),
            _ => format!("Shutting down: {motors} record is being closed."),
        },
        State::Stopped => match &s.run {
            Some(run) if run.outcome.is_some() => format!("Run {} was stopped. {}", run.id, of_plate(s)),
            _ => "Stopped.".into(),
        },
        State::Clearing | State::Resetting => "Resetting for a new run.".into(),
        State::Holding => match s.faults.last() {
            Some(f) => format!("Holding the run. {}", f.plainly()),
            None if well.is_empty() => "Holding the run.".into(),
            None => format!("Holding the run after the specimen of well {well}."),
        },
        State::Held => match s.faults.last() {
            Some(f) if by_operator => format!("Held by an operator and by a fault. {}", f.plainly()),
            Some(f) => format!("Held by a fault{}. {}", again(hold), f.plainly()),
            None if s.pending.stop || s.pending.abort => "Held for a moment: the run ends, as it was asked to.".into(),
            None if by_operator => "Held by an operator, until somebody lets it go on.".into(),
            None if s.run.as_ref().is_some_and(|r| r.goes_on_by_itself) => "Held for a moment: the run continues by itself.".into(),
            None => match hold {
                Some(hold) => {
                    let next = hold.next_action.as_deref().unwrap_or("Let the run go on.");
                    format!("Held by a cause that is over{}: {} {next}", again(Some(hold)), hold.cause)
                }
                None => "Held.".into(),
            },
        },
        State::Unholding => "The run continues: the camera is being set up.".into(),
        State::Suspending | State::Unsuspending => "Handing over with the loader.".into(),
    }
}

/// Whether the plate can be taken after a run.
fn of_plate(s: &Status) -> String {
    match (&s.plate.needs, &s.plate.barcode) {
        (Some(needs), _) => format!("Waiting for {needs}."),
        (None, None) => "No plate is inside.".into(),
        (None, Some(barcode)) if s.plate.removable => format!("Plate {barcode} can be taken."),
        (None, Some(barcode)) => format!("Plate {barcode} cannot be taken yet."),
    }
}

/// How often the cause has held the run. Empty if only once.
fn again(hold: Option<&Hold>) -> String {
    hold.filter(|hold| hold.times > 1).map_or_else(String::new, |hold| format!(", {} times since a well was finished", hold.times))
}

/// `5 measured (1 of them flagged), 2 skipped`. Counts of 0 are left out.
fn counted(c: &WellCounts) -> String {
    let measured = c.succeeded + c.flagged;
    let flagged = if c.flagged == 0 { String::new() } else { format!(" ({} of them flagged)", c.flagged) };
    let parts =
        [(measured, "measured", &*flagged), (c.skipped, "skipped", ""), (c.failed, "failed", ""), (c.interrupted, "not finished", "")];
    let there = parts.iter().filter(|(count, ..)| *count > 0).map(|(count, what, more)| format!("{count} {what}{more}"));
    let said: Vec<String> = there.collect();
    if said.is_empty() { "no wells".into() } else { said.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api;
    use crate::session::state::tests::ALL;
    use crate::session::{Driver, SpecimenStatus};
    use carved_records::{Fault, Mode, RunUnderFault};

    #[test]
    fn a_flagged_well_counts_as_measured_and_what_there_is_none_of_is_not_said() {
        let counts = WellCounts { succeeded: 4, flagged: 1, skipped: 2, total: 7, ..WellCounts::default() };
        assert_eq!(counted(&counts), "5 measured (1 of them flagged), 2 skipped");
        let counts = WellCounts { failed: 1, interrupted: 3, total: 4, ..WellCounts::default() };
        assert_eq!(counted(&counts), "1 failed, 3 not finished");
    }

    #[test]
    fn a_plate_is_offered_only_while_it_is_inside_and_removable() {
        let mut s = Driver::first_status(Mode::Simulated, "b".into());
        let plate = |barcode: Option<&str>, removable| api::Plate { barcode: barcode.map(Into::into), removable, ..api::Plate::default() };
        for (plate, says) in [
            (plate(Some("P-1"), true), "Plate P-1 can be taken."),
            (plate(Some("P-1"), false), "Plate P-1 cannot be taken yet."),
            (plate(None, false), "No plate is inside."),
            (api::Plate { needs: Some("a hand".into()), ..plate(Some("P-1"), false) }, "Waiting for a hand."),
        ] {
            s.plate = plate;
            assert_eq!(of_plate(&s), says);
        }
    }

    /// A fast axis leaves views in the queue. No surface is built before all views are carved.
    #[test]
    fn a_surface_is_built_once_every_view_is_in_the_model() {
        let mut s = Driver::first_status(Mode::Simulated, "b".into());
        s.state = State::Execute;
        s.hardware.camera.connected = true;
        s.specimen = Some(SpecimenStatus { view: 13, ..SpecimenStatus::new("A01", Phase::Reconstruct, 21) });
        assert_eq!(of(&s), "Well A01: its views are taken, 13 of 21 are in the model.");
        s.specimen = s.specimen.map(|x| SpecimenStatus { view: 21, ..x });
        assert_eq!(of(&s), "Well A01: building the surface.");
    }

    /// The axis may be lost in a turn, and a skipped well has no turn.
    #[test]
    fn a_specimen_that_is_taken_out_is_done_only_after_a_full_turn() {
        let mut s = Driver::first_status(Mode::Simulated, "b".into());
        s.state = State::Execute;
        s.hardware.camera.connected = true;
        for (view, says) in [
            (0, "Well A01: taking the specimen out."),
            (8, "Well A01: taking the specimen out after view 8 of 21."),
            (21, "Well A01: done, taking the specimen out."),
        ] {
            s.specimen = Some(SpecimenStatus { view, ..SpecimenStatus::new("A01", Phase::Eject, 21) });
            assert_eq!(of(&s), says);
        }
    }

    /// People read the headline. It says what a fault means. The fault itself contains the details.
    #[test]
    fn a_held_run_says_by_whom_and_a_fault_says_what_it_means() {
        let mut s = Driver::first_status(Mode::Simulated, "b".into());
        s.state = State::Held;
        let fault = Fault::new(1, &carved_records::fault_table::DISK_FULL, "os error 28".into(), String::new());
        s.faults = vec![api::Fault::of(&fault, RunUnderFault::Waits)];
        assert_eq!(of(&s), "Held by a fault. The disk that holds the data is full. Leave the plate in.");
    }

    /// A reader of the sentence alone must not be misled about `ready`.
    #[test]
    fn only_an_instrument_that_is_ready_is_called_so_and_one_that_is_not_says_why() {
        let fault = Fault::new(1, &carved_records::fault_table::DISK_FULL, "no room".into(), String::new());
        let fault = api::Fault::of(&fault, RunUnderFault::None);
        let specimen = SpecimenStatus::new("A01", Phase::Eject, 21);
        let reasons = [
            None,
            Some("starting"),
            Some("fault 1 (disk_full) is not acknowledged: no room."),
            Some("the specimen of well A01 is still in it"),
        ];
        for state in ALL {
            for reason in reasons {
                for (faults, specimen) in [(vec![], None), (vec![fault.clone()], None), (vec![], Some(specimen.clone()))] {
                    let mut s = Driver::first_status(Mode::Simulated, "b".into());
                    s.state = state;
                    s.ready = reason.is_none();
                    s.not_ready_reason = reason.map(str::to_owned);
                    (s.faults, s.specimen) = (faults, specimen);
                    let said = of(&s);
                    let words: Vec<String> = said.split(|c: char| !c.is_alphabetic()).map(str::to_lowercase).collect();
                    let may_start = words.iter().any(|word| word == "ready") || said.contains("may be started");
                    assert!(s.ready || !may_start, "{state:?}: {said}");
                    let says_why = reason.is_none_or(|why| said.contains(why.trim_end_matches('.')));
                    assert!(state != State::Idle || says_why, "{said}");
                }
            }
        }
    }
}
