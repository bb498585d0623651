//! What clients ask for: each request is accepted or refused, and carried out.

use super::super::handle::{Accepted, Command, Refusal, Towards};
use super::super::state::Trigger;
use super::super::{State, Status, gate, preflight};
use super::commands::{self, reply};
use super::devices::{PictureAnswer, PreflightRequest};
use super::driver_state::DriverState;
use super::loader::LoaderMessage;
use super::plates::Surroundings;
use super::room;
use super::run::RunInProgress;
use super::{course, faults, people, queue, start};
use crate::api::{self, HandoffNeeds};
use carved_records::{Asked, EventData, Fault, Handoff, HandoffEnd, Report, ResumedBy, RunPlan, WellLoaded, Work, fault_table};
use carved_store::RunRecord;
use std::future::Future;
use std::pin::pin;
use tokio::sync::{mpsc, oneshot};

pub(super) fn acknowledge(d: &mut DriverState, seq: u64, asked: Asked) -> Result<(), Refusal> {
    if let Some((known, ends)) = faults::acknowledge(&d.state().faults, seq, asked)? {
        d.commit(None, EventData::FaultAcknowledged(known))?;
        if ends {
            d.publish(|_| ());
        }
    }
    Ok(())
}

/// Aborts the run. The motors have stopped already. No run starts before an operator acknowledges the fault.
pub(super) fn emergency_stopped(d: &mut DriverState) -> Result<(), Refusal> {
    emergency_pressed(d);
    d.outbox.on_disk()
}

/// Handles the emergency stop once, however often it was pressed.
pub(super) fn emergency_pressed(d: &mut DriverState) {
    let Some(asked) = d.publisher.halt().take() else { return };
    d.devices.note_stop();
    if !faults::is_open(&d.state().faults, fault_table::EMERGENCY_STOP.code) {
        let (seq, since) = (d.state().faults.newest() + 1, jiff::Timestamp::now().to_string());
        let mut message = fault_table::EMERGENCY_STOP.meaning.to_owned();
        if let Some(by) = &asked.by {
            message += &format!(" Pressed by {by}{}.", asked.from.as_ref().map_or_else(String::new, |from| format!(" ({from})")));
        }
        let fault = Fault::new(seq, &fault_table::EMERGENCY_STOP, message, since);
        d.event_shown(None, EventData::FaultRaised(fault), |d| d.publish(|_| ()));
    }
    let state = d.machine();
    if d.run.is_some() && state != State::Aborting {
        course::abort(d, asked);
    } else if d.run.is_none() && state != State::Aborted {
        d.abort_left_run(asked);
        d.transition(Trigger::Abort);
        d.transition(Trigger::MotorsStopped);
    }
}

/// Takes emergency stops until no client can reach the daemon any more.
pub(super) async fn take_last(d: &mut DriverState, mailbox: &mut mpsc::Receiver<Command>, unreachable: impl Future<Output = ()>) {
    let halt = d.publisher.halt().clone();
    let mut unreachable = pin!(unreachable);
    loop {
        tokio::select! {
            biased;
            () = halt.pressed() => emergency_pressed(d),
            Some(request) = mailbox.recv() => command(d, request),
            () = &mut unreachable => return,
        }
    }
}

pub(super) fn command(d: &mut DriverState, command: Command) {
    if d.life.is_stopping() && !matches!(command, Command::EmergencyStop { .. }) {
        // Who waits for the answer of a command that is dropped gets `ShuttingDown`.
        return;
    }
    match command {
        Command::PutRun { id, plan, answer } => reply(answer, put_run(d, &id, plan)),
        Command::Queue { change, answer } => reply(answer, queue::change(d, change)),
        Command::Queued { run, answer } => reply(answer, queue::plan_of(d, &run)),
        Command::NextPlate { barcode, answer } => reply(answer, next_plate(d, &barcode)),
        Command::Steer { id, towards, asked, answer } => reply(answer, steer(d, &id, towards, asked)),
        Command::EmergencyStop { answer } => reply(answer, emergency_stopped(d)),
        Command::Acknowledge { seq, asked, answer } => reply(answer, acknowledge(d, seq, asked)),
        Command::OfWell { run, well, said, answer } => reply(answer, people::said(d, &run, &well, said)),
        Command::Loaded { run, well, loaded: true, answer } => reply(answer, loaded(d, &run, &well)),
        Command::Loaded { run, well, loaded: false, answer } => reply(answer, unloaded(d, &run, &well)),
        Command::Handoff { plate, answer } => reply(answer, handoff(d, plate)),
        Command::EndHandoff { end, answer } => reply(answer, end_handoff(d, end)),
        Command::Preflight { plan, answer } => preflight(d, plan, answer),
        Command::Picture { answer } => picture(d, answer),
    }
}

