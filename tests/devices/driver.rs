//! An emulated rig for the tests of motion drivers, and waiting for its state.

pub use crate::common::until;

use carved_core::units::Steps;
use carved_devices::{Begun, DeviceError, Position, RotationAxis};
use hardware_sim::{Controller, Rig, RigSettings, ShaftSettings, TestCard};
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

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

/// Turns the axis at a constant speed, and compares the true position of the shaft at many times with what the driver said of its beginning.
/// `position` gives the true steps from the reference. Returns what the driver said.
pub fn turns_evenly(axis: &mut dyn RotationAxis, steps_per_s: f64, way: i64, position: impl Fn() -> f64 + Sync) -> Begun {
    let can = axis.even_motion().unwrap();
    assert!(matches!(
        axis.move_evenly(Steps(way), 1.01 * can.fastest_steps_per_s, &mut |_| ()),
        Err(DeviceError::Uneven { fastest: Some(_), .. })
    ));
    axis.move_to(Steps(-way / 4)).unwrap();
    let from = position();
    assert!((from + way as f64 / 4.0).abs() < 0.01 + 0.25, "{from}");
    let seen: Mutex<Vec<(Instant, f64, Instant)>> = Mutex::default();
    let begun: Mutex<Option<Begun>> = Mutex::default();
    let has_arrived = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !has_arrived.load(Ordering::Acquire) {
                let before = Instant::now();
                let at = position();
                seen.lock().unwrap().push((before, at, Instant::now()));
                std::thread::yield_now();
            }
        });
        let arrived = axis.move_evenly(Steps(way), steps_per_s, &mut |at| *begun.lock().unwrap() = Some(at));
        has_arrived.store(true, Ordering::Release);
        assert_eq!(arrived.unwrap().steps, Steps(way));
    });
    assert!((position() - way as f64).abs() < 1e-6);
    let begun = begun.lock().unwrap().unwrap();
    assert!((begun.steps_per_s / steps_per_s - 1.0).abs() < 0.01, "{begun:?}");
    let ramp_s = begun.steps_per_s / begun.acceleration_steps_per_s2;
    // From the first ramp to the last.
    let travelled = |since_s: f64| begun.steps_per_s * (since_s - ramp_s / 2.0);
    let constant_s = (way as f64 - from) / begun.steps_per_s;
    let mut compared = 0;
    for (before, at, after) in seen.into_inner().unwrap() {
        let Some(earliest) = before.checked_duration_since(begun.taken) else { continue };
        let latest = after - begun.sent;
        if earliest.as_secs_f64() < ramp_s || latest.as_secs_f64() > constant_s {
            continue;
        }
        let [least, most] = [earliest, latest].map(|since| from + travelled(since.as_secs_f64()));
        assert!(least - 0.01 <= at && at <= most + 0.01, "{at} steps; {least} to {most} by the driver's word");
        compared += 1;
    }
    assert!(compared > 10, "{compared}");
    begun
}
