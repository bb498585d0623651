//! The course of a run, from its acceptance to its outcome.
//!
//! ```text
//! start ──► launch ──► worker ──► worker_ended ─┬─ all wells ──► finish ──► close ───────► Complete
//!             ▲                                 ├─ paused, failed ──► rest ──► Held ──┐
//!             │                                 └─ stop, abort, shut-down ──► end_run ──► end_now ──► Stopped, Aborted
//!             └──────────── unhold (operator, or by itself) ◄─────────────────────────┘
//! ```
//! `finish` and `end_run` wait for the numbers of specimens that were released.

use super::super::Instrument;
use super::super::handle::{Refusal, Towards};
use super::super::state::Trigger;
use super::super::worker::{self, RunContext, RunEnd, RunError};
use super::super::{State, gate};
use super::driver_state::DriverState;
use super::interrupt::{Course, Fate, interruptions};
use super::recovery::{Continuation, Made};
use super::run::{AfterWork, Request, RunInProgress, Work};
use super::sealing::{seal_well, views_stored};
use super::snapshot::run_status;
use super::start::kernel_boot_id;
use super::{Departure, Life, commands, faults, missing, resume};
use carved_records::{
    Asked, DaemonStopping, EventData, Fault, HeldBy, Method, ResumedBy, RunAccepted, RunEnded, RunHeld, RunPlan, RunResumed,
    SpecimenInterrupted, SpecimenOutcome, SpecimenState, WellCounts,
};
use carved_store::{RunRecord, StoreError};
use jiff::Timestamp;

pub(super) fn shut_down(d: &mut DriverState, departure: Departure) {
    d.life = Life::Stopping(departure);
    d.ask(Request::ShutDown);
    if d.run.is_some() {
        d.event(None, EventData::DaemonStopping(DaemonStopping { ends_run: departure == Departure::EndsRun }));
    }
    d.transition(Trigger::ShutDown);
    if d.has_idle_run() {
        end_run(d);
    }
}

/// Writes the acceptance of the run to the journal, then starts the worker.
pub(super) fn start(d: &mut DriverState, id: &str, plan: RunPlan, method: Method) -> Result<(), StoreError> {
    let calibration = gate::calibration(&d.config, d.mode);
    let record = RunRecord {
        instrument: Some(d.identity.clone()),
        calibration: calibration.clone(),
        ..RunRecord::new(id, plan, method, d.mode, d.config.empty_capillary.as_deref())
    };
    // A driven sampler ejects this specimen before the first well.
    let left = d.specimens().inside().map(str::to_owned);
    let accepted = EventData::RunAccepted(RunAccepted {
        plate_barcode: record.plan.plate_barcode.clone(),
        method: record.plan.method.clone(),
        left_in_capillary: left,
        kernel_boot_id: kernel_boot_id(),
    });
    // Write what waits for the disk first.
    d.outbox.flush()?;
    if let Err(refused) = d.outbox.commit_with(&record, accepted) {
        // The run is not accepted. If the same request comes again, it must not be answered as known.
        if let Err(error) = d.outbox.store().forget_run(id) {
            tracing::error!(%error, "a run that was refused is still on disk");
        }
        return Err(refused);
    }
    let status = run_status(&record);
    d.devices.begin_run();
    d.run = Some(RunInProgress::new(record));
    launch(d);
    d.calibration = calibration;
    d.transition_with(Trigger::Start, |s| {
        s.run = Some(status);
        s.specimen = None;
    });
    Ok(())
}

