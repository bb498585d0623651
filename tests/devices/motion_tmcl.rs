//! The TMCL driver against an emulated module over a pty, compared with the true positions of the shaft and its motors.

use crate::common::controllers;
use crate::driver::{cable_pulled_at_any_byte, late_answers, stand, turns, turns_evenly, until};
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Port, Reference, Tmcl, TmclSettings, one_sided};
use carved_devices::{Achieved, DeviceError, Position, RotationAxis};
use hardware_sim::{Controller, Rig, tmcl::Settings};
use std::f64::consts::TAU;
use std::io::Write;

const STEPS: f64 = 6400.0;
/// Steps of one motor in 0.2 s: longer than another process interrupts this one.
const MAX_SKEW: u32 = 640;
/// Value of a position in the module's answer.
const POSITION: u8 = 6;

fn rig(settings: Settings) -> Rig {
    crate::driver::rig(Controller::Tmcl(settings), (6400, 1))
}

fn settings(rig: &Rig) -> TmclSettings {
    settings_at(controllers::serial_port(rig))
}

pub fn settings_at(port: Port) -> TmclSettings {
    TmclSettings {
        port,
        baud: 115_200,
        module_address: 1,
        host_address: 2,
        motors: [0, 1],
        microstep_resolution: 5,
        max_speed: 3200,
        max_acceleration: 32_000,
        clock_divisors: None,
        max_skew_steps: MAX_SKEW,
        stop_on_stall: None,
        reference: Reference::Home,
        answer_timeout_ms: 200,
        homing_timeout_ms: 30_000,
        outputs: std::collections::BTreeMap::new(),
    }
}

fn here(rig: &Rig) -> TmclSettings {
    TmclSettings { reference: Reference::Here, ..settings(rig) }
}

fn armed(rig: &Rig) -> TmclSettings {
    TmclSettings { stop_on_stall: Some(100), ..here(rig) }
}

fn referenced(settings: TmclSettings) -> Tmcl {
    let mut axis = Tmcl::open(settings).unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    axis
}

fn motors(rig: &Rig) -> [f64; 2] {
    [0, 1].map(|motor| rig.shaft().motor_steps(motor))
}

fn answer(value: i32) -> Vec<u8> {
    let [a, b, c, d] = value.to_be_bytes();
    let mut bytes = vec![2, 1, 100, POSITION, a, b, c, d];
    bytes.push(bytes.iter().fold(0, |sum: u8, b| sum.wrapping_add(*b)));
    bytes
}

#[test]
fn a_turn_by_the_pair_stands_at_every_view_where_its_steps_say() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    assert_eq!(axis.identity(), "TMCM-6212 1.00");
    assert!(rig.shaft().angle_rad().abs() < 1e-9, "homed to the switch");
    for view in 0..=21 {
        let target = Steps((f64::from(view) * STEPS / 21.0).round() as i64);
        assert_eq!(axis.move_to(target).unwrap(), Achieved { steps: target, epoch: 1 });
        assert!((turns(&rig) - target.0 as f64 / STEPS).abs() < 1e-9);
        assert_eq!(motors(&rig)[0].to_bits(), motors(&rig)[1].to_bits(), "the glass is free of twist");
    }
    // The next specimen starts at a counter of 0 again, one turn further.
    assert_eq!(axis.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 2 });
    assert_eq!(axis.move_to(Steps(100)).unwrap().epoch, 2);
}

#[test]
fn a_turn_at_a_constant_speed_is_where_its_time_says_and_the_speed_is_restored() {
    let rig = rig(Settings::default());
    // A pair of which nothing was heard while it may have come apart is stopped, and an even turn has then failed. A busy computer may pause for
    // longer than this takes.
    let patient = TmclSettings { answer_timeout_ms: 2000, max_skew_steps: 16 * MAX_SKEW, ..settings(&rig) };
    let mut axis = referenced(patient.clone());
    turns_evenly(&mut axis, 2000.0, 3200, || turns(&rig) * STEPS);
    // A program that takes over finds the configured speed.
    drop(axis);
    referenced(patient);

    // Nor does a sweep that a loss of the cable has cut short leave another speed.
    let mut axis = referenced(here(&rig));
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_evenly(Steps(64_000), 1000.0, &mut |_| ()));
        until("the shaft to turn", || rig.shaft().is_turning());
        rig.faults().unplug_serial();
        assert!(matches!(moving.join().unwrap(), Err(DeviceError::Gone { .. })));
    });
    drop(axis);
    rig.faults().replug_serial().unwrap();
    let mut axis = referenced(here(&rig));
    axis.move_to(Steps(64)).unwrap();
}

