//! The digital outputs of the motor controller, and the light at one of them.
//!
//! ```text
//!   firmware ── level ──► Outputs ──► light on or off ──► what the camera sees
//! ```

use crate::scene::Exposure;
use crate::sight::{PixelFormat, Pixels, Sight};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A digital output, as its firmware names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum OutputPin {
    /// Grbl's M7.
    Mist,
    /// Grbl's M8.
    Flood,
    /// Grbl's M3.
    Spindle,
    /// Number of an output of a TMCL module (from 0) or a Zaber controller (from 1).
    Number(u8),
}

#[derive(Debug, Default)]
struct State {
    on: BTreeSet<OutputPin>,
    refused: BTreeSet<OutputPin>,
    switched: Vec<(OutputPin, bool)>,
}

/// The levels of all outputs of one controller. All are off at power-up.
#[derive(Debug, Default)]
pub struct Outputs(Mutex<State>);

impl Outputs {
    /// Whether an output is on.
    pub fn is_on(&self, pin: OutputPin) -> bool {
        self.lock().on.contains(&pin)
    }

    /// Every change of a level since the rig was started, oldest first.
    pub fn switched(&self) -> Vec<(OutputPin, bool)> {
        self.lock().switched.clone()
    }

    /// The firmware refuses to switch this output from now on, or obeys again. M7 of a Grbl that was built without it is such an output.
    pub fn refuse(&self, pin: OutputPin, refuses: bool) {
        let mut state = self.lock();
        if refuses {
            state.refused.insert(pin);
        } else {
            state.refused.remove(&pin);
        }
    }

    pub(crate) fn is_refused(&self, pin: OutputPin) -> bool {
        self.lock().refused.contains(&pin)
    }

    pub(crate) fn set(&self, pin: OutputPin, on: bool) {
        let mut state = self.lock();
        let changed = if on { state.on.insert(pin) } else { state.on.remove(&pin) };
        if changed {
            state.switched.push((pin, on));
        }
    }

    pub(crate) fn all_off(&self) {
        let on: Vec<OutputPin> = self.lock().on.iter().copied().collect();
        for pin in on {
            self.set(pin, false);
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Level of a pixel without light: the offset of the sensor.
const DARK: u8 = 2;

/// What the camera sees by the light at an output: nothing while it is off.
pub(crate) struct Lit {
    pub sight: Arc<dyn Sight>,
    pub outputs: Arc<Outputs>,
    pub light: OutputPin,
}

impl Sight for Lit {
    fn size(&self) -> (u32, u32) {
        self.sight.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        self.look_along(exposure, &|_| exposure.angle_rad, format)
    }

    fn look_along(&self, exposure: &Exposure, path_rad: &dyn Fn(f64) -> f64, format: PixelFormat) -> Pixels {
        if self.outputs.is_on(self.light) {
            return self.sight.look_along(exposure, path_rad, format);
        }
        let (width, height) = self.size();
        Pixels::filled(width, height, format, DARK)
    }
}