/// Starts a worker with the instrument for the wells that are left.
fn launch(d: &mut DriverState) {
    let lacks_gate = d.lacks_gate();
    let accepted = d.accepted();
    // A specimen that a plate-loader brought is reported through the interlock.
    let inside = d.specimens().continued_with().filter(|_| !d.loader.fills_capillary()).map(str::to_owned);
    let asked_before = d.specimens().asked_before().map(str::to_owned);
    let eject_first = d.must_leave_first().filter(|_| !d.loader.fills_capillary()).map(str::to_owned);
    let (Some(run), Some(instrument)) = (&mut d.run, d.devices.take()) else {
        tracing::error!("there is no run, or no instrument for it");
        return;
    };
    let wells = run.wells_left(&accepted);
    let record = run.record();
    let work =
        Work::begin(instrument, d.loader.cleared_interlock(), d.publisher.halt(), |[cancel, pause, specimen_out], progress| RunContext {
            config: d.config.clone(),
            identity: d.identity.clone(),
            mode: d.mode,
            run: record.id.clone(),
            plate: record.plan.plate_barcode.clone(),
            wells,
            eject_first,
            inside,
            asked_before,
            method_name: record.plan.method.clone(),
            method: record.method.clone(),
            folder: d.outbox.store().run_folder(&record.id),
            cancel,
            pause,
            specimen_out,
            progress,
            pictures: std::sync::Arc::default(),
            opacities: d.opacities.clone(),
        });
    run.set_lacks_gate(lacks_gate);
    run.launch(work);
}

/// Holds the run for an operator. This hold stays when other causes of a hold are over.
pub(super) fn hold(d: &mut DriverState, state: State, asked: Asked) -> Result<(), Refusal> {
    if d.is_held_by_operator() {
        return Ok(());
    }
    d.commit(None, EventData::RunHoldRequested(asked))?;
    if matches!(state, State::Holding | State::Held) {
        d.publish(|_| ());
        return Ok(());
    }
    d.ask(Request::Hold);
    d.transition(Trigger::Hold);
    if d.has_idle_run() {
        rest(d, false);
    }
    Ok(())
}

pub(super) fn stop(d: &mut DriverState, asked: Asked) -> Result<(), Refusal> {
    d.commit(None, EventData::RunStopRequested(asked))?;
    d.ask(Request::Stop);
    d.transition(Trigger::Stop);
    if d.has_idle_run() {
        end_run(d);
    }
    Ok(())
}

/// Aborts the run even if the disk fails. The event is written as soon as possible.
pub(super) fn abort(d: &mut DriverState, asked: Asked) {
    d.ask(Request::Abort);
    d.transition(Trigger::Abort);
    d.event(None, EventData::RunAbortRequested(asked));
    if d.has_idle_run() {
        end_run(d);
    }
}

/// Continues a held run, once the causes of the hold are over.
pub(super) fn unhold(d: &mut DriverState, by: ResumedBy, asked: Asked) -> Result<(), Refusal> {
    d.check_faults()?;
    let Some(run) = &mut d.run else { return Ok(()) };
    if d.devices.at_rest().is_none() {
        return Err(Refusal::Busy);
    }
    d.outbox.commit_with(run.record(), EventData::RunResumed(RunResumed { by, name: asked.by, from: asked.from }))?;
    run.set_may_go_on(false);
    let status = run_status(run.record());
    d.transition_with(Trigger::Unhold, |s| s.run = Some(status));
    proceed(d);
    Ok(())
}

/// The step after Unholding: wait for the loader, measure the next well, or end the run.
pub(super) fn proceed(d: &mut DriverState) {
    missing::recover(d);
    let accepted = d.accepted();
    let Some(run) = &d.run else { return };
    let must_leave_first = d.must_leave_first().is_some();
    if must_leave_first && d.loader.fills_capillary() {
        d.transition(Trigger::WaitForLoader);
    } else if d.devices.at_rest().is_none() || d.check_faults().is_err() || d.waits_for_operator() {
        // A device was lost, or a fault was found, while the run waited for the loader. Nothing moves before somebody continues the run,
        // or before the cause is over.
        rest(d, true);
    } else if run.wells_left(&accepted).is_empty() && !must_leave_first {
        finish(d);
    } else {
        launch(d);
    }
}

/// Every cause of the hold is over. The run continues by itself if its method allows it and no operator holds it.
pub(super) fn resume_by_itself(d: &mut DriverState) {
    let_go_on(d);
    go_on_if_it_may(d);
}

/// Continues a run that the camera holds, once its pause is over and nothing else is in the way.
pub(super) fn try_again_if_due(d: &mut DriverState) {
    let is_due = d.run.as_ref().and_then(RunInProgress::tries_again_at).is_some_and(|at| at <= Timestamp::now());
    if is_due
        && d.machine() == State::Held
        && d.state().faults.open().iter().filter(|fault| fault.is_in_the_way()).all(Fault::is_tried_again)
    {
        resume_by_itself(d);
    }
}