#[test]
fn settings_that_differ_refuse_to_open_and_are_all_listed() {
    let rig = rig(Settings::default().with(140, 8).with(4, 2047));
    let error = Tmcl::open(settings(&rig)).err().unwrap();
    let DeviceError::Mismatch { differences, .. } = &error else { panic!("{error}") };
    let found: Vec<_> = differences.iter().map(|d| (d.configured.as_str(), d.found.as_str())).collect();
    assert_eq!(found, [("5", "8"), ("3200", "2047"), ("5", "8"), ("3200", "2047")]);
}

#[test]
fn the_port_is_open_to_one_alone() {
    let rig = rig(Settings::default());
    let _axis = referenced(settings(&rig));
    assert!(matches!(Tmcl::open(settings(&rig)), Err(DeviceError::Open { .. })));
}

#[test]
fn a_stop_in_the_middle_of_a_move_stops_both_motors_until_the_next_reference() {
    let rig = rig(Settings::default());
    let mut axis = referenced(here(&rig));
    let stop = axis.stop_handle();
    let begin = motors(&rig);
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(Steps(640_000)));
        until("the pair to turn", || motors(&rig)[1] > begin[1] + 200.0);
        stop.stop();
        assert!(matches!(moving.join().unwrap(), Err(DeviceError::Stopped)));
    });
    stand(&rig);
    assert!(motors(&rig)[0] - begin[0] < 320_000.0, "long before its target");
    assert_eq!(axis.position(), Position::Suspect { epoch: 2 });
    assert!(matches!(axis.move_to(Steps(0)), Err(DeviceError::Suspect { .. })));
    axis.reference(&CancelToken::new()).unwrap();
    let [first, second] = motors(&rig);
    assert_eq!(first.to_bits(), second.to_bits(), "the reference brought the ends together");
    axis.move_to(Steps(64)).unwrap();
}

#[test]
fn a_stop_reaches_both_motors_over_one_pair_of_wires() {
    let mut module = Settings::default();
    module.half_duplex = true;
    let rig = rig(module);
    let mut axis = referenced(here(&rig));
    let stop = axis.stop_handle();
    let begin = motors(&rig);
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(Steps(64_000)));
        until("the pair to turn", || motors(&rig)[1] > begin[1] + 200.0);
        stop.stop();
        assert!(matches!(moving.join().unwrap(), Err(DeviceError::Stopped)));
    });
    stand(&rig);
    assert!(motors(&rig).iter().all(|at| *at < 32_000.0), "{:?}: long before its target", motors(&rig));
}

#[test]
fn a_stop_is_heard_by_a_module_that_waits_for_the_rest_of_a_frame() {
    for stray in 1..9 {
        let rig = rig(Settings::default());
        let mut axis = referenced(here(&rig));
        let stop = axis.stop_handle();
        std::thread::scope(|scope| {
            let moving = scope.spawn(|| axis.move_to(Steps(640_000)));
            let begin = motors(&rig)[1];
            until("the pair to turn", || motors(&rig)[1] > begin + 200.0);
            rig.faults().serial().stray_to_controller(&[0x55; 8][..stray]);
            stop.stop();
            assert!(moving.join().unwrap().is_err());
        });
        stand(&rig);
    }
}

#[test]
fn the_cable_pulled_at_any_byte_is_a_lost_connection_and_a_new_reference() {
    // The first answers of a move: the mark, three readings, two accepted targets, and some readings during the move.
    cable_pulled_at_any_byte(9 * 9, || rig(Settings::default()), |rig| referenced(here(rig)));
}

#[test]
fn a_late_answer_at_any_place_of_a_move_is_never_in_the_wrong_field() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    // So short a move that the pair cannot diverge if only the first motor has accepted its target in time.
    late_answers(12, 101, &rig, &mut axis, STEPS);
}

