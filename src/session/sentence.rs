//! What the instrument is doing, in one sentence for people.

use super::{Phase, State, Status};

pub fn of(s: &Status) -> String {
    let motors = match s.hardware.rotation.can_stop {
        Some(false) => "no further turn is asked for; the one under way ends by itself. The",
        _ => "the motors are stopped, the",
    };
    let well = s.specimen.as_ref().map_or("", |x| x.well.as_str());
    match s.state {
        State::Idle => "Idle. Ready for a plate.".into(),
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
            None => "Aborted. The motors stand; a new run may be started.".into(),
        },
        State::Stopping => match &s.specimen {
            Some(_) if s.not_ready_reason.as_deref() != Some("shutting down") => format!("Stopping after the specimen of well {well}."),
            _ => format!("Shutting down: {motors} record is being closed."),
        },
        State::Stopped => match &s.run {
            Some(run) if run.outcome.is_some() => {
                format!("Run {} was stopped. The plate can be taken once its capillary is empty.", run.id)
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
            Some(f) => format!("Held by a fault: {}", f.message),
            None => "Held. The run goes on where it is, on request.".into(),
        },
        State::Unholding => "The run goes on: the camera is being armed.".into(),
        State::Suspending | State::Unsuspending => "Handing over with the loader.".into(),
    }
}
