//! An emulated rig for the tests of motion drivers, and what they wait for.
#![allow(dead_code, clippy::unwrap_used)] // each test binary uses its own part; a harness may panic

use hardware_sim::{Controller, Rig, RigSettings, ShaftSettings, TestCard};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Far longer than anything here takes: a condition that is never met fails and does not hang.
const PATIENCE: Duration = Duration::from_secs(60);

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

pub fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !holds() {
        assert!(Instant::now() < deadline, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A refusal may overtake the bytes of its stop on their way through the pty; what they bring about is lasting.
pub fn stand(rig: &Rig) {
    let mut before = f64::NAN;
    until("the shaft to stand", || {
        std::thread::sleep(Duration::from_millis(20));
        let angle = rig.shaft().angle_rad();
        angle.to_bits() == std::mem::replace(&mut before, angle).to_bits()
    });
}