/// Allows the run to continue by itself. To be set before the last fault is cleared: no client may read that a run waits for a person if it
/// is about to continue.
pub(super) fn let_go_on(d: &mut DriverState) {
    let known = d.outbox.state().run.as_ref();
    if let Some(run) = &mut d.run {
        run.set_may_go_on(resume::is_automatic(run, known));
    }
}

/// Continues the run now, or when the background task returns the instrument.
pub(super) fn go_on_if_it_may(d: &mut DriverState) {
    // A fault may have been raised since the run was allowed to continue.
    let known = d.state().run.as_ref();
    let may = d.run.as_ref().is_some_and(|run| run.may_go_on() && resume::is_automatic(run, known)) && !d.is_held_by_operator();
    if !may || d.machine() != State::Held {
        return;
    }
    match unhold(d, ResumedBy::Instrument, Asked::default()) {
        // Tried again when the task returns the instrument, or when the disk accepts writes.
        Ok(()) | Err(Refusal::Busy | Refusal::Store { .. }) => {}
        Err(refusal) => {
            tracing::warn!(%refusal, "the run stays held");
            d.run.iter_mut().for_each(|run| run.set_may_go_on(false));
            d.publish(|_| ());
        }
    }
}

pub(super) fn worker_ended(d: &mut DriverState, (instrument, end): (Instrument, RunEnd)) {
    d.devices.give_back(instrument);
    let Some(run) = &mut d.run else { return };
    match run.joined(end) {
        AfterWork::Finish => finish(d),
        AfterWork::End(error) => {
            if let Some(error) = error {
                tracing::error!(%error, "the run failed while it was being ended");
            }
            end_run(d);
        }
        AfterWork::Rest => rest(d, false),
        AfterWork::Fault(error) => {
            let fate = match worker::keeps_specimen(&error) {
                false => Fate::PoseLost,
                // A stock VAST cannot take up a specimen twice.
                true if d.devices.steps_through_a_list() => Fate::BroughtAgain,
                true => Fate::Stays,
            };
            if matches!(error, RunError::Store(_)) {
                d.outbox.set_failing(true);
            }
            d.raise(&error);
            interrupt_specimens(d, &error.to_string(), fate);
            rest(d, true);
        }
        AfterWork::Halted => {
            interrupt_specimens(d, "the run could not be stored", Fate::PoseLost);
            rest(d, true);
        }
        AfterWork::Abort => abort(d, Asked::default()),
    }
}

/// Decides for each specimen in progress: its well ends, it is kept, or it is requested again.
pub(super) fn interrupt_specimens(d: &mut DriverState, reason: &str, fate: Fate) {
    let accepted = d.accepted();
    let Some(run) = &d.run else { return };
    let policy = run.record().method.policy.interrupted;
    let brings_again = d.loader.brings_again();
    let known = d.state().run.as_ref();
    let found = known.map_or_else(Vec::new, |known| interruptions(run, known, &accepted, brings_again, fate));
    for interruption in found {
        let Some(run) = &mut d.run else { return };
        let well = &interruption.well;
        let (ends, reason) = match &interruption.course {
            Course::LacksNumbers => continue,
            Course::Kept | Course::Again => (None, reason),
            Course::GivenUp => (Some(SpecimenOutcome::Interrupted), reason),
            Course::SetAside(why) => (Some(SpecimenOutcome::Failed), why.as_str()),
        };
        if let Some(outcome) = ends {
            let (store, id) = (d.outbox.store(), run.record().id.clone());
            if run.give_up(well, outcome, reason, views_stored(store, &id, well)) {
                let record = run.record().clone();
                seal_well(store, &id, well);
                // Before the event, after which a start no longer looks at this specimen.
                d.outbox.save(record);
            }
        }
        let interrupted = SpecimenInterrupted { reason: reason.to_owned(), policy, kept: interruption.course == Course::Kept };
        d.event(Some(well), EventData::SpecimenInterrupted(interrupted));
    }
}