/// An answer names its command only. An extra answer would be taken for the next one, and so would all later ones.
#[test]
fn a_motor_that_is_held_is_seen_whichever_answer_of_the_move_comes_twice() {
    std::thread::scope(|scope| {
        for doubled in 0..16 {
            scope.spawn(move || {
                let rig = rig(Settings::default().with(181, 100));
                let mut axis = referenced(armed(&rig));
                rig.faults().motors().stall_after(1, 300);
                rig.faults().serial().double_answer_after(doubled);
                let error = axis.move_to(Steps(12_800)).unwrap_err();
                let seen = matches!(&error, DeviceError::Skew { .. })
                    || matches!(&error, DeviceError::Stalled { motor, .. } if motor == "motor 1");
                assert!(seen, "answer {doubled} twice: {error}");
                stand(&rig);
                assert!(motors(&rig)[0] < 6_400.0, "answer {doubled} twice: {:?}, the other motor went on", motors(&rig));
            });
        }
    });
}

#[test]
fn answers_that_come_twice_cost_no_move() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    for doubled in 0..16 {
        rig.faults().serial().double_answer_after(u32::try_from(doubled).unwrap());
        let target = Steps(101 * (doubled + 1));
        assert_eq!(axis.move_to(target).unwrap_or_else(|e| panic!("answer {doubled} twice: {e}")).steps, target);
        assert!((turns(&rig) - target.0 as f64 / STEPS).abs() < 1e-9);
    }
}

/// The answers take twice as long as the driver waits, also those to its recovery.
#[test]
fn late_answers_in_the_middle_of_a_move_cost_time_and_not_the_move() {
    std::thread::scope(|scope| {
        for (late, count) in [(8, 1), (9, 2), (10, 3), (11, 5), (12, 8), (13, 3)] {
            scope.spawn(move || {
                let rig = rig(Settings::default());
                let mut axis = referenced(settings(&rig));
                rig.faults().serial().delay_some_answers_after(late, count, std::time::Duration::from_millis(400));
                let arrived = axis.move_to(Steps(3200)).unwrap_or_else(|e| panic!("{count} answers late from {late} on: {e}"));
                assert_eq!(arrived, Achieved { steps: Steps(3200), epoch: 1 });
                assert!((turns(&rig) - 0.5).abs() < 1e-9);
                assert_eq!(motors(&rig)[0].to_bits(), motors(&rig)[1].to_bits(), "the glass is free of twist");
            });
        }
    });
}

/// The skew is five steps above the limit, too little for homing to notice that one motor reaches its switch late.
#[test]
fn a_pair_that_stands_apart_is_not_homed_before_a_person_was_informed() {
    let rig = rig(Settings::default());
    drop(referenced(settings(&rig)));
    let apart = MAX_SKEW as i32 + 5;
    let [_, _, high, low] = apart.to_be_bytes();
    let mut go = vec![1, 4, 0, 1, 0, 0, high, low];
    go.push(go.iter().fold(0, |sum: u8, b| sum.wrapping_add(*b)));
    let begin = motors(&rig);
    std::fs::OpenOptions::new().write(true).open(rig.serial_path()).unwrap().write_all(&go).unwrap();
    until("the second motor to stand apart", || motors(&rig)[1] > begin[1] + f64::from(apart) - 0.5);
    stand(&rig);
    let apart = motors(&rig);
    let mut axis = Tmcl::open(settings(&rig)).unwrap();
    let error = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(matches!(error, DeviceError::Skew { first: Steps(0), second: Steps(645), limit: MAX_SKEW, .. }), "{error}");
    assert_eq!(motors(&rig).map(f64::to_bits), apart.map(f64::to_bits), "nothing moved");
}

#[test]
fn a_module_that_does_not_answer_between_runs_is_lost() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    axis.check().unwrap();
    rig.faults().serial().drop_answers(u32::MAX);
    let error = axis.check().unwrap_err();
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    rig.faults().serial().drop_answers(0);
    rig.faults().unplug_serial();
    assert!(matches!(axis.check(), Err(DeviceError::Gone { .. })));
}

