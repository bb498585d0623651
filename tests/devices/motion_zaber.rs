//! The Zaber driver against an emulated controller over a pty, compared with the true position of the shaft.

use crate::common::controllers;
use crate::driver::{cable_pulled_at_any_byte, late_answers, stand, turns, turns_evenly, until};
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Reference, Zaber, ZaberSettings, one_sided};
use carved_devices::{Achieved, DeviceError, Position, RotationAxis};
use hardware_sim::{Controller, Rig, zaber::Settings};

const STEPS: f64 = 6400.0;

fn rig(settings: Settings) -> Rig {
    crate::driver::rig(Controller::Zaber(settings), (6400, 1))
}

pub fn settings(rig: &Rig) -> ZaberSettings {
    ZaberSettings {
        port: controllers::serial_port(rig),
        baud: 115_200,
        device: 1,
        axis: 1,
        resolution: 32,
        maxspeed: 5243,
        accel: 5,
        encoder_tolerance_steps: Some(9),
        reference: Reference::Home,
        answer_timeout_ms: 600,
        homing_timeout_ms: 30_000,
        outputs: std::collections::BTreeMap::new(),
    }
}

fn here(rig: &Rig) -> ZaberSettings {
    ZaberSettings { reference: Reference::Here, ..settings(rig) }
}

fn referenced(settings: ZaberSettings) -> Zaber {
    let mut axis = Zaber::open(settings).unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    axis
}

/// Makes a move to `target` that fails because of `meanwhile`, and returns its error. The axis must then be suspect.
fn failed(axis: &mut Zaber, target: i64, meanwhile: impl FnOnce()) -> DeviceError {
    let error = std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(Steps(target)));
        meanwhile();
        moving.join().unwrap().unwrap_err()
    });
    assert!(matches!(axis.position(), Position::Suspect { .. }), "{error}");
    assert!(matches!(axis.move_to(Steps(0)), Err(DeviceError::Suspect { .. })));
    error
}

#[test]
fn a_turn_stands_at_every_view_where_its_steps_say() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    assert_eq!(axis.identity(), "Zaber 51234, firmware 7.32");
    assert!(turns(&rig).abs() < 1e-9, "homed to the sensor");
    for view in 0..=21 {
        let target = Steps((f64::from(view) * STEPS / 21.0).round() as i64);
        assert_eq!(axis.move_to(target).unwrap(), Achieved { steps: target, epoch: 1 });
        assert!((turns(&rig) - target.0 as f64 / STEPS).abs() < 1e-9);
    }
    assert_eq!(axis.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 2 });
}

#[test]
fn a_turn_at_a_constant_speed_is_where_its_time_says() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    turns_evenly(&mut axis, 2000.0, 3200, || turns(&rig) * STEPS);
    axis.move_to(Steps(0)).unwrap();
    assert!(turns(&rig).abs() < 1e-9, "the next move has its own speed");
}

#[test]
fn settings_that_differ_refuse_to_open_and_are_all_listed() {
    let rig = rig(Settings { resolution: 64, accel: 205, ..Settings::default() });
    let error = Zaber::open(settings(&rig)).err().unwrap();
    let DeviceError::Mismatch { differences, .. } = &error else { panic!("{error}") };
    let found: Vec<_> = differences.iter().map(|d| (d.name.as_str(), d.configured.as_str(), d.found.as_str())).collect();
    assert_eq!(found, [("resolution", "32", "64"), ("accel", "5", "205")]);
}

#[test]
fn an_encoder_that_is_not_there_is_reported_by_the_controllers_reason() {
    let rig = rig(Settings { encoder: false, ..Settings::default() });
    let error = Zaber::open(settings(&rig)).err().unwrap();
    assert!(error.to_string().contains("RJ BADCOMMAND") && error.to_string().contains("get encoder.pos"), "{error}");
    let mut axis = referenced(ZaberSettings { encoder_tolerance_steps: None, ..settings(&rig) });
    assert!(!axis.capabilities().has_encoder);
    axis.move_to(Steps(320)).unwrap();
}

