//! Samplers: they put a specimen into the capillary and take it out again.
//!
//! ```text
//! worker ── load, go_on, eject ──► Sampler ─┬─ LoaderSampler    waits for a message: plate-loader ── HTTP ──► LoaderInterlock
//!                                           └─ TriggerSampler   waits for a wire:    sampler ── SpecimenInput of the axis
//! ```

mod trigger;
mod watched;

pub use trigger::{TriggerSampler, TriggerSettings};

use super::{DeviceError, RotationAxis};
use crate::cancel::CancelToken;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// What is known about a loaded specimen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Loaded {
    /// The result of a perfect measurement; simulation only.
    pub truth: Option<serde_json::Value>,
}

/// What the plate map says about a well. A sampler may use it. A plate-loader knows it already.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected<'a> {
    /// Name of the well, such as `A01`.
    pub well: &'a str,
    /// Whether the specimen is a bead; otherwise it is a larva.
    pub bead: bool,
    /// Days post fertilisation, if the plate map says it.
    pub dpf: Option<f64>,
    /// The sampler was asked for this specimen before its load was cut short. It may be in the capillary already.
    pub asked_before: bool,
}

/// The wells of a run that have not begun.
#[derive(Debug, Clone, Copy)]
pub struct Upcoming<'a> {
    /// Name of the run.
    pub run: &'a str,
    /// Barcode of the plate.
    pub plate: &'a str,
    /// The wells in the order of the plan. There is at least one.
    pub wells: &'a [Expected<'a>],
}

/// Which well comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextWell {
    /// The well at this position of [`Upcoming::wells`].
    At(usize),
    /// None of them comes any more.
    NoMore,
    /// The wait was ended from outside.
    Cancelled,
}

