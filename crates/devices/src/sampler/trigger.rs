//! A sampler that tells by a wire whether a specimen is in the capillary.
//!
//! ```text
//!            load                        turn                     eject
//!  input ────┐  bounces  ┌───────────────────────────────────────────────┐ bounces ┌────
//!            └ empty? ───┘ there for debounce_ms      never gone         │  gone   └
//!  done ─────────────────────────────────────────────────────────────────┘▔▔▔▔▔▔▔▔▔┘        (done_output)
//! ```
//! An arrival counts only if the capillary was seen empty after the last specimen of this run. A specimen that nobody asked for
//! belongs to no known well. A specimen that comes after its load was cut short, also by a restart, is that of the same well, which
//! is loaded next. While nothing runs the daemon reads the input once a second and reports a specimen that comes in.
//!
//! ```text
//! run held, its specimen inside ── look, once a second ──► always there ────────────────────────► go_on: the same specimen
//!                                                     └──► empty for debounce_ms, then there ──► go_on: refused
//! ```

use super::watched::{Watch, Watched};
use super::{Expected, Loaded, Sampler};
use crate::cancel::CancelToken;
use crate::clock::Clock;
use crate::setting::in_range;
use crate::{DeviceError, RotationAxis};
use carved_core::range::{Range, Ranged};
use carved_core::ranges;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// The `[sampler]` table of `driver = "trigger"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct TriggerSettings {
    /// Whether the input is active while the capillary is empty. With `false` it is active while a specimen is there: a pulled wire then
    /// says that none is.
    pub inverted: bool,
    /// Time for which the input must be stable, ms.
    pub debounce_ms: u32,
    /// Longest wait for a specimen, ms. At least four times `debounce_ms`.
    pub load_timeout_ms: u32,
    /// Longest wait for an empty capillary, ms. At least four times `debounce_ms`.
    pub eject_timeout_ms: u32,
    /// Whether the controller's output is switched on when a specimen is done, until it has left.
    pub done_output: bool,
}

impl Default for TriggerSettings {
    fn default() -> Self {
        Self { inverted: false, debounce_ms: 50, load_timeout_ms: 120_000, eject_timeout_ms: 30_000, done_output: false }
    }
}

/// Longest wait that is meant, ms: a day.
const WAIT_MOST_MS: f64 = 86_400_000.0;

impl Ranged for TriggerSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        debounce_ms: 1.0, 10_000.0, "ms";
        load_timeout_ms: 4.0, WAIT_MOST_MS, "ms";
        eject_timeout_ms: 4.0, WAIT_MOST_MS, "ms";
    ];
}

impl TriggerSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        in_range("sampler", self)?;
        let least = self.debounce_ms * BOUNCES;
        for (name, found) in [("load_timeout_ms", self.load_timeout_ms), ("eject_timeout_ms", self.eject_timeout_ms)] {
            if found < least {
                let (name, found) = (name.into(), found.to_string());
                let rule = format!("it must be at least {least}, {BOUNCES} times debounce_ms");
                return Err(DeviceError::Setting { device: "sampler", name, found, rule });
            }
        }
        Ok(())
    }

    fn debounce(&self) -> Duration {
        Duration::from_millis(self.debounce_ms.into())
    }
}

/// Pause between two readings of the input during a wait.
pub(super) const POLL: Duration = Duration::from_millis(5);
/// Time in which an input that bounces must become stable, in units of `debounce_ms`.
const BOUNCES: u32 = 4;

/// How a wait for the input has ended.
enum Waited {
    Reached,
    TimedOut,
    Cancelled,
}

/// What the looks have found since the last load.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Visitor {
    None,
    /// A specimen.
    Came,
    /// A specimen, and then none. One that is there now may be another one.
    Left,
}

/// Whose specimen is in the capillary, if the input says that one is there before a load waits for it.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Arrival {
    /// Nobody's: the capillary was not seen empty.
    Unknown,
    /// That of the next load: the capillary was seen empty after the last specimen of this run.
    Next,
    /// That of this well: its load was cut short.
    Of(String),
}

/// A sampler with a wire to the axis' controller. "Looks" are the readings of the input while nothing runs.
pub struct TriggerSampler {
    settings: TriggerSettings,
    clock: Clock,
    watch: Watch,
    arrival: Arrival,
    visitor: Visitor,
    /// Since when every look has found a specimen.
    there_since: Option<Instant>,
    /// Since when every look has found none.
    gone_since: Option<Instant>,
    /// The looks have found the capillary empty since its last specimen came. A specimen that is there now may be another one.
    left: bool,
    /// The result of the looks.
    seen: Option<bool>,
}

