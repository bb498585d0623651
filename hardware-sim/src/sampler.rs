//! The vendor's sampler. It loads the next specimen of its plate, reports it by a wire, and ejects it on request.
//!
//! ```text
//!   waiting ── give ── load_s ──► loaded: line high ── done ── eject_s ──► line low: waiting
//! ```
//! It works in rig time. Its state is brought up to date at each call.

use crate::clock::RigClock;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Durations of the sampler's actions, rig seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplerSettings {
    /// Time to load a specimen.
    pub load_s: f64,
    /// Time to eject a specimen.
    pub eject_s: f64,
    /// Time for which the line bounces after each change.
    pub bounce_s: f64,
}

impl Default for SamplerSettings {
    /// Pumps take seconds. The contact of a relay bounces for milliseconds.
    fn default() -> Self {
        Self { load_s: 3.0, eject_s: 1.5, bounce_s: 0.004 }
    }
}

/// A change of the contents of the capillary.
type Change = Box<dyn FnOnce() + Send>;

/// A specimen on the sampler's plate.
pub struct Next {
    /// Puts the specimen into the capillary.
    pub bring: Change,
    /// Empties the capillary.
    pub take_away: Change,
}

enum Stage {
    Waiting,
    Loading { until_s: f64 },
    Loaded { take_away: Change },
    Ejecting { take_away: Change, until_s: f64 },
}

struct State {
    settings: SamplerSettings,
    stage: Stage,
    plate: Option<Next>,
    /// The level of the line without faults.
    line: bool,
    /// When the line last changed.
    changed_s: f64,
    /// How often the line was read since then.
    looks: u32,
    /// The level that a fault forces.
    forced: Option<bool>,
    ejected: u32,
}

/// The emulated sampler.
pub struct VendorSampler {
    clock: RigClock,
    state: Mutex<State>,
}

impl VendorSampler {
    pub(crate) fn new(clock: RigClock, settings: SamplerSettings) -> Self {
        let state = State {
            settings,
            stage: Stage::Waiting,
            plate: None,
            line: false,
            changed_s: f64::NEG_INFINITY,
            looks: 0,
            forced: None,
            ejected: 0,
        };
        Self { clock, state: Mutex::new(state) }
    }

    /// Puts the next specimen on the plate. It replaces one that is not in the capillary yet, and is loaded when the capillary is empty.
    pub fn give(&self, next: Next) {
        let mut state = self.now();
        state.plate = Some(next);
        state.go_on(self.clock.now_s());
    }

    /// The level of the wire now.
    pub(crate) fn line(&self) -> bool {
        let mut state = self.now();
        state.looks += 1;
        let bounces = self.clock.now_s() < state.changed_s + state.settings.bounce_s;
        // While the contact bounces, every other reading gives the level before the change.
        let line = state.line != (bounces && state.looks.is_multiple_of(2));
        state.forced.unwrap_or(line)
    }

    /// The level of the host's wire "the specimen is done".
    pub(crate) fn done(&self, on: bool) {
        let mut state = self.now();
        let until_s = self.clock.now_s() + state.settings.eject_s;
        state.stage = match std::mem::replace(&mut state.stage, Stage::Waiting) {
            Stage::Loaded { take_away } if on => Stage::Ejecting { take_away, until_s },
            other => other,
        };
    }

    /// Number of specimens that were ejected.
    pub fn ejected(&self) -> u32 {
        self.now().ejected
    }

    // ---- faults

    /// Sets the duration of the load in progress and of all later ones, rig seconds. Infinity means that none is completed.
    pub fn set_load_s(&self, load_s: f64) {
        let mut state = self.now();
        state.settings.load_s = load_s;
        let late = self.clock.now_s() + load_s;
        if let Stage::Loading { until_s } = &mut state.stage {
            *until_s = late;
        }
    }

    /// Forces the level of the wire: stuck (true) or disconnected (false). `None` ends the fault.
    pub fn force_line(&self, level: Option<bool>) {
        self.now().forced = level;
    }

    /// The specimen leaves the capillary by itself.
    pub fn lose_specimen(&self) {
        let mut state = self.now();
        if let Stage::Loaded { take_away } = std::mem::replace(&mut state.stage, Stage::Waiting) {
            take_away();
            state.change(false, self.clock.now_s());
        }
    }

    fn now(&self) -> MutexGuard<'_, State> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.go_on(self.clock.now_s());
        state
    }
}

impl State {
    fn go_on(&mut self, now_s: f64) {
        self.stage = match std::mem::replace(&mut self.stage, Stage::Waiting) {
            Stage::Waiting if self.plate.is_some() => Stage::Loading { until_s: now_s + self.settings.load_s },
            Stage::Loading { until_s } if until_s <= now_s => match self.plate.take() {
                Some(Next { bring, take_away }) => {
                    bring();
                    self.change(true, now_s);
                    Stage::Loaded { take_away }
                }
                None => Stage::Waiting,
            },
            Stage::Ejecting { take_away, until_s } if until_s <= now_s => {
                take_away();
                self.change(false, now_s);
                self.ejected += 1;
                Stage::Waiting
            }
            other => other,
        };
    }

    fn change(&mut self, line: bool, now_s: f64) {
        (self.line, self.changed_s, self.looks) = (line, now_s, 0);
    }
}