fn put_run(d: &mut DriverState, id: &str, plan: RunPlan) -> Result<Accepted, Refusal> {
    commands::check_run_name(id)?;
    if d.queue.get(id).is_some() {
        return Err(Refusal::Queued { id: id.to_owned() });
    }
    begin(d, id, plan)
}

/// Begins the run of the next plate. A repeat of the message while this run is under way changes nothing.
fn next_plate(d: &mut DriverState, barcode: &str) -> Result<(String, Accepted), Refusal> {
    if let Some(current) = d.run.as_ref().map(RunInProgress::record).filter(|record| record.plan.plate_barcode == barcode) {
        return Ok((current.id.clone(), Accepted::Same));
    }
    let next = d.queue.next(barcode)?.clone();
    let accepted = begin(d, &next.run, next.plan)?;
    queue::take_out(d, &next.run);
    Ok((next.run, accepted))
}

/// What the data folder knows of a run that is to begin.
enum Known {
    Not,
    Run(Box<RunRecord>),
    Pruned,
}

/// Looks a run up. The record of a start that the disk refused is removed first, if it is still there: nothing has happened in that run.
fn known(d: &mut DriverState, id: &str) -> Result<Known, Refusal> {
    let is_open = |known: &RunRecord| known.outcome.is_none();
    let mut known = d.outbox.store().run(id)?;
    if !d.is(id) && known.as_ref().is_some_and(is_open) {
        // The end of a run may wait for the disk.
        d.outbox.flush()?;
        known = d.outbox.store().run(id)?;
        if known.as_ref().is_some_and(is_open) && !start::has_wells(d.outbox.store(), id) {
            d.outbox.store().forget_run(id)?;
            return Ok(Known::Not);
        }
    }
    let was_accepted = || d.outbox.store().reader().was_accepted(id).unwrap_or(false);
    Ok(match known {
        Some(known) => Known::Run(Box::new(known)),
        None if was_accepted() => Known::Pruned,
        None => Known::Not,
    })
}

fn begin(d: &mut DriverState, id: &str, plan: RunPlan) -> Result<Accepted, Refusal> {
    match known(d, id)? {
        Known::Not => {}
        Known::Run(known) if known.plan == plan => return Ok(Accepted::Same),
        Known::Run(_) => return Err(Refusal::OtherPlan { id: id.to_owned() }),
        Known::Pruned => return Err(Refusal::Pruned { id: id.to_owned() }),
    }
    plan.check(&d.config.methods).map_err(Refusal::InvalidPlan)?;
    gate::refuses(&d.config, d.mode, &plan).map_or(Ok(()), |mistake| Err(Refusal::InvalidPlan(vec![mistake])))?;
    commands::check_startable(d.run.is_some(), d.machine())?;
    d.check_faults()?;
    if let Some(left) = d.loader.keeps_run_out(d.specimens()) {
        return Err(left.refusal(d.newest_run().map(|newest| newest.id.as_str())));
    }
    commands::check_plate(&plan, &d.state().plate)?;
    let method = d.config.methods.get(&plan.method).cloned().ok_or_else(|| commands::unknown_method(&plan))?;
    if d.devices.at_rest().is_none() {
        return Err(Refusal::Busy);
    }
    room::fits(&d.config, d.outbox.store(), preflight::needed_bytes(&d.config, &method, plan.plate_map.len()))?;
    course::start(d, id, plan, method)?;
    Ok(Accepted::Created)
}

fn steer(d: &mut DriverState, id: &str, towards: Towards, asked: Asked) -> Result<(), Refusal> {
    let state = d.machine();
    if !d.is(id) {
        let stored = d.outbox.store().run(id).map_err(Refusal::from)?;
        return commands::steer_ended(id, towards, stored, d.newest_run().map(|newest| newest.id.as_str()), state);
    }
    if !commands::steer(towards, state)? {
        return Ok(());
    }
    match towards {
        Towards::Abort => {
            course::abort(d, asked);
            d.outbox.on_disk()
        }
        Towards::Stop => course::stop(d, asked),
        Towards::Hold => course::hold(d, state, asked),
        Towards::Unhold => course::unhold(d, ResumedBy::Operator, asked),
    }
}

fn loader_message<'a>(d: &'a DriverState, run: &'a str, well: &'a str) -> LoaderMessage<'a> {
    let newest = d.newest_run().map(|newest| (newest.id.as_str(), newest.outcome));
    let is_planned = d.newest_run().is_some_and(|newest| newest.wells.iter().any(|planned| planned.well == well));
    LoaderMessage { run, well, newest, specimens: d.specimens(), is_planned, situation: d.loader.situation(d.work()) }
}

/// The run that an event of the loader belongs to. `None` if the run was pruned: its folder must not be created again.
fn run_of_event<'a>(d: &DriverState, run: &'a str) -> Option<&'a str> {
    d.outbox.store().run_folder(run).is_dir().then_some(run)
}