impl TriggerSampler {
    /// Takes the axis whose controller has the wires. The axis that it returns checks after each move that the specimen is still
    /// there.
    ///
    /// # Errors
    /// A bad setting, or a controller that has no such input.
    pub fn beside(axis: Box<dyn RotationAxis>, settings: TriggerSettings) -> Result<(Self, Box<dyn RotationAxis>), DeviceError> {
        Self::with_clock(axis, settings, Clock::REAL)
    }

    fn with_clock(
        mut axis: Box<dyn RotationAxis>,
        settings: TriggerSettings,
        clock: Clock,
    ) -> Result<(Self, Box<dyn RotationAxis>), DeviceError> {
        settings.check()?;
        if axis.specimen_input().is_none() {
            let rule = format!("{} has no input for it: take \"loader\"", axis.identity());
            return Err(DeviceError::Setting { device: "sampler", name: "driver".into(), found: "\"trigger\"".into(), rule });
        }
        let watch = Watch::default();
        let watched = Watched { axis, watch: watch.clone(), inverted: settings.inverted, debounce: settings.debounce(), clock };
        let sampler = Self {
            settings,
            clock,
            watch,
            arrival: Arrival::Unknown,
            visitor: Visitor::None,
            there_since: None,
            gone_since: None,
            left: false,
            seen: None,
        };
        Ok((sampler, Box::new(watched)))
    }

    /// Waits until the input has been stable at `there` for `debounce_ms`.
    fn wait_for(
        &self,
        there: bool,
        axis: &mut dyn RotationAxis,
        within_ms: u32,
        cancel: Option<&CancelToken>,
    ) -> Result<Waited, DeviceError> {
        let until = (self.clock.now)() + Duration::from_millis(within_ms.into());
        let mut since: Option<Instant> = None;
        loop {
            if cancel.is_some_and(CancelToken::is_cancelled) {
                return Ok(Waited::Cancelled);
            }
            let says_so = (axis.specimen_input().ok_or_else(gone)?.is_active()? != self.settings.inverted) == there;
            let now = (self.clock.now)();
            since = says_so.then(|| since.unwrap_or(now));
            match since {
                Some(since) if now.duration_since(since) >= self.settings.debounce() => return Ok(Waited::Reached),
                None if now >= until => return Ok(Waited::TimedOut),
                // An input that changed before the timeout may still become stable.
                _ => (self.clock.pause)(POLL),
            }
        }
    }

    fn say_done(&self, axis: &mut dyn RotationAxis, done: bool) -> Result<(), DeviceError> {
        if self.settings.done_output { axis.specimen_input().ok_or_else(gone)?.say_done(done) } else { Ok(()) }
    }

    fn failed(well: &str, why: String) -> DeviceError {
        DeviceError::Sampler { well: well.to_owned(), why }
    }
}

/// The driver that had the input was closed.
pub(super) fn gone() -> DeviceError {
    DeviceError::Gone { device: "rotation axis", why: "the sampler's wire ends at it".into() }
}