#[test]
fn stray_bytes_on_either_side_are_got_over_and_the_move_arrives() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    for stray in 1..=9 {
        let target = Steps(100 * stray);
        rig.faults().serial().stray_to_controller(&[0x55; 9][..stray as usize]);
        axis.move_to(target).unwrap_or_else(|e| panic!("{stray} bytes to the module: {e}"));
        rig.faults().serial().stray_to_host(&[0xaa; 9][..stray as usize]);
        axis.move_to(target + Steps(50)).unwrap_or_else(|e| panic!("{stray} bytes to the host: {e}"));
        assert!((turns(&rig) - (target.0 + 50) as f64 / STEPS).abs() < 1e-9);
    }
    // Zeros look like a frame to an address that does not exist.
    rig.faults().serial().stray_to_controller(&[0; 4]);
    axis.move_to(Steps(0)).unwrap();
}

#[test]
fn answers_byte_by_byte_and_in_one_piece_are_the_same_answers() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    rig.faults().serial().split_answers(true);
    assert_eq!(axis.move_to(Steps(801)).unwrap().steps, Steps(801));
}

#[test]
fn a_flipped_bit_that_parses_is_asked_again() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    for bit in [0, 4, 9, 20, 31] {
        // A wrong reading at the beginning of a move, and one at its end.
        rig.faults().serial().rewrite_next(&answer(0), &answer(1 << bit));
        axis.move_to(Steps(800)).unwrap();
        rig.faults().serial().rewrite_next(&answer(1600), &answer(0x640 ^ (1 << bit)));
        axis.move_to(Steps(1600)).unwrap();
        assert!((turns(&rig) - 0.25).abs() < 1e-9);
        axis.move_to(Steps(0)).unwrap();
    }
}

