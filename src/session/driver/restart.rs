//! What a start does with the state that the previous process left.

use super::super::state::Trigger;
use super::super::{CameraStatus, OutputStatus, Status, TranslationStatus, gate};
use super::driver_state::DriverState;
use super::interrupt::Fate;
use super::run::RunInProgress;
use super::sealing::seal_run;
use super::snapshot::{run_status, show_left};
use super::{Life, course, missing, people, queue, resume, start};
use carved_records::{DaemonStarted, EndRequest, Event, EventData, RunInterrupted, RunState};
use carved_store::RunRecord;

/// Shows the devices, then the state that the previous process left. If the disk refuses writes, that is a fault and not the end of the
/// daemon.
pub(super) fn first_report(d: &mut DriverState) {
    let second = d.devices.at_rest().and_then(|i| i.second.as_ref()).map(|second| second.identity().to_owned());
    let identities = d.devices.at_rest().map(|i| (i.rig.rotation.identity().to_owned(), i.rig.camera.identity().to_owned()));
    let has_translation = d.config.translation.is_some();
    let outputs: Vec<OutputStatus> = d.config.rotation.outputs().into_iter().map(Into::into).collect();
    let disk_free_bytes = d.outbox.store().free_bytes();
    let calibration = gate::calibration(&d.config, d.mode);
    let open = open_runs(d);
    d.event(None, EventData::DaemonStarted(DaemonStarted { version: env!("CARGO_PKG_VERSION").into(), mode: d.mode }));
    queue::restore(d);
    d.calibration = calibration;
    d.publish(|s| {
        if let Some((rotation, camera)) = identities {
            s.hardware.translation = has_translation.then(TranslationStatus::default);
            s.hardware.find_axes(&rotation);
            s.hardware.outputs = outputs;
            s.hardware.camera.identity = Some(camera);
            s.hardware.camera.connected = true;
        }
        s.hardware.camera_second =
            second.map(|identity| CameraStatus { identity: Some(identity), connected: true, ..CameraStatus::default() });
        s.hardware.disk_free_bytes = disk_free_bytes;
    });
    d.life = Life::Up;
    if let Some(record) = open {
        let run = start::run_after(&record.id, &start::events_of(d.outbox.store(), &d.publisher, &record.id));
        take_up(d, record, run);
    } else if let Some(record) = start::ended_run(d.outbox.store(), d.mode) {
        show_again(d, &record);
    } else {
        d.publish(|_| ());
    }
}

/// The newest open run, if it can continue. The other open runs are ended here.
fn open_runs(d: &mut DriverState) -> Option<RunRecord> {
    let open = match d.outbox.store().open_runs() {
        Ok(open) => open,
        Err(error) => {
            d.handle_write_error(Err(error));
            return None;
        }
    };
    let (unaccepted, open): (Vec<RunRecord>, _) = open.into_iter().partition(|run| start::is_not_accepted(d.outbox.store(), &run.id));
    for run in unaccepted {
        // A repeat of the request must not be answered as known.
        let forgotten = d.outbox.store().forget_run(&run.id);
        d.handle_write_error(forgotten);
    }
    let (newest, others) = start::newest_of(open, d.mode);
    for mut run in others {
        let known = start::run_after(&run.id, &start::events_of(d.outbox.store(), &d.publisher, &run.id));
        people::end_redos(d, &known, &mut run);
        seal_run(d.outbox.store(), &run.id);
        run.end_interrupted();
        let id = run.id.clone();
        d.save(run);
        let interrupted = RunInterrupted { found: "at start".into(), loaded_by: None, kernel_boot_id: None };
        d.outbox.record(Some(&id), None, EventData::RunInterrupted(interrupted));
        d.write();
    }
    newest
}

/// Shows an ended run as before the restart, until the next run starts.
fn show_again(d: &mut DriverState, record: &RunRecord) {
    let events = start::events_of(d.outbox.store(), &d.publisher, &record.id);
    let run = start::run_after(&record.id, &events);
    let state = start::rests_in(record.outcome, run.end_request());
    let lacks_end = |events: &[Event]| !events.iter().any(|event| matches!(event.body.data, EventData::RunEnded(_)));
    // Events that cannot be read may have it.
    let lacks_end = lacks_end(&events) && d.outbox.store().events_of(&record.id).is_ok_and(|read| lacks_end(&read));
    d.outbox.recall(run);
    if lacks_end {
        // The process ended after it had written the outcome. What the end means for the specimens follows from the event.
        d.outbox.record(Some(&record.id), None, course::ended(d, record));
        d.write();
    }
    let change = d.end_of_run(record);
    d.restore(state, change);
}

/// Takes up a run that the previous process left open.
fn take_up(d: &mut DriverState, mut record: RunRecord, run: RunState) {
    people::end_redos(d, &run, &mut record);
    let asd = record.method.asd;
    let status = run_status(&record);
    let end_request = run.end_request();
    d.outbox.recall(run);
    d.run = Some(RunInProgress::new(record));
    let loaded_by = Some(d.loader.loaded_by());
    let kernel_boot_id = start::kernel_boot_id();
    d.event(None, EventData::RunInterrupted(RunInterrupted { found: "at start".into(), loaded_by, kernel_boot_id }));
    let known = d.outbox.state().run.as_ref();
    if let Some(run) = &mut d.run {
        // Set this before publishing, so that no client reads that the run waits for a person.
        run.recall(end_request);
        run.set_may_go_on(end_request.is_none() && resume::is_automatic(run, known));
    }
    let specimens = d.specimens().clone();
    d.transition_with(Trigger::TakeUp, |s: &mut Status| {
        s.run = Some(status);
        show_left(s, &specimens, asd);
    });
    course::interrupt_specimens(d, "the daemon ended before this specimen was done", Fate::PoseLost);
    course::carry_out_reports(d);
    if let Some(run) = &d.run {
        let status = run_status(run.record());
        d.publish(|s| s.run = Some(status));
    }
    missing::recover(d);
    match end_request {
        Some(end) => {
            d.transition(if end == EndRequest::Abort { Trigger::Abort } else { Trigger::Stop });
            course::end_run(d);
        }
        None => course::resume_by_itself(d),
    }
}