/// Brings specimens into the capillary and takes them out. A wrapper passes on all that it does not do itself, also what has a default:
/// [`forward_sampler`](crate::forward_sampler).
pub trait Sampler: Send {
    /// Whether `load` waits for a message from outside.
    fn waits_for_loader(&self) -> bool;
    /// Whether a specimen that was taken out can be brought again. A sampler that brings the next specimen of a plate cannot.
    fn brings_again(&self) -> bool;
    /// A new run begins. What was seen before says nothing about the capillary now. A run that continues is not a new run.
    fn begin_run(&mut self);
    /// Reads the specimen input while nothing runs. Nothing is moved or reset.
    ///
    /// # Errors
    /// The input cannot be read.
    fn look(&mut self, axis: &mut dyn RotationAxis) -> Result<(), DeviceError>;
    /// Whether it has an input that shows a specimen while nothing runs.
    fn has_sensor(&self) -> bool {
        false
    }
    /// Whether [`Self::look`] has found a specimen. `None` without such an input, or before it was read for long enough.
    fn sees_specimen(&self) -> Option<bool>;
    /// Waits until it is known which well comes next. A sampler that does not decide this says the first. `is_ended` tells whether the
    /// wait is still wanted.
    ///
    /// # Errors
    /// It cannot be known.
    fn next_well(&mut self, _upcoming: &Upcoming<'_>, _is_ended: &dyn Fn() -> bool) -> Result<NextWell, DeviceError> {
        Ok(NextWell::At(0))
    }
    /// Brings the specimen of a well into the capillary. `None` if the run was cancelled or paused meanwhile. `axis` may have the
    /// specimen input.
    ///
    /// # Errors
    /// No specimen came, or one that nobody asked for is there.
    fn load(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError>;
    /// Continues with the specimen of a well that was left in the capillary. It brings none. `None` if the run was cancelled meanwhile.
    ///
    /// # Errors
    /// The specimen is not there any more, or may have been exchanged, as far as the sampler can see.
    fn go_on(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError>;
    /// Takes the specimen of a well out of the capillary.
    ///
    /// # Errors
    /// It did not leave, as far as the sampler can see.
    fn eject(&mut self, axis: &mut dyn RotationAxis, well: &str, cancel: &CancelToken) -> Result<(), DeviceError>;
    /// Washes the capillary after the specimen of this well. An external loader does that by itself.
    ///
    /// # Errors
    /// The washing failed.
    fn wash(&mut self, axis: &mut dyn RotationAxis, well: &str, cancel: &CancelToken) -> Result<(), DeviceError>;
}

/// What ends a wait for the loader.
enum LoaderMessage {
    /// The specimen of this well is in the capillary.
    Loaded(String),
    /// The wait ends without a specimen.
    GiveUp,
}

/// The place where the loader's message arrives. It holds the newest message until a wait takes it.
#[derive(Clone, Default)]
pub struct LoaderInterlock(Arc<(Mutex<Option<LoaderMessage>>, Condvar)>);

impl LoaderInterlock {
    /// Drops a message that an earlier wait left. It belongs to another run, or to this run before it was held.
    pub fn clear(&self) {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// The specimen of this well is in the capillary.
    pub fn say_loaded(&self, well: &str) {
        self.send(LoaderMessage::Loaded(well.to_owned()));
    }

    /// Ends the current wait, or else the next one, without a specimen.
    pub fn give_up(&self) {
        self.send(LoaderMessage::GiveUp);
    }

    /// Whether the message that this well is loaded has arrived and was not taken yet.
    #[cfg(feature = "testing")]
    pub fn has_loaded(&self, well: &str) -> bool {
        matches!(&*self.0.0.lock().unwrap_or_else(PoisonError::into_inner), Some(LoaderMessage::Loaded(loaded)) if loaded == well)
    }

    fn send(&self, message: LoaderMessage) {
        let (slot, changed) = &*self.0;
        *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(message);
        changed.notify_all();
    }
}

/// A sampler that waits for the plate-loader's message.
pub struct LoaderSampler {
    interlock: LoaderInterlock,
}

/// How often a wait checks whether the run was cancelled.
const CANCEL_CHECK: Duration = Duration::from_millis(50);

impl LoaderSampler {
    /// A sampler that waits for messages at `interlock`.
    pub fn new(interlock: LoaderInterlock) -> Self {
        Self { interlock }
    }
}

impl Sampler for LoaderSampler {
    fn waits_for_loader(&self) -> bool {
        true
    }

    fn brings_again(&self) -> bool {
        true
    }

    fn begin_run(&mut self) {}

    fn look(&mut self, _axis: &mut dyn RotationAxis) -> Result<(), DeviceError> {
        Ok(())
    }

    fn sees_specimen(&self) -> Option<bool> {
        None
    }

    fn load(&mut self, _axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let (slot, changed) = &*self.interlock.0;
        let mut message = slot.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if cancel.is_cancelled() {
                return Ok(None);
            }
            match &*message {
                Some(LoaderMessage::GiveUp) => return Ok(None),
                Some(LoaderMessage::Loaded(well)) if well == expected.well => {
                    *message = None;
                    return Ok(Some(Loaded::default()));
                }
                _ => {}
            }
            message = changed.wait_timeout(message, CANCEL_CHECK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn go_on(
        &mut self,
        _axis: &mut dyn RotationAxis,
        _expected: Expected<'_>,
        _cancel: &CancelToken,
    ) -> Result<Option<Loaded>, DeviceError> {
        Ok(Some(Loaded::default()))
    }

    fn eject(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
    fn wash(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::FakeAxis;

    #[test]
    fn a_message_for_another_well_does_not_count_and_a_cancel_ends_the_wait() {
        let well = |well| Expected { well, bead: false, dpf: None, asked_before: false };
        let interlock = LoaderInterlock::default();
        let cancel = CancelToken::default();
        let mut sampler = LoaderSampler::new(interlock.clone());
        let mut axis = FakeAxis::new();
        interlock.say_loaded("A01");
        assert_eq!(sampler.load(&mut axis, well("A01"), &cancel).unwrap(), Some(Loaded::default()));
        interlock.say_loaded("A02");
        interlock.clear();
        cancel.cancel();
        assert_eq!(sampler.load(&mut axis, well("A02"), &cancel).unwrap(), None);
    }

    #[test]
    fn a_wait_that_is_given_up_ends_without_a_cancel_and_the_next_run_waits_anew() {
        let interlock = LoaderInterlock::default();
        let mut sampler = LoaderSampler::new(interlock.clone());
        let expected = Expected { well: "A01", bead: false, dpf: None, asked_before: false };
        interlock.give_up();
        assert_eq!(sampler.load(&mut FakeAxis::new(), expected, &CancelToken::default()).unwrap(), None);
        interlock.clear();
        interlock.say_loaded("A01");
        assert_eq!(sampler.load(&mut FakeAxis::new(), expected, &CancelToken::default()).unwrap(), Some(Loaded::default()));
    }
}
