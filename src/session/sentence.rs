//! What the instrument is doing, in one sentence for people.

use super::{Phase, State, Status};

pub fn of(s: &Status) -> String {
    let motors = match s.hardware.rotation.can_stop {
        Some(false) => "no further turn is asked for; the one under way ends by itself. The",
        _ => "the motors are stopped, the",
    };
    let not_yet = s.not_ready_reason.as_deref().map(|why| format!("No run can start yet: {}.", why.trim_end_matches('.')));
    let well = s.specimen.as_ref().map_or("", |x| x.well.as_str());
    match s.state {
        State::Idle => format!("Idle. {}", not_yet.as_deref().unwrap_or("Ready for a plate.")),
        State::Starting => "Starting the run: the camera is being armed.".into(),
        State::Suspended => format!("Waiting for the loader: {}.", s.plate.needs.as_deref().unwrap_or("a specimen")),
        State::Execute if !s.hardware.camera.connected => "The camera is lost: it is opened again if it answers within ten seconds.".into(),
        State::Execute => match &s.specimen {
            None => "Preparing the first well.".into(),
            Some(x) => match x.phase {
                Phase::Load => format!("Loading well {well}."),
                Phase::Position => format!("Well {well}: finding the reference of the rotation axis."),
                Phase::Detect => format!("Well {well}: looking what is in the capillary."),
                Phase::Revolve => format!("Well {well}: turning the capillary, view {} of {}.", x.view, x.views_planned),
                Phase::Reconstruct => format!("Well {well}: building the surface."),
                Phase::Measure => format!("Well {well}: measuring."),
                Phase::Eject => format!("Well {well}: done, taking the specimen out."),
                Phase::Wash => format!("Well {well}: washing."),
            },
        },
        State::Completing if s.run.as_ref().is_some_and(|r| r.wells.pending > 0) => {
            "No specimen is left; the last numbers are made from stored frames.".into()
        }
        State::Completing => "All wells are done; closing the record.".into(),
        State::Complete => s.run.as_ref().map_or_else(String::new, |r| {
            let c = r.wells;
            format!(
                "Run {} is complete: {} measured, {} flagged, {} skipped, {} failed. {}",
                r.id,
                c.succeeded,
                c.flagged,
                c.skipped,
                c.failed + c.interrupted,
                s.plate.needs.as_ref().map_or_else(|| "The plate can be taken.".into(), |needs| format!("Waiting for {needs}."))
            )
        }),
        State::Aborting => format!("Aborting: {motors} record is being closed."),
        State::Aborted => match s.faults.last() {
            Some(f) => format!("Stopped by a fault: {}", f.message),
            None => format!("Aborted. The motors stand. {}", not_yet.as_deref().unwrap_or("A new run may be started.")),
        },
        State::Stopping => match &s.specimen {
            Some(_) if s.not_ready_reason.as_deref() != Some("shutting down") => format!("Stopping after the specimen of well {well}."),
            _ => format!("Shutting down: {motors} record is being closed."),
        },
        State::Stopped => match &s.run {
            Some(run) if run.outcome.is_some() => {
                let plate =
                    s.plate.needs.as_ref().map_or_else(|| "The plate can be taken.".into(), |needs| format!("Waiting for {needs}."));
                format!("Run {} was stopped. {plate}", run.id)
            }
            _ => "Stopped.".into(),
        },
        State::Clearing | State::Resetting => "Resetting for a new run.".into(),
        State::Holding => match s.faults.last() {
            Some(f) => format!("Holding the run: {}", f.message),
            None if well.is_empty() => "Holding the run.".into(),
            None => format!("Holding the run after the specimen of well {well}."),
        },
        State::Held => match s.faults.last() {
            Some(f) if s.run.as_ref().is_some_and(|r| r.held_by_operator) => format!("Held by a fault, and on request: {}", f.message),
            Some(f) => format!("Held by a fault: {}", f.message),
            None if s.pending.stop || s.pending.abort => "Held for a moment: the run ends, as it was asked to.".into(),
            None if s.run.as_ref().is_some_and(|r| r.goes_on_by_itself) => "Held for a moment: the run goes on by itself.".into(),
            None => "Held. The run goes on where it is, on request.".into(),
        },
        State::Unholding => "The run goes on: the camera is being armed.".into(),
        State::Suspending | State::Unsuspending => "Handing over with the loader.".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::state::tests::ALL;
    use crate::session::{Driver, Fault, Mode, SpecimenStatus};

    /// Whoever reads the sentence and not `ready` is not misled by it.
    #[test]
    fn only_an_instrument_that_is_ready_is_called_so_and_one_that_is_not_says_why() {
        let fault = Fault::new(1, &crate::session::fault::table::DISK_FULL, "no room".into());
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
