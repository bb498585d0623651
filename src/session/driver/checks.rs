//! What the driver checks by itself, with each heartbeat: the devices between runs, the disk, the index, the calibration's age.

use super::super::handle::Refusal;
use super::super::search::DevicesFound;
use super::super::{OutputStatus, Status, preflight};
use super::commands::reply;
use super::devices::{Done, Finding, PreflightRequest, findings, intervention};
use super::driver_state::DriverState;
use super::loader::Left;
use super::room::{self, Speed};
use super::{course, faults};
use carved_devices::DeviceError;
use carved_records::{Device, EventData, Fault, SensorReading, fault_table};

pub(super) fn beat(d: &mut DriverState) {
    d.calibration_ages();
    d.show_index();
    d.show_notices();
    if !d.life.is_stopping() {
        // Before the device check: the check takes the instrument, and a run that continues needs it.
        try_the_store(d);
        course::try_again_if_due(d);
        look(d);
        d.look_for_room();
        look_at_the_disk(d);
    }
}

/// Raises the fault of a slow disk, and clears it once a write is fast again after a while.
fn look_at_the_disk(d: &mut DriverState) {
    let code = &fault_table::DISK_SLOW;
    let is_open = faults::is_open(&d.state().faults, code.code);
    match d.speed.look() {
        Speed::Slow(took) if !is_open => {
            let message = format!("a write to the data folder took {:.1} s; milliseconds are usual", took.as_secs_f64());
            let fault = Fault::new(d.state().faults.newest() + 1, code, message, jiff::Timestamp::now().to_string());
            d.event_shown(None, EventData::FaultRaised(fault), |d| d.publish(|_| ()));
        }
        Speed::Untried if is_open => {
            d.outbox.probe();
            if !matches!(d.speed.look(), Speed::Slow(_)) {
                d.fault_over(|fault| fault.code == code.code, "the disk is fast again", |_| ());
            }
        }
        Speed::Slow(_) | Speed::Untried | Speed::Same => {}
    }
}

/// Tries a failed disk again. What is not on disk yet is written first.
pub(super) fn try_the_store(d: &mut DriverState) {
    if !d.outbox.is_failing() || d.works() || !room::is_worth_a_retry(d.outbox.store()) {
        return;
    }
    let written = match &d.run {
        Some(run) => d.outbox.commit_with(run.record(), EventData::StoreRegained),
        None => d.outbox.commit(None, None, EventData::StoreRegained),
    };
    if let Err(error) = written {
        tracing::warn!(%error, "the disk does not take writes yet");
        return;
    }
    d.outbox.set_failing(false);
    course::let_go_on(d);
    d.fault_over(Fault::is_of_storage, "the disk takes writes again", |_| ());
    course::resume_by_itself(d);
}

/// Checks the devices between runs.
pub(super) fn look(d: &mut DriverState) {
    if d.devices.at_rest().is_none() {
        return;
    }
    if d.devices.camera_is_lost() {
        lose(d, Device::Camera, DeviceError::ControlLost);
    }
    d.devices.begin_look();
}

pub(super) fn task_done(d: &mut DriverState, done: Done) {
    d.devices.aim(d.publisher.halt());
    match done {
        Done::Searched(found) => searched(d, found),
        Done::Picture((seen, picture), answer) => {
            if let Some(taken) = seen.intervention().and_then(intervention) {
                find(d, taken);
            }
            reply(answer, picture.map_err(|why| Refusal::NoPicture { why }));
        }
        Done::Preflight(seen, request) => {
            let PreflightRequest { plan, answer } = *request;
            if let Some(taken) = seen.intervention().and_then(intervention) {
                find(d, taken);
            }
            let store = d.outbox.store();
            let known = preflight::Known {
                faults: d.state().faults.open(),
                notices: d.notices(),
                mode: d.mode,
                gate: d.calibration.as_ref().and_then(|c| c.gate.as_ref()),
                plate_handed_over: d.state().plate.handed_over(),
                blurs: &d.blurs,
                left: d.loader.keeps_run_out(d.specimens()).map(Left::words),
                free_bytes: store.free_bytes(),
                budget: room::budget(&d.config, store),
            };
            let checks = preflight::checks(&d.config, &plan, &seen, &known);
            // Publish first: when the client reads the answer, a run can be accepted again.
            d.publish(|_| ());
            reply(answer, Ok(checks));
        }
    }
    course::go_on_if_it_may(d);
}