#[test]
fn the_port_is_open_to_one_alone() {
    let rig = rig(Settings::default());
    let _axis = referenced(settings(&rig));
    assert!(matches!(Zaber::open(settings(&rig)), Err(DeviceError::Open { .. })));
}

#[test]
fn a_stop_in_the_middle_of_a_move_stops_the_axis_until_the_next_reference() {
    let rig = rig(Settings::default());
    let mut axis = referenced(here(&rig));
    let stop = axis.stop_handle();
    let begin = turns(&rig);
    let error = failed(&mut axis, 640_000, || {
        until("the axis to turn", || turns(&rig) > begin + 0.05);
        stop.stop();
    });
    assert!(matches!(error, DeviceError::Stopped), "{error}");
    stand(&rig);
    assert!(turns(&rig) < begin + 50.0, "long before its target");
    assert_eq!(axis.reference(&CancelToken::new()).unwrap().epoch, 3);
    axis.move_to(Steps(64)).unwrap();
}

#[test]
fn the_cable_pulled_at_any_byte_is_a_lost_connection_and_a_new_reference() {
    // The first answers of a move: state, counter, encoder, the acceptance, and one or two states; some 26 bytes each.
    cable_pulled_at_any_byte(26 * 5, || rig(Settings::default()), |rig| referenced(here(rig)));
}

#[test]
fn a_late_answer_at_any_place_of_a_move_answers_nothing_else() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    late_answers(8, 101, &rig, &mut axis, STEPS);
}

#[test]
fn noise_split_and_lost_lines_are_got_over_and_the_move_arrives() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    for (n, noise) in [&b"\xff"[..], b"/1 1 mo", b"@01 1 ", b"\r\n\n", b"\0\0:\xaa"].into_iter().enumerate() {
        let target = Steps(100 * (n as i64 + 1));
        rig.faults().serial().stray_to_controller(noise);
        axis.move_to(target).unwrap_or_else(|e| panic!("{noise:?} to the controller: {e}"));
        rig.faults().serial().stray_to_host(noise);
        axis.move_to(target + Steps(50)).unwrap_or_else(|e| panic!("{noise:?} to the host: {e}"));
        assert!((turns(&rig) - (target.0 + 50) as f64 / STEPS).abs() < 1e-9);
    }
    rig.faults().serial().drop_answers(1);
    axis.move_to(Steps(64)).unwrap();
    // The line end between two answers is lost.
    rig.faults().serial().rewrite_next(b"\r\n", b"");
    axis.move_to(Steps(128)).unwrap();
    rig.faults().serial().split_answers(true);
    axis.move_to(Steps(0)).unwrap();
    assert!(turns(&rig).abs() < 1e-9);
}

/// Two exchanged digits do not change the checksum.
#[test]
fn a_wrong_number_that_parses_is_asked_again() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    for target in [1600, 3200] {
        // The counter at the end of the first move, and at the beginning of the second.
        rig.faults().serial().rewrite_next(b"-- 1600:", b"-- 6100:");
        axis.move_to(Steps(target)).unwrap();
        assert!((turns(&rig) - target as f64 / STEPS).abs() < 1e-9);
    }
}

#[test]
fn a_restart_in_the_middle_of_a_move_between_two_and_at_rest_is_a_persons() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    let error = failed(&mut axis, 6400, || {
        until("the axis to turn", || turns(&rig) > 0.1);
        rig.faults().reboot_controller();
    });
    let is_told =
        |error: &DeviceError| matches!(error, DeviceError::Intervention { what, .. } if what.contains("reset, but not by carved"));
    assert!(is_told(&error), "{error}");
    assert_eq!(axis.reference(&CancelToken::new()).unwrap().epoch, 3);
    // After the restart the counter is 0, which is also the expected position.
    let stands = turns(&rig);
    rig.faults().reboot_controller();
    let error = failed(&mut axis, 320, || ());
    assert!(is_told(&error), "{error}");
    for at_rest in [RotationAxis::check, |axis: &mut Zaber| axis.reference(&CancelToken::new()).map(drop)] {
        axis.reference(&CancelToken::new()).unwrap();
        axis.check().unwrap();
        rig.faults().reboot_controller();
        let error = at_rest(&mut axis).unwrap_err();
        assert!(is_told(&error), "{error}");
        axis.check().unwrap();
    }
    assert_eq!(turns(&rig).to_bits(), stands.to_bits(), "nothing moved");
}

