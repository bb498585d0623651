//! Tests of the firmware without a serial port: frames in, frames out.

use super::frame::BYTES;
use super::{Firmware, Settings};
use crate::clock::RigClock;
use crate::motor_faults::MotorFaults;
use crate::outputs::{OutputPin, Outputs};
use crate::serial::Firmware as _;
use crate::shaft::{Shaft, ShaftSettings};
use std::sync::Arc;

/// Later than the end of any move, rig seconds.
const LATER_S: f64 = 1000.0;

struct Module {
    firmware: Firmware,
    shaft: Arc<Shaft>,
    faults: Arc<MotorFaults>,
    outputs: Arc<Outputs>,
}

impl Module {
    fn new(settings: Settings) -> Self {
        let shaft = ShaftSettings { steps_per_revolution: (6400, 1), index_steps: 0, power_on_steps: 0 };
        let shaft = Arc::new(Shaft::new(RigClock::new(1.0), shaft).paired());
        let faults = Arc::new(MotorFaults::default());
        let outputs = Arc::new(Outputs::default());
        Self { firmware: Firmware::new(&shaft, &faults, Arc::clone(&outputs), settings), shaft, faults, outputs }
    }

    fn ask(&mut self, head: [u8; 4], value: i32, now_s: f64) -> (u8, i32) {
        let mut bytes = head.to_vec();
        bytes.extend(value.to_be_bytes());
        bytes.push(bytes.iter().fold(0, |sum: u8, b| sum.wrapping_add(*b)));
        self.firmware.advance(now_s);
        self.firmware.receive(&bytes, now_s);
        let out: [u8; BYTES] = self.firmware.take_output().try_into().unwrap();
        (out[2], i32::from_be_bytes([out[4], out[5], out[6], out[7]]))
    }

    fn get(&mut self, parameter: u8, motor: u8, now_s: f64) -> i32 {
        self.ask([1, 6, parameter, motor], 0, now_s).1
    }

    fn go(&mut self, motor: u8, target: i32, now_s: f64) {
        assert_eq!(self.ask([1, 4, 0, motor], target, now_s), (100, target));
    }
}

#[test]
fn the_published_frame_is_answered_as_published() {
    let mut module = Module::new(Settings::default());
    module.ask([1, 5, 1, 0], 76, 0.0);
    module.firmware.receive(&[1, 6, 1, 0, 0, 0, 0, 0, 8], 0.0);
    assert_eq!(module.firmware.take_output(), [2, 1, 0x64, 6, 0, 0, 0, 0x4c, 0xb9]);
}

#[test]
fn a_half_duplex_module_ignores_a_frame_that_arrives_while_it_answers() {
    for half_duplex in [false, true] {
        let mut module = Module::new(Settings { half_duplex, ..Settings::default() });
        let version = [1, 136, 1, 0, 0, 0, 0, 0, 138];
        module.firmware.receive(&[version, version].concat(), 0.0);
        assert_eq!(module.firmware.take_output().len(), if half_duplex { BYTES } else { 2 * BYTES });
    }
}

#[test]
fn two_motors_turn_the_capillary_and_one_alone_turns_it_half_as_far() {
    let mut module = Module::new(Settings::default());
    module.go(0, 1600, 0.0);
    module.go(1, 1600, 0.0);
    let quarter = std::f64::consts::FRAC_PI_2;
    assert!((module.shaft.angle_at_rad(LATER_S) - quarter).abs() < 1e-12);
    assert_eq!(module.get(1, 0, LATER_S), 1600);
    assert_eq!((module.get(3, 0, LATER_S), module.get(8, 0, LATER_S)), (0, 1));
    module.go(0, 3200, LATER_S);
    assert!((module.shaft.angle_at_rad(2.0 * LATER_S) - 1.5 * quarter).abs() < 1e-12, "the camera sees the mean");
}

#[test]
fn a_stop_brakes_and_leaves_position_reached_at_0() {
    let mut module = Module::new(Settings::default());
    module.go(0, 64_000, 0.0);
    assert_eq!(module.get(3, 0, 1.0), 3200);
    module.ask([1, 3, 0, 0], 0, 1.0);
    let stands = module.get(1, 0, LATER_S);
    // 3200 steps/s for a second less half a ramp of 0.1 s, and a braking ramp of 160 steps.
    assert!((3195..=3205).contains(&stands), "{stands}");
    assert_eq!((module.get(3, 0, LATER_S), module.get(8, 0, LATER_S)), (0, 0));
}

