//! An emulated rig for the tests of motion drivers, and what they wait for.
#![allow(dead_code, unused_imports, clippy::unwrap_used)] // each test binary uses its own part; a harness may panic

#[path = "wait.rs"]
mod wait;
pub use wait::until;

use carved_core::units::Steps;
use carved_devices::{DeviceError, Position, RotationAxis};
use hardware_sim::{Controller, Rig, RigSettings, ShaftSettings, TestCard};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

/// In real time: how far two motors are apart that are told one after the other is a matter of it.
pub fn rig(controller: Controller, steps_per_revolution: (u32, u32)) -> Rig {
    let shaft = ShaftSettings { steps_per_revolution, ..ShaftSettings::default() };
    Rig::start(RigSettings { controller, shaft, ..RigSettings::default() }, Arc::new(TestCard::new(256, 64))).unwrap()
}

/// Where the capillary truly stands, in turns from its index.
pub fn turns(rig: &Rig) -> f64 {
    rig.shaft().angle_rad() / TAU
}

/// Each of the first `bytes` bytes by itself; it is waiting that takes long here, not work.
pub fn at_every_byte(bytes: usize, test: impl Fn(usize) + Sync) {
    const AT_ONCE: usize = 8;
    std::thread::scope(|scope| {
        for first in 1..=AT_ONCE {
            let test = &test;
            scope.spawn(move || (first..=bytes).step_by(AT_ONCE).for_each(test));
        }
    });
}

/// A refusal may overtake the bytes of its stop on their way through the pty; what they bring about is lasting.
pub fn stand(rig: &Rig) {
    until("the shaft to stand", || !rig.shaft().is_turning());
}

/// The cable pulled at each of the first `bytes` bytes that a move hears; `referenced` opens the axis of a rig and references it where
/// it stands.
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

/// Each of the first `answers` answers of a move comes half as late again as a driver waits that waits for 200 ms; moves are `apart` steps.
pub fn late_answers(answers: u32, apart: i64, rig: &Rig, axis: &mut dyn RotationAxis, steps: f64) {
    for late in 0..answers {
        rig.faults().serial().delay_answer_after(late, Duration::from_millis(300));
        let target = Steps(apart * (i64::from(late) + 1));
        assert_eq!(axis.move_to(target).unwrap_or_else(|e| panic!("answer {late}: {e}")).steps, target);
        assert!((turns(rig) - target.0 as f64 / steps).abs() < 1e-9);
    }
}
