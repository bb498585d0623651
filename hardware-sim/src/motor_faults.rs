//! Faults that tests can cause at a motor.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Faults of the motors of one controller. Motors are numbered from 0. A fault acts on the next move of its motor, once.
#[derive(Debug, Default)]
pub struct MotorFaults {
    next: Mutex<Vec<(usize, Fault)>>,
    hardware_stop: AtomicBool,
    knob_steps: AtomicU32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    /// The shaft is blocked after this many steps.
    Stall { after_steps: u32 },
    /// The motor runs onto its limit switch after this many steps.
    Limit { after_steps: u32 },
    /// The motor begins this much later, rig seconds.
    Late { by_s: f64 },
}

impl MotorFaults {
    /// The motor is blocked after `steps` steps of its next move.
    pub fn stall_after(&self, motor: usize, steps: u32) {
        self.lock().push((motor, Fault::Stall { after_steps: steps }));
    }

    /// The motor runs onto a limit switch after `steps` steps of its next move.
    pub fn limit_after(&self, motor: usize, steps: u32) {
        self.lock().push((motor, Fault::Limit { after_steps: steps }));
    }

    /// The motor begins its next move `seconds` of rig time after the command.
    pub fn start_late(&self, motor: usize, seconds: f64) {
        self.lock().push((motor, Fault::Late { by_s: seconds }));
    }

    /// Presses or releases the hardware emergency stop (Zaber only).
    pub fn press_hardware_stop(&self, pressed: bool) {
        self.hardware_stop.store(pressed, Ordering::SeqCst);
    }

    /// Turns the axis by `steps` with the knob of its controller, also during a move (Zaber only).
    pub fn turn_knob(&self, steps: u32) {
        self.knob_steps.store(steps, Ordering::SeqCst);
    }

    pub(crate) fn hardware_stop(&self) -> bool {
        self.hardware_stop.load(Ordering::SeqCst)
    }

    pub(crate) fn take_knob_steps(&self) -> Option<i64> {
        Some(self.knob_steps.swap(0, Ordering::SeqCst).into()).filter(|steps| *steps > 0)
    }

    pub(crate) fn take(&self, motor: usize) -> Option<Fault> {
        let mut next = self.lock();
        let at = next.iter().position(|(of, _)| *of == motor)?;
        Some(next.remove(at).1)
    }

    fn lock(&self) -> MutexGuard<'_, Vec<(usize, Fault)>> {
        self.next.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