#[test]
fn lost_steps_are_a_miss_by_the_encoder_and_within_its_tolerance_none() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    rig.faults().lose_steps(9);
    axis.move_to(Steps(1600)).unwrap();
    rig.faults().lose_steps(1);
    let error = failed(&mut axis, 3200, || ());
    assert!(matches!(error, DeviceError::Missed { target: Steps(3200), achieved: Steps(3190) }), "{error}");
}

#[test]
fn stalls_limits_and_hands_are_named() {
    let rig = rig(Settings::default());
    let mut axis = referenced(here(&rig));
    rig.faults().motors().stall_after(0, 700);
    let error = failed(&mut axis, 1600, || ());
    assert!(matches!(error, DeviceError::Stalled { at: Steps(700), target: Steps(1600), .. }), "{error}");
    let stands = turns(&rig);
    axis.reference(&CancelToken::new()).unwrap();
    assert_eq!(turns(&rig).to_bits(), stands.to_bits(), "the old move is forgotten");
    rig.faults().motors().limit_after(0, 500);
    let error = failed(&mut axis, 1600, || ());
    assert!(matches!(&error, DeviceError::Alarm { what, .. } if what.starts_with("FE")), "{error}");
    drop(axis);
    // With homing, because a position that was taken as zero carries the warning WH, which hides those of lower priority.
    let mut axis = referenced(settings(&rig));
    axis.move_to(Steps(64)).unwrap();
    rig.shaft().push(80);
    let error = failed(&mut axis, 1600, || ());
    assert!(is_intervention(&error, "WM"), "{error}");
}

fn is_intervention(error: &DeviceError, flag: &str) -> bool {
    matches!(error, DeviceError::Intervention { what, .. } if what.contains(flag))
}

/// With `here` as reference the controller's own warning hides the one about the knob.
#[test]
fn a_hand_on_the_knob_in_the_middle_of_a_move_waits_for_a_person() {
    for reference in [Reference::Home, Reference::Here] {
        let rig = rig(Settings::default());
        let mut axis = referenced(ZaberSettings { reference, ..settings(&rig) });
        let begin = turns(&rig);
        let error = failed(&mut axis, 64_000, || {
            until("the axis to turn", || turns(&rig) > begin + 0.1);
            rig.faults().motors().turn_knob(100);
        });
        assert!(is_intervention(&error, "NI") || is_intervention(&error, "NC"), "{reference:?}: {error}");
        stand(&rig);
        assert!(turns(&rig) < begin + 5.0, "long before its target");
        // The person has released the knob and acknowledged the fault.
        axis.reference(&CancelToken::new()).unwrap();
        axis.move_to(Steps(64)).unwrap();
    }
}

#[test]
fn a_knob_that_is_still_being_turned_refuses_the_reference() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    rig.faults().motors().turn_knob(64_000);
    let error = failed(&mut axis, 1600, || ());
    assert!(is_intervention(&error, "NC"), "{error}");
    let error = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(is_intervention(&error, "NC"), "{error}");
}

