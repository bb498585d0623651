//! What can be made to go wrong at a motor itself.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Knobs of the motors behind one controller. A fault of a motor acts on its next move and is used up.
#[derive(Debug, Default)]
pub struct MotorFaults {
    next: Mutex<Vec<(usize, Fault)>>,
    hardware_stop: AtomicBool,
    knob_steps: AtomicU32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    /// Something holds the shaft after this many steps.
    Stall { after_steps: u32 },
    /// The motor runs onto its limit switch after this many steps.
    Limit { after_steps: u32 },
    /// The motor begins this much later (rig time).
    Late { by_s: f64 },
}

impl MotorFaults {
    /// Something holds the motor's shaft `steps` into its next move.
    pub fn stall_after(&self, motor: usize, steps: u32) {
        self.lock().push((motor, Fault::Stall { after_steps: steps }));
    }

    /// The motor runs onto a limit switch `steps` into its next move.
    pub fn limit_after(&self, motor: usize, steps: u32) {
        self.lock().push((motor, Fault::Limit { after_steps: steps }));
    }

    /// The motor begins its next move `seconds` of rig time after it was told.
    pub fn start_late(&self, motor: usize, seconds: f64) {
        self.lock().push((motor, Fault::Late { by_s: seconds }));
    }

    /// The hardware emergency stop is pressed or released (Zaber).
    pub fn press_hardware_stop(&self, pressed: bool) {
        self.hardware_stop.store(pressed, Ordering::SeqCst);
    }

    /// Somebody turns the axis by `steps` with the knob of its controller, whatever it is doing (Zaber).
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