#[test]
fn one_stray_byte_shifts_every_later_frame_until_zeros_complete_a_frame() {
    let mut module = Module::new(Settings::default());
    module.firmware.receive(&[0x55], 0.0);
    for _ in 0..3 {
        assert_eq!(module.ask([1, 6, 1, 0], 0, 0.0).0, 1, "wrong checksum");
    }
    let mut zeros = 0;
    while module.firmware.take_output().is_empty() {
        module.firmware.receive(&[0], 0.0);
        zeros += 1;
    }
    assert_eq!(zeros, 8, "the last byte of a request was left over");
    assert_eq!(module.ask([1, 6, 1, 0], 0, 0.0).0, 100);
}

#[test]
fn a_stall_is_detected_only_if_armed_and_arming_again_restarts_the_move() {
    for armed in [0, 1] {
        let mut module = Module::new(Settings::default().with(181, armed));
        module.faults.stall_after(0, 100);
        module.go(0, 1600, 0.0);
        let (counted, stands) = if armed == 1 { (100, 100) } else { (1600, 100) };
        assert_eq!(module.get(1, 0, LATER_S), counted);
        assert!((module.shaft.angle_at_rad(LATER_S) - module.shaft.steps_to_rad(f64::from(stands) / 2.0)).abs() < 1e-9);
        assert_eq!(module.get(206, 0, LATER_S) == 0, armed == 1);
        module.ask([1, 5, 181, 0], 1, LATER_S);
        assert_eq!(module.get(1, 0, 2.0 * LATER_S), 1600);
    }
}

#[test]
fn a_limit_switch_ends_a_move_and_sets_the_flag_of_its_side() {
    let mut module = Module::new(Settings::default());
    module.faults.limit_after(1, 300);
    module.go(1, -1600, 0.0);
    assert_eq!(module.get(1, 1, LATER_S), -300);
    assert_eq!((module.get(10, 1, LATER_S), module.get(11, 1, LATER_S)), (0, 1));
    module.go(1, 0, LATER_S);
    assert_eq!(module.get(11, 1, 2.0 * LATER_S), 0);
}

#[test]
fn the_reference_search_counts_from_the_switch() {
    let mut module = Module::new(Settings::default());
    module.go(0, 100, 0.0);
    module.ask([1, 13, 0, 0], 0, LATER_S);
    assert_eq!(module.ask([1, 13, 2, 0], 0, LATER_S).1, 1);
    assert_eq!(module.ask([1, 13, 2, 0], 0, 2.0 * LATER_S).1, 0);
    assert_eq!(module.get(1, 0, 2.0 * LATER_S), 0);
}

#[test]
fn a_reset_is_silent_and_forgets_counters_and_variables() {
    let mut module = Module::new(Settings::default());
    module.go(0, 1600, 0.0);
    module.ask([1, 9, 55, 2], 7, LATER_S);
    assert_eq!(module.ask([1, 10, 55, 2], 0, LATER_S), (100, 7));
    let reset = [1, 255, 0, 0, 0, 0, 0x04, 0xd2, 0xd6];
    module.firmware.receive(&reset, LATER_S);
    assert!(module.firmware.take_output().is_empty());
    assert_eq!((module.get(1, 0, LATER_S), module.ask([1, 10, 55, 2], 0, LATER_S).1), (0, 0));
}

#[test]
fn unknown_commands_are_refused_by_status() {
    let mut module = Module::new(Settings::default());
    assert_eq!(module.ask([1, 77, 0, 0], 0, 0.0).0, 2);
    assert_eq!(module.ask([1, 6, 99, 0], 0, 0.0).0, 3);
    assert_eq!(module.ask([1, 6, 1, 5], 0, 0.0).0, 4);
    module.firmware.receive(&[0; 9], 0.0);
    assert!(module.firmware.take_output().is_empty(), "nine zeros address no module");
}

#[test]
fn outputs_are_switched_and_read_in_bank_2_and_a_reset_switches_them_off() {
    let mut module = Module::new(Settings::default());
    assert_eq!(module.ask([1, 14, 3, 2], 1, 0.0), (100, 1));
    assert_eq!((module.ask([1, 15, 3, 2], 0, 0.0), module.ask([1, 15, 4, 2], 0, 0.0)), ((100, 1), (100, 0)));
    assert!(module.outputs.is_on(OutputPin::Number(3)));
    assert_eq!((module.ask([1, 14, 8, 2], 1, 0.0).0, module.ask([1, 14, 0, 0], 1, 0.0).0), (3, 3), "neither port nor bank");
    assert_eq!(module.ask([1, 14, 0, 2], 2, 0.0).0, 4);
    module.outputs.refuse(OutputPin::Number(0), true);
    assert_eq!(module.ask([1, 14, 0, 2], 1, 0.0).0, 4);
    module.firmware.lose_power(0.0);
    assert_eq!(module.outputs.switched(), [(OutputPin::Number(3), true), (OutputPin::Number(3), false)]);
}