/// The specimen was taken out of a sampler that cannot bring it again: its well ends, unless only its numbers are missing, or the specimen was
/// that of an earlier run. `run`: the run that the message belongs to.
///
/// # Errors
/// The disk refused the message, which then has no effect.
pub(super) fn taken_for_good(d: &mut DriverState, run: Option<&str>, well: &str) -> Result<(), Refusal> {
    let reason = "the specimen was removed, and this sampler cannot bring it again";
    let lacks_numbers = d.accepted().iter().any(|accepted| accepted.well == well);
    let is_of_earlier_run = d.specimens().of(well).state() == SpecimenState::OfEarlierRun;
    let Some(current) = d.run.as_mut().filter(|_| !lacks_numbers && !is_of_earlier_run) else {
        return Ok(d.outbox.commit(run, Some(well), EventData::WellUnloaded)?);
    };
    let before = current.record().clone();
    let views = views_stored(d.outbox.store(), &before.id, well);
    let is_given_up = current.give_up(well, SpecimenOutcome::Interrupted, reason, views);
    let (record, policy) = (current.record().clone(), before.method.policy.interrupted);
    // The record first: a start after a crash between the two must not take the next specimen for this one.
    if let Err(refused) = d.outbox.commit_of_well(&record, well, EventData::WellUnloaded) {
        if let Some(current) = &mut d.run {
            current.restore(before.clone());
        }
        // It may be on the disk already.
        d.save(before);
        return Err(refused.into());
    }
    if is_given_up {
        seal_well(d.outbox.store(), &record.id, well);
        let status = run_status(&record);
        let interrupted = SpecimenInterrupted { reason: reason.to_owned(), policy, kept: false };
        d.event_shown(Some(well), EventData::SpecimenInterrupted(interrupted), |d| d.publish(|s| s.run = Some(status)));
    }
    Ok(())
}

/// Somebody took a specimen out while the driven sampler was at work. The run is held, because a person is at the instrument. A load
/// ends at once, so that the next specimen that comes is not measured as this one, and a turn ends without numbers. Then the report takes effect.
///
/// # Errors
/// The disk refused the message, which then has no effect.
pub(super) fn taken_out_at_work(d: &mut DriverState, well: &str) -> Result<(), Refusal> {
    if !d.state().run.as_ref().is_some_and(|run| run.taken_out().contains(well)) {
        let Some(run) = &d.run else { return Ok(()) };
        d.outbox.commit(Some(&run.record().id), Some(well), EventData::WellTakenOut)?;
    }
    let state = d.machine();
    if let Ok(true) = commands::steer(Towards::Hold, state) {
        hold(d, state, Asked::default())?;
    }
    // Otherwise it is being held or ended already.
    // Between two specimens the next load is that of this well, or is repeated when the run goes on.
    if d.specimens().inside_or_loading().is_none_or(|at_work| at_work == well) {
        d.run.iter().for_each(RunInProgress::specimen_out);
    }
    Ok(())
}

/// Carries out the reports that came while a worker was at work. One that the disk refuses is carried out at the next rest or start.
pub(super) fn carry_out_reports(d: &mut DriverState) {
    let Some(known) = &d.state().run else { return };
    let (id, wells) = (known.id().to_owned(), known.taken_out().clone());
    if wells.is_empty() {
        return;
    }
    for well in wells {
        let reported = if d.loader.brings_again() {
            d.outbox.commit(Some(&id), Some(&well), EventData::WellUnloaded).map_err(Refusal::from)
        } else {
            taken_for_good(d, Some(&id), &well)
        };
        if let Err(refusal) = reported {
            tracing::warn!(%refusal, well, "that its specimen is out is not stored yet");
        }
    }
    d.publish(|_| ());
}

/// Holds a run that waits for the loader without a worker, under a fault that was just raised.
pub(super) fn hold_under_fault(d: &mut DriverState) {
    if d.has_idle_run() && d.machine() == State::Suspended {
        rest(d, true);
    }
}