#[test]
fn a_reset_in_the_middle_of_a_move_between_two_and_at_rest_is_a_persons() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(Steps(6400)));
        until("the pair to turn", || turns(&rig) > 0.1);
        rig.faults().reboot_controller();
        let error = moving.join().unwrap().unwrap_err();
        assert!(matches!(error, DeviceError::Intervention { .. }), "{error}");
    });
    assert_eq!(axis.position(), Position::Suspect { epoch: 2 });
    assert_eq!(axis.reference(&CancelToken::new()).unwrap().epoch, 3);
    // After the reset the counter is 0, which is also the expected position.
    let stands = turns(&rig);
    rig.faults().reboot_controller();
    let error = axis.move_to(Steps(320)).unwrap_err();
    let is_told =
        |error: &DeviceError| matches!(error, DeviceError::Intervention { what, .. } if what.contains("reset, but not by carved"));
    assert!(is_told(&error), "{error}");
    for at_rest in [RotationAxis::check, |axis: &mut Tmcl| axis.reference(&CancelToken::new()).map(drop)] {
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
fn steps_that_one_motor_lost_show_when_it_comes_late_to_its_switch() {
    let rig = rig(Settings::default());
    let mut axis = referenced(settings(&rig));
    // So many steps that the second motor still searches when a busy host asks.
    rig.shaft().lose_steps_of(1, 3000);
    // Open loop: the module counts the steps that it has sent.
    axis.move_to(Steps(3200)).unwrap();
    assert!((motors(&rig)[0] - motors(&rig)[1] - 3000.0).abs() < 1e-9);
    let error = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(matches!(error, DeviceError::Skew { limit: MAX_SKEW, .. }), "{error}");
    assert_eq!(axis.position(), Position::Suspect { epoch: 2 });
    stand(&rig);
}

#[test]
fn a_motor_that_begins_late_twists_the_glass_and_both_are_stopped() {
    let rig = rig(Settings::default());
    let mut axis = referenced(here(&rig));
    // At 3200 steps/s the skew would be 1600 steps if the driver did not watch it.
    rig.faults().motors().start_late(1, 0.5);
    let error = axis.move_to(Steps(12_800)).unwrap_err();
    assert!(matches!(error, DeviceError::Skew { limit: MAX_SKEW, .. }), "{error}");
    stand(&rig);
    let [first, second] = motors(&rig);
    assert!(second < first && first < 12_800.0 + 137.0, "{first} and {second}");
}

#[test]
fn a_stall_is_named_and_never_armed_away() {
    let rig = rig(Settings::default());
    let mut axis = referenced(armed(&rig));
    assert!(axis.capabilities().has_stall);
    for motor in [0, 1] {
        rig.faults().motors().stall_after(motor, 800);
    }
    let error = axis.move_to(Steps(1600)).unwrap_err();
    assert!(matches!(&error, DeviceError::Stalled { at: Steps(800), target: Steps(1600), .. }), "{error}");
    let stands = motors(&rig);
    assert_eq!(axis.position(), Position::Suspect { epoch: 2 });
    // The reference arms the stall stop again, which must not continue the old move.
    axis.reference(&CancelToken::new()).unwrap();
    assert_eq!(motors(&rig).map(f64::to_bits), stands.map(f64::to_bits));
    axis.move_to(Steps(100)).unwrap();
}

/// The stalled move is that of another program, or of this one before it was killed.
#[test]
fn a_stalled_move_that_nobody_ended_does_not_go_on_when_the_stall_stop_is_armed() {
    let rig = rig(Settings::default().with(181, 100));
    // A module that is still starting ignores commands, so the driver first waits for it.
    drop(Tmcl::open(armed(&rig)).unwrap());
    for motor in [0_u8, 1] {
        rig.faults().motors().stall_after(motor.into(), 800);
        // Both motors to 1600: the sum of the other bytes of this frame is 0x4b.
        let go = [1, 4, 0, motor, 0, 0, 0x06, 0x40, 0x4b + motor];
        std::fs::OpenOptions::new().write(true).open(rig.serial_path()).unwrap().write_all(&go).unwrap();
    }
    until("both motors to stall", || motors(&rig).iter().all(|at| *at > 936.5));
    stand(&rig);
    let mut axis = referenced(armed(&rig));
    assert_eq!(motors(&rig).map(f64::to_bits), [937.0_f64; 2].map(f64::to_bits));
    axis.move_to(Steps(100)).unwrap();
}

#[test]
fn one_stalled_motor_stops_the_other_before_the_glass_is_twisted_further() {
    let rig = rig(Settings::default());
    let mut axis = referenced(armed(&rig));
    rig.faults().motors().stall_after(1, 300);
    let error = axis.move_to(Steps(64_000)).unwrap_err();
    assert!(matches!(&error, DeviceError::Stalled { motor, at: Steps(300), .. } if motor == "motor 1"), "{error}");
    stand(&rig);
    assert!(motors(&rig)[0] < 32_000.0, "the other stood long before its target");
    // With `here` as reference the pair is still skewed: a person has to free it.
    let error = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(matches!(error, DeviceError::Skew { .. }), "{error}");
}

#[test]
fn a_limit_switch_is_named_with_motor_and_side() {
    let rig = rig(Settings::default());
    let mut axis = referenced(here(&rig));
    for motor in [0, 1] {
        rig.faults().motors().limit_after(motor, 500);
    }
    let error = axis.move_to(Steps(-1600)).unwrap_err();
    assert!(error.to_string().contains("motor 0 stands on its left limit switch, at -500"), "{error}");
}

#[test]
fn a_silent_module_is_named_and_nothing_is_believed() {
    let rig = rig(Settings::default());
    let mut axis = referenced(here(&rig));
    rig.faults().serial().drop_answers(u32::MAX);
    let error = axis.move_to(Steps(320)).unwrap_err();
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    assert_eq!(axis.position(), Position::Suspect { epoch: 2 });
}

#[test]
fn backlash_is_taken_up_by_coming_from_one_side() {
    let rig = rig(Settings::default());
    rig.shaft().set_play(25.0);
    let mut axis = one_sided(Box::new(Tmcl::open(here(&rig)).unwrap()), 30).unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    let zero = rig.shaft().angle_rad();
    for target in [3200, 1600, 4800, 800, 0] {
        assert_eq!(axis.move_to(Steps(target)).unwrap().steps, Steps(target));
        let off = (rig.shaft().angle_rad() - zero) / TAU * STEPS - target as f64;
        assert!(off.abs() < 1e-6, "{target}: {off} steps off");
    }
}
