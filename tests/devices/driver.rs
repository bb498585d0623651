//! An emulated rig for the tests of motion drivers, and waiting for its state.

pub use crate::common::until;

use carved_core::units::Steps;
use carved_devices::{DeviceError, Position, RotationAxis};
use hardware_sim::{Controller, Rig, RigSettings, ShaftSettings, TestCard};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

/// A rig in real time, because the skew of two motors that start one after the other depends on it.
pub fn rig(controller: Controller, steps_per_revolution: (u32, u32)) -> Rig {
    let shaft = ShaftSettings { steps_per_revolution, ..ShaftSettings::default() };
    Rig::start(RigSettings { controller, shaft, ..RigSettings::default() }, Arc::new(TestCard::new(256, 64))).unwrap()
}

/// True angle of the capillary, in turns from the index.
pub fn turns(rig: &Rig) -> f64 {
    rig.shaft().angle_rad() / TAU
}

/// Runs `test` for each of the first `bytes` bytes, several at once: the cases wait most of their time and compute little.
pub fn at_every_byte(bytes: usize, test: impl Fn(usize) + Sync) {
    const AT_ONCE: usize = 8;
    std::thread::scope(|scope| {
        for first in 1..=AT_ONCE {
            let test = &test;
            scope.spawn(move || (first..=bytes).step_by(AT_ONCE).for_each(test));
        }
    });
}

/// Waits until the shaft stands. A refusal may overtake the bytes of its stop on their way through the pty.
pub fn stand(rig: &Rig) {
    until("the shaft to stand", || !rig.shaft().is_turning());
}

/// Unplugs the cable at each of the first `bytes` bytes that the driver receives during a move. `referenced` opens the axis of a rig and
/// references it where it stands.
pub fn cable_pulled_at_any_byte<A: RotationAxis>(bytes: usize, rig: impl Fn() -> Rig + Sync, referenced: impl Fn(&Rig) -> A + Sync) {
    at_every_byte(bytes, |byte| {
        let rig = rig();
        let mut axis = referenced(&rig);
        rig.faults().serial().unplug_after(byte);
        let error = axis.move_to(Steps(3200)).unwrap_err();
        assert!(matches!(error, DeviceError::Gone { .. }), "byte {byte}: {error}");
        assert_eq!(axis.position(), Position::Suspect { epoch: 2 });
        assert!(matches!(axis.move_to(Steps(0)), Err(DeviceError::Suspect { .. })));
    });
    let rig = rig();
    let axis = referenced(&rig);
    rig.faults().unplug_serial();
    drop(axis);
    rig.faults().replug_serial().unwrap();
    referenced(&rig).move_to(Steps(64)).unwrap();
}

/// Delays each of the first `answers` answers of a move to 300 ms, half as long again as the 200 ms that the driver waits. Each move is
/// `apart` steps longer.
pub fn late_answers(answers: u32, apart: i64, rig: &Rig, axis: &mut dyn RotationAxis, steps: f64) {
    for late in 0..answers {
        rig.faults().serial().delay_answer_after(late, Duration::from_millis(900));
        let target = Steps(apart * (i64::from(late) + 1));
        assert_eq!(axis.move_to(target).unwrap_or_else(|e| panic!("answer {late}: {e}")).steps, target);
        assert!((turns(rig) - target.0 as f64 / steps).abs() < 1e-9);
    }
}
