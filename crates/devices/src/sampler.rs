//! Who puts a specimen into the capillary and takes it out again.

mod trigger;
mod watched;

pub use trigger::{TriggerSampler, TriggerSettings};

use super::{DeviceError, RotationAxis};
use crate::cancel::CancelToken;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// What is known of a loaded specimen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Loaded {
    /// Simulation only: what a perfect measurement would find.
    pub truth: Option<serde_json::Value>,
}

/// What the plate map says of a well; a sampler may use it, a plate-loader knows it already.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected<'a> {
    pub well: &'a str,
    /// A bead, or else a larva.
    pub bead: bool,
    /// Days post fertilisation.
    pub dpf: Option<f64>,
}

pub trait Sampler: Send {
    /// Whether `load` waits for somebody outside.
    fn waits_for_loader(&self) -> bool;
    /// Whether a specimen that was taken out can be brought again: whoever brings what lies next on a plate cannot.
    fn brings_again(&self) -> bool;
    /// A new run begins: a capillary that was seen empty before may have been filled since. A run that goes on is no new one.
    fn begin_run(&mut self);
    /// Looks at the wire that says that a specimen is there, while nothing runs; it moves and resets nothing.
    fn look(&mut self, axis: &mut dyn RotationAxis) -> Result<(), DeviceError>;
    /// Whether the looks while nothing runs have found a specimen; nothing where no wire tells, or not for long enough yet.
    fn sees_specimen(&self) -> Option<bool>;
    /// Brings the specimen of a well into the capillary; nothing where the run was cancelled or paused meanwhile. `axis` may have the
    /// wire that says that it is there.
    fn load(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError>;
    /// Goes on with the specimen of a well that was left in the capillary; brings none. Nothing where the run was cancelled meanwhile.
    ///
    /// # Errors
    /// It is not there any more, as far as that can be seen.
    fn go_on(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError>;
    fn eject(&mut self, axis: &mut dyn RotationAxis, well: &str, cancel: &CancelToken) -> Result<(), DeviceError>;
    /// Washes what the specimen of this well was in; of an outside loader that is its own business.
    fn wash(&mut self, axis: &mut dyn RotationAxis, well: &str, cancel: &CancelToken) -> Result<(), DeviceError>;
}

/// What a wait for the loader ends with.
enum Word {
    /// The specimen of this well is in the capillary.
    Loaded(String),
    /// The loader is not waited for any more.
    GiveUp,
}

/// Where the loader's word arrives.
#[derive(Clone, Default)]
pub struct LoaderGate(Arc<(Mutex<Option<Word>>, Condvar)>);

impl LoaderGate {
    /// Forgets a word that an earlier wait left behind: it belongs to another run or another life of this one.
    pub fn clear(&self) {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    pub fn say_loaded(&self, well: &str) {
        self.say(Word::Loaded(well.to_owned()));
    }

    /// Ends a wait that is under way, or the next one: nothing was loaded.
    pub fn give_up(&self) {
        self.say(Word::GiveUp);
    }

    /// Whether the message that this well is loaded was said and not taken yet.
    pub fn has_loaded(&self, well: &str) -> bool {
        matches!(&*self.0.0.lock().unwrap_or_else(PoisonError::into_inner), Some(Word::Loaded(said)) if said == well)
    }

    fn say(&self, word: Word) {
        let (slot, changed) = &*self.0;
        *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(word);
        changed.notify_all();
    }
}

/// The plate-loader fills the capillary and says so.
pub struct LoaderSampler {
    gate: LoaderGate,
}

/// How often a wait looks whether the run was cancelled.
const CANCEL_CHECK: Duration = Duration::from_millis(50);

impl LoaderSampler {
    pub fn new(gate: LoaderGate) -> Self {
        Self { gate }
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
        let (slot, changed) = &*self.gate.0;
        let mut said = slot.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if cancel.is_cancelled() {
                return Ok(None);
            }
            match &*said {
                Some(Word::GiveUp) => return Ok(None),
                Some(Word::Loaded(well)) if well == expected.well => {
                    *said = None;
                    return Ok(Some(Loaded::default()));
                }
                _ => {}
            }
            said = changed.wait_timeout(said, CANCEL_CHECK).unwrap_or_else(PoisonError::into_inner).0;
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
    use crate::sampler::trigger::tests::Wired;

    #[test]
    fn the_word_for_another_well_does_not_count_and_a_cancel_ends_the_wait() {
        let well = |well| Expected { well, bead: false, dpf: None };
        let gate = LoaderGate::default();
        let cancel = CancelToken::default();
        let mut sampler = LoaderSampler::new(gate.clone());
        let mut axis = Wired::default();
        gate.say_loaded("A01");
        assert_eq!(sampler.load(&mut axis, well("A01"), &cancel).unwrap(), Some(Loaded::default()));
        gate.say_loaded("A02");
        gate.clear();
        cancel.cancel();
        assert_eq!(sampler.load(&mut axis, well("A02"), &cancel).unwrap(), None);
    }

    #[test]
    fn a_wait_that_is_given_up_ends_without_a_cancel_and_the_next_run_waits_anew() {
        let gate = LoaderGate::default();
        let mut sampler = LoaderSampler::new(gate.clone());
        let expected = Expected { well: "A01", bead: false, dpf: None };
        gate.give_up();
        assert_eq!(sampler.load(&mut Wired::default(), expected, &CancelToken::default()).unwrap(), None);
        gate.clear();
        gate.say_loaded("A01");
        assert_eq!(sampler.load(&mut Wired::default(), expected, &CancelToken::default()).unwrap(), Some(Loaded::default()));
    }
}
