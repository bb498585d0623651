//! An axis that stops turning when the specimen has left the capillary.
//!
//! ```text
//!   load ──► watch: A01 ──► move_to ─ arrived ─ input? ─ active ──► the view is taken
//!                                                 └─ inactive for debounce_ms ──► the run ends: sampler_failed
//! ```
//! The input is read after each move, so that no view is taken of an empty capillary.

use super::trigger::{POLL, gone};
use crate::clock::Clock;
use crate::{Achieved, Begun, DeviceError, RotationAxis};
use carved_core::units::Steps;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The well whose specimen should be in the capillary. Sampler and axis share it.
#[derive(Clone, Default)]
pub(super) struct Watch(Arc<Mutex<Option<String>>>);

impl Watch {
    pub fn well(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn set(&self, well: Option<&str>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = well.map(str::to_owned);
    }
}

/// The wrapped axis.
pub(super) struct Watched {
    pub axis: Box<dyn RotationAxis>,
    pub watch: Watch,
    pub inverted: bool,
    pub debounce: Duration,
    pub clock: Clock,
}

impl Watched {
    /// One active reading is enough. An inactive input must stay so for `debounce`.
    fn specimen_is_there(&mut self) -> Result<(), DeviceError> {
        let Some(well) = self.watch.well() else { return Ok(()) };
        let until = (self.clock.now)() + self.debounce;
        loop {
            let input = self.axis.specimen_input().ok_or_else(gone)?;
            if input.is_active()? != self.inverted {
                return Ok(());
            }
            if (self.clock.now)() >= until {
                let why = "the specimen left the capillary in mid-turn, or its wire is off: the input became inactive. Check both".into();
                return Err(DeviceError::Sampler { well, why });
            }
            (self.clock.pause)(POLL);
        }
    }
}

impl RotationAxis for Watched {
    forward_axis!(axis: identity, capabilities, begin_run, announce, even_motion, reference, let_go, linear, specimen_input, outputs, check, position, stop_handle);

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let achieved = self.axis.move_to(target)?;
        self.specimen_is_there()?;
        Ok(achieved)
    }

    /// The input is read after the whole turn.
    fn move_evenly(&mut self, target: Steps, steps_per_s: f64, begun: &mut dyn FnMut(Begun)) -> Result<Achieved, DeviceError> {
        let achieved = self.axis.move_evenly(target, steps_per_s, begun)?;
        self.specimen_is_there()?;
        Ok(achieved)
    }
}