impl Sampler for TriggerSampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    fn brings_again(&self) -> bool {
        false
    }

    fn begin_run(&mut self) {
        (self.arrival, self.visitor) = (Arrival::Unknown, Visitor::None);
        (self.there_since, self.gone_since, self.left, self.seen) = (None, None, false, None);
    }

    fn look(&mut self, axis: &mut dyn RotationAxis) -> Result<(), DeviceError> {
        let Some(active) = axis.specimen_input().ok_or_else(gone)?.is_active_at_rest()? else { return Ok(()) };
        if active == self.settings.inverted {
            (self.there_since, self.seen) = (None, Some(false));
            let gone_since = *self.gone_since.get_or_insert_with(self.clock.now);
            if self.clock.since(gone_since) >= self.settings.debounce() {
                self.left = true;
                if self.visitor == Visitor::Came {
                    self.visitor = Visitor::Left;
                }
            }
            return Ok(());
        }
        self.gone_since = None;
        let there_since = *self.there_since.get_or_insert_with(self.clock.now);
        if self.clock.since(there_since) >= self.settings.debounce() {
            self.seen = Some(true);
            if self.visitor == Visitor::None {
                self.visitor = Visitor::Came;
            }
        }
        Ok(())
    }

    fn has_sensor(&self) -> bool {
        true
    }

    fn sees_specimen(&self) -> Option<bool> {
        self.seen
    }

    fn load(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let well = expected.well;
        // Before anything that can fail: the next load of this well is not told again.
        if expected.asked_before {
            self.arrival = Arrival::Of(well.to_owned());
        }
        axis.specimen_input().ok_or_else(gone)?.begin(cancel)?;
        if let Some(left) = self.watch.well() {
            // A stop prevented its ejection.
            self.eject(axis, &left, cancel)?;
        }
        let counts = match std::mem::replace(&mut self.arrival, Arrival::Unknown) {
            Arrival::Unknown => false,
            Arrival::Next => true,
            // Somebody may have taken out the specimen of another well, or it is still on its way.
            Arrival::Of(asked) => asked == well,
        } && self.visitor != Visitor::Left;
        if !counts {
            match self.wait_for(false, axis, BOUNCES * self.settings.debounce_ms, Some(cancel))? {
                Waited::Reached => {}
                Waited::Cancelled => return Ok(None),
                Waited::TimedOut => {
                    let why = "the input says that a specimen is there, but none was asked for, and its well is not known. Nothing was \
                               loaded. Empty the capillary. If it is empty, the input is stuck: check the wire";
                    return Err(Self::failed(well, why.into()));
                }
            }
        }
        let waited = self.wait_for(true, axis, self.settings.load_timeout_ms, Some(cancel));
        // Whatever else ended the wait, the specimen is still on its way. If it comes before the next load, it is that of this well.
        self.visitor = Visitor::None;
        if !matches!(waited, Ok(Waited::Reached | Waited::TimedOut)) {
            self.arrival = Arrival::Of(well.to_owned());
        }
        match waited? {
            Waited::Cancelled => Ok(None),
            Waited::TimedOut => {
                let why = format!(
                    "no specimen within {} ms (load_timeout_ms). Check the sampler, its plate and the wire of its input",
                    self.settings.load_timeout_ms
                );
                Err(Self::failed(well, why))
            }
            Waited::Reached => {
                self.left = false;
                self.watch.set(Some(well));
                Ok(Some(Loaded::default()))
            }
        }
    }

    fn go_on(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let well = expected.well;
        axis.specimen_input().ok_or_else(gone)?.begin(cancel)?;
        if self.left {
            let why = "its specimen was left in the capillary. Meanwhile the input said that the capillary was empty, so the specimen that \
                       is there now may be another one. Empty the capillary, then tell the instrument that the specimen is out";
            return Err(Self::failed(well, why.into()));
        }
        match self.wait_for(true, axis, BOUNCES * self.settings.debounce_ms, Some(cancel))? {
            Waited::Cancelled => Ok(None),
            Waited::TimedOut => {
                let why = "its specimen was left in the capillary, and the input says that it is not there any more. If it is out, tell \
                           the instrument so. If it is still inside, check the wire";
                Err(Self::failed(well, why.into()))
            }
            Waited::Reached => {
                self.arrival = Arrival::Unknown;
                self.watch.set(Some(well));
                Ok(Some(Loaded::default()))
            }
        }
    }

    fn eject(&mut self, axis: &mut dyn RotationAxis, well: &str, cancel: &CancelToken) -> Result<(), DeviceError> {
        // After a fault, which has stopped the axis, the specimen is ejected. After a cancellation nothing moves any more.
        axis.specimen_input().ok_or_else(gone)?.begin(cancel)?;
        let waited = self.say_done(axis, true).and_then(|()| self.wait_for(false, axis, self.settings.eject_timeout_ms, None));
        // Also after an error: the sampler would take the next specimen for one that is done.
        let switched_off = self.say_done(axis, false);
        let waited = waited?;
        switched_off?;
        if matches!(waited, Waited::TimedOut) {
            let why = format!(
                "the input still says that the specimen is there, {} ms (eject_timeout_ms) after it was done. Check whether the \
                 capillary is empty: the sampler has not ejected it, or the input is stuck",
                self.settings.eject_timeout_ms
            );
            return Err(Self::failed(well, why));
        }
        self.watch.set(None);
        (self.arrival, self.visitor) = (Arrival::Next, Visitor::None);
        Ok(())
    }
    fn wash(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
}

#[cfg(test)]
#[path = "trigger_tests.rs"]
mod tests;