#[test]
fn a_hardware_stop_waits_for_a_person_and_refuses_the_reference_until_it_is_released() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    let error = failed(&mut axis, 64_000, || {
        until("the axis to turn", || turns(&rig) > 0.1);
        rig.faults().motors().press_hardware_stop(true);
    });
    assert!(is_intervention(&error, "FH"), "{error}");
    stand(&rig);
    let stands = turns(&rig);
    for _ in 0..2 {
        let error = axis.reference(&CancelToken::new()).unwrap_err();
        assert!(is_intervention(&error, "FH"), "{error}");
        axis.check().expect("it was told");
    }
    assert_eq!(turns(&rig).to_bits(), stands.to_bits(), "nothing moved");
    rig.faults().motors().press_hardware_stop(false);
    axis.reference(&CancelToken::new()).unwrap();
    axis.move_to(Steps(64)).unwrap();
}

#[test]
fn a_hardware_stop_that_nobody_was_informed_of_is_reported_before_anything_moves() {
    let rig = rig(Settings::default());
    let mut axis = Zaber::open(settings(&rig)).unwrap();
    rig.faults().motors().press_hardware_stop(true);
    // On a busy computer an answer may come too late.
    until("the stop to be seen", || axis.check().is_err_and(|error| is_intervention(&error, "FH")));
    rig.faults().motors().press_hardware_stop(false);
    drop(axis);
    let stands = turns(&rig);
    // The switch is released, but a person has not enabled the motion again.
    let mut axis = Zaber::open(settings(&rig)).unwrap();
    let error = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(is_intervention(&error, "FH"), "{error}");
    assert_eq!(turns(&rig).to_bits(), stands.to_bits(), "nothing moved");
    axis.reference(&CancelToken::new()).unwrap();
}

#[test]
fn between_runs_the_controller_is_asked_and_a_hand_is_reported_once() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    axis.check().unwrap();
    // A stop by this program is no intervention.
    let stop = axis.stop_handle();
    let error = failed(&mut axis, 64_000, || {
        until("the axis to turn", || turns(&rig) > 0.1);
        stop.stop();
    });
    assert!(matches!(error, DeviceError::Stopped), "{error}");
    stand(&rig);
    axis.check().unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    rig.faults().motors().turn_knob(64);
    let mut told = Ok(());
    until("the hand to be seen", || {
        told = axis.check();
        told.is_err()
    });
    assert!(is_intervention(told.as_ref().unwrap_err(), "NC"), "{told:?}");
    stand(&rig);
    axis.check().unwrap();
    rig.faults().serial().drop_answers(u32::MAX);
    let error = axis.check().unwrap_err();
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    rig.faults().serial().drop_answers(0);
    rig.faults().unplug_serial();
    let error = axis.check().unwrap_err();
    assert!(matches!(error, DeviceError::Gone { .. }), "{error}");
}

/// A repeated move command would interrupt the move.
#[test]
fn a_lost_answer_to_a_long_move_does_not_interrupt_it() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    // The late answer is one after state, counter and encoder.
    for lost in 0..6 {
        rig.faults().serial().delay_answer_after(lost, std::time::Duration::from_millis(900));
        let target = Steps(3200 * (i64::from(lost) + 1));
        assert_eq!(axis.move_to(target).unwrap_or_else(|e| panic!("answer {lost}: {e}")).steps, target);
    }
}

#[test]
fn a_silent_controller_is_named_and_nothing_is_believed() {
    let rig = rig(Settings::default());
    let mut axis = referenced(here(&rig));
    rig.faults().serial().drop_answers(u32::MAX);
    let error = failed(&mut axis, 320, || ());
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
}

#[test]
fn backlash_is_taken_up_by_coming_from_one_side() {
    let rig = rig(Settings::default());
    rig.shaft().set_play(25.0);
    let mut axis = one_sided(Box::new(Zaber::open(here(&rig)).unwrap()), 30).unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    let zero = turns(&rig);
    for target in [3200, 1600, 4800, 800, 0] {
        assert_eq!(axis.move_to(Steps(target)).unwrap().steps, Steps(target));
        let off = (turns(&rig) - zero) * STEPS - target as f64;
        assert!(off.abs() < 1e-6, "{target}: {off} steps off");
    }
}