fn loaded(d: &mut DriverState, run: &str, well: &str) -> Result<(), Refusal> {
    let Report::News { in_place_of } = loader_message(d, run, well).loaded()? else { return Ok(()) };
    let loaded = WellLoaded { in_place_of: in_place_of.map(str::to_owned) };
    d.outbox.commit(run_of_event(d, run), Some(well), EventData::WellLoaded(loaded))?;
    match (d.work(), d.machine()) {
        (Work::InProgress, State::Suspended) => {
            d.loader.say_loaded(well);
            d.transition(Trigger::Loaded);
        }
        // The run waited for the specimen before it to be taken out. The loader has exchanged both.
        (Work::Paused, State::Suspended) => {
            d.transition(Trigger::Loaded);
            course::proceed(d);
        }
        // In a held run it waits for the continuation, and is not brought again. In a run that ends it stays inside.
        (Work::InProgress | Work::Paused, _) => d.publish(|_| ()),
        (Work::Over, _) => d.show_left_specimen(),
    }
    Ok(())
}

fn unloaded(d: &mut DriverState, run: &str, well: &str) -> Result<(), Refusal> {
    if loader_message(d, run, well).is_taken_out_at_work() {
        return course::taken_out_at_work(d, well);
    }
    if loader_message(d, run, well).unloaded()? == Report::Known {
        return Ok(());
    }
    let is_first = d.must_leave_first() == Some(well);
    if d.works() || d.loader.brings_again() {
        d.outbox.commit(run_of_event(d, run), Some(well), EventData::WellUnloaded)?;
    } else {
        course::taken_for_good(d, run_of_event(d, run).map(str::to_owned).as_deref(), well)?;
    }
    let at_rest = d.run.is_none();
    let change = |s: &mut Status| drop(s.specimen.take_if(|_| at_rest));
    if is_first && d.work() == Work::Paused && d.machine() == State::Suspended {
        d.transition_with(Trigger::Loaded, change);
        course::proceed(d);
    } else {
        d.publish(change);
    }
    Ok(())
}

fn surroundings(d: &DriverState) -> Surroundings<'_> {
    Surroundings {
        state: d.machine(),
        has_run: d.run.is_some(),
        specimens: d.specimens(),
        has_unexpected: d.state().stranger.is_inside(),
        is_failing: d.outbox.is_failing(),
    }
}

/// Announces that a plate will be moved. Returns what must happen first.
pub(super) fn handoff(d: &mut DriverState, plate: Handoff) -> Result<HandoffNeeds, Refusal> {
    if surroundings(d).announce(&d.state().plate, &plate)? {
        d.commit(None, EventData::PlateAnnounced(plate.clone()))?;
        d.publish(|_| ());
    }
    Ok(HandoffNeeds { intent: plate.intent, needs: surroundings(d).needs(), barcode: plate.barcode })
}

pub(super) fn end_handoff(d: &mut DriverState, end: HandoffEnd) -> Result<(), Refusal> {
    let Some(data) = surroundings(d).end(&d.state().plate, end)? else { return Ok(()) };
    d.commit(None, data)?;
    d.publish(|_| ());
    Ok(())
}

/// Checks everything that a run of this plan needs. The check uses the instrument, so it is refused during a run.
pub(super) fn preflight(d: &mut DriverState, plan: RunPlan, answer: oneshot::Sender<Result<Vec<api::Check>, Refusal>>) {
    let sound = plan.check(&d.config.methods).map_err(Refusal::InvalidPlan);
    let accepted = sound.and_then(|()| commands::check_startable(d.run.is_some(), d.machine()));
    if let Err(refusal) = accepted {
        return reply(answer, Err(refusal));
    }
    let deadline = std::time::Duration::from_millis(d.config.acquisition.grab_deadline_ms.into());
    // `RevolutionPlan` has checked its number of views when the configuration was read.
    let sweep = d.config.methods.get(&plan.method).and_then(|method| d.config.sweep(method)?.ok());
    match d.devices.begin_preflight(Box::new(PreflightRequest { plan, answer }), sweep, deadline, d.publisher.halt()) {
        // Shows that no run is accepted during the check.
        Ok(()) => d.publish(|_| ()),
        Err(request) => reply(request.answer, Err(Refusal::Busy)),
    }
}

/// Takes a picture with the light on, as a run would. Nothing moves. During a run the pictures are those of the run. The next command ends
/// the wait for it.
fn picture(d: &mut DriverState, answer: PictureAnswer) {
    // With an open fault nothing is switched: a person may have a hand at the machine.
    let accepted = commands::check_startable(d.run.is_some(), d.machine()).and_then(|()| d.check_faults());
    if let Err(refusal) = accepted {
        return reply(answer, Err(refusal));
    }
    let deadline = std::time::Duration::from_millis(d.config.acquisition.grab_deadline_ms.into());
    if let Err(answer) = d.devices.begin_picture(answer, deadline, d.publisher.halt()) {
        reply(answer, Err(Refusal::Busy));
    }
}