pub(super) fn searched(d: &mut DriverState, found: DevicesFound) {
    let was_lost = d.devices.lost().is_some();
    let outputs = found.outputs.iter().cloned().map(OutputStatus::from).collect::<Vec<_>>();
    for finding in findings(found) {
        find(d, finding);
    }
    if !outputs.is_empty() {
        d.publish_news(|s| s.hardware.outputs = outputs);
    }
    read_wire(d);
    // A run that this loss has held may continue.
    if was_lost && d.devices.lost().is_none() {
        course::resume_by_itself(d);
    }
}

fn find(d: &mut DriverState, finding: Finding) {
    match finding {
        Finding::There(device) => find_again(d, device),
        Finding::Lost(device, error) => lose(d, device, error),
        Finding::Stands(code, error) => {
            if !faults::is_open(&d.state().faults, code) {
                d.raise(&error.into());
                course::hold_under_fault(d);
            }
        }
    }
}

/// Raises the fault of a device that was lost between runs, once.
fn lose(d: &mut DriverState, device: Device, error: DeviceError) {
    if !d.devices.has_lost(device) {
        d.raise(&error.into());
    }
}

fn find_again(d: &mut DriverState, device: Device) {
    let identity = d.devices.at_rest().map(|instrument| instrument.rig.rotation.identity().to_owned()).unwrap_or_default();
    let connected = |s: &mut Status| match device {
        Device::Camera => s.hardware.camera.connected = true,
        Device::Rotation | Device::Pictures => s.hardware.find_axes(&identity),
    };
    let was_lost = d.devices.mark_found(device);
    // The loss may be that of an earlier process. The second fault comes first, so that no client reads that the axis may turn.
    let was_away = device == Device::Rotation && faults::is_open(&d.state().faults, fault_table::ROTATION_LOST.code);
    if was_away {
        find(d, Finding::Stands(fault_table::ROTATION_INTERVENTION.code, axis_was_away()));
    }
    if was_lost || was_away {
        if d.devices.lost().is_none() {
            course::let_go_on(d);
        }
        d.fault_over(|fault| device.is_all_of(fault), device.back_text(), connected);
    }
    // A controller that was held when the port was opened sends its version only once it is free.
    if device == Device::Rotation {
        d.publish_news(connected);
    }
}

/// The error of an axis that is back. Whether it kept its power cannot be told.
fn axis_was_away() -> DeviceError {
    DeviceError::Intervention {
        device: "rotation axis",
        what: "the controller was away and is back: its cable was out, or its power was off".into(),
        way_out: "Make sure that the axis may turn, then acknowledge the fault and let the run go on: it begins with a reference",
    }
}

/// Reads the sampler's sensor for a specimen in the capillary, while the capillary should be empty: without a run, and in a run that the
/// sampler's fault holds. In a run that is held otherwise the sampler may bring the next specimen.
fn read_wire(d: &mut DriverState) {
    let Some(sampler) = d.devices.at_rest().map(|instrument| &instrument.sampler) else { return };
    // Without a sensor nothing shows any more what the sensor of an earlier start has seen.
    let seen = if sampler.has_sensor() { sampler.sees_specimen() } else { Some(false) };
    let is_known = d.state().stranger.is_inside();
    let is_failed = || is_known || faults::is_open(&d.state().faults, fault_table::SAMPLER_FAILED.code);
    let is_empty = d.specimens().inside().is_none() && d.run.as_ref().is_none_or(|run| !run.works() && is_failed());
    let Some(there) = seen.filter(|_| is_empty) else { return };
    if there != is_known {
        d.event_shown(None, EventData::SpecimenUnasked(SensorReading { there }), |d| d.publish(|_| ()));
    }
    if there && d.run.is_none() {
        find(d, Finding::Stands(fault_table::SAMPLER_FAILED.code, DeviceError::Unasked));
    }
}