/// Goes to Held from any state of a run. The worker has returned the instrument.
fn rest(d: &mut DriverState, by_fault: bool) {
    let state = d.machine();
    if state == State::Stopping {
        // A requested end comes first.
        return end_run(d);
    }
    if state != State::Holding {
        d.transition(Trigger::Hold);
    }
    let Some(run) = &mut d.run else { return };
    run.rests();
    let record = run.record().clone();
    let status = run_status(&record);
    let cause = faults::cause_of_hold(&d.state().faults, by_fault);
    let by = if by_fault { HeldBy::Fault } else { HeldBy::Operator };
    d.save(record);
    let held = RunHeld { by, code: Some(cause.code), cause: Some(cause.words) };
    d.event_shown(None, EventData::RunHeld(held), |d| {
        let state = d.outbox.state();
        if let (Some(run), Some(known)) = (&mut d.run, &state.run) {
            // A pause too long for a clock is none.
            let at = resume::pause(run, known, &state.faults).and_then(|pause| Timestamp::now().checked_add(pause).ok());
            run.set_tries_again_at(at);
        }
        d.transition_with(Trigger::Rested, |s| s.run = Some(status));
    });
    carry_out_reports(d);
}

/// Completes a run after its last well, once the missing numbers are computed.
fn finish(d: &mut DriverState) {
    d.transition(Trigger::WellsDone);
    missing::recover(d);
    if !is_delayed(d, Continuation::Finish) {
        close(d);
    }
}

/// Ends the run as requested, once the numbers of released specimens are computed.
pub(super) fn end_run(d: &mut DriverState) {
    if d.leaves_run() {
        // The next start finds what a crash leaves. It computes numbers that are missing.
        return d.forget_run();
    }
    missing::recover(d);
    if !is_delayed(d, Continuation::End) {
        end_now(d);
    }
}

/// Whether `then` must wait for numbers that are being computed.
fn is_delayed(d: &mut DriverState, then: Continuation) -> bool {
    d.run.as_mut().is_some_and(|run| run.numbers_mut().delay(then))
}

/// Closes a completed run. It ends once this is on disk, and is held until then.
fn close(d: &mut DriverState) {
    carry_out_reports(d);
    let Some(run) = &d.run else { return };
    let record = run.finished();
    d.close_folder(&record.id);
    if let Err(error) = d.outbox.commit_with(&record, ended(d, &record)) {
        d.handle_write_error(Err(error));
        return rest(d, true);
    }
    d.forget_run();
    let change = d.end_of_run(&record);
    d.transition_with(Trigger::Recorded, change);
}

/// Ends a run that was stopped or aborted, or that ends with the daemon.
pub(super) fn end_now(d: &mut DriverState) {
    carry_out_reports(d);
    let Some(run) = &d.run else { return };
    let (asked, store, id) = (run.request(), d.outbox.store(), &run.record().id);
    let record = run.ended(|well| views_stored(store, id, well));
    d.close_folder(&record.id);
    d.save(record.clone());
    d.event(None, ended(d, &record));
    d.forget_run();
    let change = d.end_of_run(&record);
    match asked {
        Request::Abort => d.transition_with(Trigger::MotorsStopped, change),
        Request::Stop | Request::ShutDown if !d.life.is_stopping() => d.transition_with(Trigger::Joined, change),
        // The daemon ends later, when all threads are joined.
        _ => d.publish(change),
    }
}

pub(super) fn recovered(d: &mut DriverState, made: Made) {
    let Some((found, wells)) = d.run.as_mut().and_then(|run| run.numbers_mut().take(made)) else { return };
    match found {
        Ok(found) => {
            missing::well_recovered(d, found);
            missing::recover_next(d, wells);
            if d.run.as_ref().is_some_and(|run| !run.numbers().are_being_made()) {
                match missing::take_continuation(d) {
                    Some(Continuation::Finish) => close(d),
                    Some(Continuation::End) => end_now(d),
                    None => {}
                }
            }
        }
        // As in a live run that cannot write its numbers: the run is held, and they are computed when it continues.
        Err(error) => {
            d.handle_write_error(Err(error));
            match missing::take_continuation(d) {
                Some(Continuation::Finish) => rest(d, true),
                Some(Continuation::End) => end_now(d),
                None => {}
            }
        }
    }
}

/// The event of a run's end.
pub(super) fn ended(d: &DriverState, record: &RunRecord) -> EventData {
    let loaded_by = Some(d.loader.loaded_by());
    EventData::RunEnded(RunEnded { outcome: record.outcome, wells: WellCounts::of(&record.wells), loaded_by })
}
