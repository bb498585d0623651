//! What the worker reports during a run: written, and shown. No report changes the course of the run.

use super::super::state::Trigger;
use super::super::worker::Progress;
use super::super::{Live, Shown, SpecimenStatus, State};
use super::driver_state::DriverState;
use super::progress::{Hardware, View, show_done, show_estimate, show_hardware, show_phase, show_view};
use super::run::Request;
use super::snapshot::run_status;
use carved_core::units::Steps;
use carved_records::{AttemptFailed, EventData, Phase, PhaseEntered, SpecimenDone, ViewTaken, WellStatus, WellTimes};

pub(super) fn progress(d: &mut DriverState, progress: Progress) {
    match progress {
        Progress::Ready => ready(d),
        Progress::WaitingForLoader { well } => waits_for_loader(d, &well),
        Progress::Phase { well, phase, in_capillary } => {
            let Some(views_planned) = d.run.as_ref().map(|run| run.record().method.asd) else { return };
            if phase == Phase::Load {
                forget_pictures(d, &well);
            }
            d.event_shown(Some(&well), EventData::SpecimenPhase(PhaseEntered { phase, in_capillary }), |d| {
                d.publish(|s| show_phase(s, &well, phase, views_planned));
            });
        }
        Progress::Detected { well, found, live } => {
            show(d, &well, 0, live);
            d.publish(|_| ());
            d.event(Some(&well), EventData::SpecimenDetected(found));
        }
        Progress::TriedAgain { well, attempt, why } => {
            let views_planned = d.run.as_ref().map_or(0, |run| run.record().method.asd);
            forget_pictures(d, &well);
            d.publish(|s| s.specimen = Some(SpecimenStatus::new(&well, Phase::Position, views_planned)));
            d.event(Some(&well), EventData::SpecimenTriedAgain(AttemptFailed { attempt, why }));
        }
        Progress::View { well, index, closure, achieved_steps, hull_volume_um3, estimate, wait, light, live } => {
            let position_deg = d.config.steps_per_revolution.angle(Steps(achieved_steps)).to_degrees();
            let view = View { achieved_steps, position_deg, hull_volume_um3, estimate, wait, light };
            d.publish(|s| {
                // A late view of an earlier specimen is written to the journal and not shown.
                if let (Some(shown), Some(live)) = (s.specimen.as_ref().filter(|shown| shown.well == well), live) {
                    show(d, &well, shown.view + u32::from(hull_volume_um3.is_some()), live);
                }
                show_view(s, &well, &view);
            });
            let view = ViewTaken { index, closure, achieved_steps, hull_volume_um3, estimate };
            d.event(Some(&well), EventData::ViewTaken(view));
        }
        Progress::Measured { well, glb, end, blur_px } => {
            if let Some(px) = blur_px {
                d.blurs.add(px);
            }
            // Unless the pictures show the next specimen by now.
            d.publisher.set_live(|l| {
                if l.shown.as_ref().is_some_and(|shown| shown.well == well) {
                    l.mesh_glb = glb.or(l.mesh_glb.take());
                }
            });
            d.publish(|s| show_estimate(s, &well, end));
        }
        Progress::Hardware { rotation, translation, outputs, counters, second } => {
            let disk_free_bytes = d.outbox.store().free_bytes();
            d.publish(|s| show_hardware(s, Hardware { rotation, translation, outputs, counters, second, disk_free_bytes }));
        }
        Progress::WellDone { result, seconds, times } => well_done(d, result, seconds, times),
    }
}

/// Publishes the newest pictures, with their run and well.
fn show(d: &DriverState, well: &str, views: u32, live: Live) {
    let shown = d.run.as_ref().map(|run| Shown { run: run.record().id.clone(), well: well.to_owned(), views });
    d.publisher.set_live(|l| *l = Live { shown, ..live });
}

/// Takes the pictures of an earlier attempt away when the well begins again. Those of another well stay until the next detection.
fn forget_pictures(d: &DriverState, well: &str) {
    d.publisher.set_live(|l| {
        if l.shown.as_ref().is_some_and(|shown| shown.well == well) {
            *l = Live::default();
        }
    });
}

fn ready(d: &mut DriverState) {
    if matches!(d.machine(), State::Starting | State::Unholding) {
        d.transition_with(Trigger::Ready, |s| {
            s.hardware.camera.connected = true;
            s.hardware.rotation.connected = true;
        });
    }
    d.event(None, EventData::RunStarted);
}

fn waits_for_loader(d: &mut DriverState, well: &str) {
    if d.specimens().continued_with() == Some(well) {
        // It was brought before the run continued. If a hold has interrupted the wait, the message is withheld: the specimen stays
        // until the run continues again.
        if d.run.as_ref().is_some_and(|run| run.request() == Request::Nothing) {
            d.loader.say_loaded(well);
        }
        return;
    }
    d.event_shown(Some(well), EventData::WellAwaited, |d| {
        if d.machine() == State::Execute {
            d.transition(Trigger::WaitForLoader);
        } else {
            d.publish(|_| ());
        }
    });
}

/// All files of a well are on disk. The next well may be in progress already.
fn well_done(d: &mut DriverState, result: WellStatus, seconds: f64, times: WellTimes) {
    let Some(run) = &mut d.run else { return };
    let result = run.enter(result);
    let record = run.record().clone();
    let (status, views_planned) = (run_status(&record), record.method.asd);
    let next = run.next_well().map(|next| SpecimenStatus::new(next, Phase::Load, views_planned));
    // A plate-loader takes it out before it brings the next one. With a driven sampler, a specimen that is still inside could not be
    // ejected.
    let stuck = d.specimens().inside() == Some(&result.well) && !d.loader.fills_capillary();
    d.save(record);
    let well = result.well.clone();
    let done = SpecimenDone { result, times: Some(times), seconds: Some(seconds) };
    // One revision: counters and phase change together, so that no reader sees a gap between two wells.
    d.event_shown(Some(&well), EventData::SpecimenDone(Box::new(done)), |d| {
        d.publish(|s| show_done(s, status, &well, next.filter(|_| !stuck)));
    });
}
