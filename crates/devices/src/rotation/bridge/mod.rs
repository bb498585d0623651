//! Driver for a stock VAST BioImager behind its trigger bridge, an Arduino between two of VAST's connectors.
//!
//! ```text
//!  announce ──► external.txt ··· a person loads it into VAST's program, once per change
//!           ··· VAST takes up a specimen ···································► R1   reference: at the first stop
//!  move_to(next) ──► TT ── OK ······························· turns ·········► R1   at the next stop
//!  let_go ──► TT ... ──► TT ── OK ·· end of the list: VAST continues with its own program
//! ```
//! VAST does not report its position. It cannot be stopped, and can only go to the next entry of its list. Its angle is known from
//! the list, as long as exactly one arrival follows each trigger within the time limits of the turn. An arrival without a trigger,
//! and a missing arrival, make the position suspect. A trigger is never repeated, because VAST may have received it. A stop ends the
//! triggers, and VAST finishes its step.
//!
//! Nothing is known of the direction in which VAST goes from 342,72 deg to 0,00 deg. Both ways lead to the same view, so the time limits
//! of such a step allow both.

mod dialogue;
mod entry;
mod list;
pub(super) mod message;
mod settings;

pub(super) use entry::ENTRY;
pub use settings::VastBridgeSettings;

use super::knowledge::Knowledge;
use crate::cancel::CancelToken;
use crate::{Achieved, Capabilities, DeviceError, Position, RotationAxis, StopHandle};
use carved_core::units::{Steps, StepsPerRevolution};
use dialogue::{Dialogue, out_of_step};
use std::time::{Duration, Instant};

const DEVICE: &str = "rotation axis (VAST trigger bridge)";

/// The list that VAST goes by. It is not known before a person has been asked to load one.
#[derive(Debug, PartialEq, Eq)]
enum ListInVast {
    Unknown,
    /// A person was asked to load this text.
    Asked(String),
    /// A person has loaded this text.
    Loaded(String),
}

/// The rotation of a VAST that steps through a list.
pub struct VastBridge {
    dialogue: Dialogue,
    settings: VastBridgeSettings,
    per_revolution: StepsPerRevolution,
    hundredths_per_step: i64,
    identity: String,
    stops: Vec<Steps>,
    in_vast: ListInVast,
    /// Unknown while VAST is not within a list, or before its first stop.
    knowledge: Knowledge,
    /// Index of the present stop, if the position is known.
    stop: usize,
    /// Latest time for the arrival after the last trigger.
    due: Instant,
}

impl VastBridge {
    /// Opens the port and asks the bridge for its settings. Nothing moves.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a bridge that does not answer.
    pub fn open(settings: VastBridgeSettings, per_revolution: StepsPerRevolution) -> Result<Self, DeviceError> {
        settings.check(per_revolution)?;
        let hundredths_per_step = list::hundredths_per_step(per_revolution)?;
        let dialogue = Dialogue::open(&settings)?;
        let mut bridge = Self {
            dialogue,
            settings,
            per_revolution,
            hundredths_per_step,
            identity: String::new(),
            stops: Vec::new(),
            in_vast: ListInVast::Unknown,
            knowledge: Knowledge::none_of("rotation axis"),
            stop: 0,
            due: Instant::now(),
        };
        let answer = bridge.dialogue.greet().map_err(|error| bridge.dialogue.first_contact(error))?;
        bridge.identity = format!("VAST trigger bridge ({})", answer.join(", "));
        tracing::info!(identity = bridge.identity, port = %bridge.settings.port, "rotation axis opened");
        Ok(bridge)
    }

    /// Steps to the next stop.
    fn step(&mut self) -> Result<Achieved, DeviceError> {
        let next = self.stops[self.stop + 1];
        let [shortest_deg, longest_deg] = self.ways_deg(self.stops[self.stop], next);
        let pace = self.settings.pace();
        self.due = Instant::now() + pace.longest(longest_deg);
        let since = self.dialogue.trigger()?;
        self.dialogue.arrive(since, pace.shortest(shortest_deg), pace.longest(longest_deg))?;
        self.stop += 1;
        Ok(self.knowledge.arrived(next))
    }

    /// The shortest and the longest way that VAST may go between two stops of its list.
    fn ways_deg(&self, from: Steps, to: Steps) -> [f64; 2] {
        let within_turn = |at: Steps| self.per_revolution.angle(at).to_degrees().rem_euclid(360.0);
        let difference = within_turn(to) - within_turn(from);
        let (way, other_way) = (difference.abs(), 360.0 - difference.abs());
        // Towards a smaller position it may go back, or on through 360 deg.
        [way.min(other_way), if difference > 0.0 { way } else { way.max(other_way) }]
    }

    /// Waits until VAST is at the first stop.
    fn take_up(&mut self) -> Result<Steps, DeviceError> {
        let Some(first) = self.stops.first().copied() else {
            return Err(out_of_step("no list has been announced, so VAST has no list to follow"));
        };
        if self.knowledge.is_known() || self.knowledge.is_suspect() {
            self.discard_old_state()?;
        }
        self.dialogue.listen()?;
        self.dialogue.greet()?;
        match std::mem::take(&mut self.dialogue.arrivals) {
            0 => self.dialogue.arrive(Instant::now(), Duration::ZERO, self.settings.first_arrival_timeout())?,
            1 => {}
            many => return Err(out_of_step(&format!("VAST reported {many} arrivals for one specimen and no trigger"))),
        }
        Ok(first)
    }

    /// Writes the list, and lets a person load it into VAST's program, unless VAST has it already.
    fn put_list(&mut self, stops: &[Steps]) -> Result<(), DeviceError> {
        let path = self.settings.list.clone();
        let text = list::text(stops, self.hundredths_per_step, &self.settings);
        let unusable = |e: std::io::Error| DeviceError::List { device: DEVICE, path: path.clone(), why: e.to_string() };
        let is_there = list::is(&path, &text).map_err(unusable)?;
        let stopped = self.dialogue.is_stopped();
        if is_there && self.stops == stops && !stopped && self.knowledge.is_known() {
            return Ok(());
        }
        if stopped || self.knowledge.is_known() || self.knowledge.is_suspect() {
            self.discard_old_state()?;
        }
        if !is_there {
            if !stopped {
                self.dialogue.listen()?;
            }
            if std::mem::take(&mut self.dialogue.arrivals) > 0 {
                return Err(out_of_step("VAST was in position before its list was written, so it goes by another"));
            }
            list::write(&path, &text).map_err(unusable)?;
            self.in_vast = ListInVast::Unknown;
            tracing::info!(stops = stops.len(), list = %path.display(), "VAST's list written");
        }
        self.have_loaded(text)
    }

    /// Asks a person to load the list. Whoever announces the same list again has the person's word that it is loaded.
    fn have_loaded(&mut self, text: String) -> Result<(), DeviceError> {
        match &self.in_vast {
            ListInVast::Loaded(loaded) if *loaded == text => Ok(()),
            ListInVast::Asked(asked) if *asked == text => {
                self.in_vast = ListInVast::Loaded(text);
                Ok(())
            }
            _ => {
                self.in_vast = ListInVast::Asked(text);
                Err(DeviceError::VastList { path: self.settings.list.clone() })
            }
        }
    }

    /// Drops what the bridge has sent before. After a stop or a fault a person ends VAST's list. An arrival after the last trigger may
    /// still come. It is waited for, because it would count as the arrival of the next specimen.
    fn discard_old_state(&mut self) -> Result<(), DeviceError> {
        let still_due = self.due.saturating_duration_since(Instant::now());
        self.dialogue.forget(still_due)?;
        self.knowledge.forget();
        Ok(())
    }

    /// Steps through the rest of the list, and beyond its end.
    fn finish(&mut self) -> Result<(), DeviceError> {
        if !self.knowledge.is_known() {
            return Ok(());
        }
        while self.stop + 1 < self.stops.len() {
            self.step()?;
        }
        if self.settings.end_with_trigger {
            self.dialogue.trigger()?;
        }
        self.knowledge.forget();
        self.dialogue.arrivals = 0;
        Ok(())
    }

    fn unless_doubtful<T>(&mut self, outcome: Result<T, DeviceError>) -> Result<T, DeviceError> {
        if let Err(error) = &outcome {
            self.knowledge.doubt(error);
        }
        outcome
    }
}

impl RotationAxis for VastBridge {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            has_position: false,
            has_encoder: false,
            has_stall: false,
            can_stop: false,
            absolute: false,
            trigger_only: true,
            outside: false,
        }
    }

    fn begin_run(&mut self) {
        if matches!(self.in_vast, ListInVast::Asked(_)) {
            self.in_vast = ListInVast::Unknown;
        }
    }

    fn announce(&mut self, stops: &[Steps]) -> Result<(), DeviceError> {
        self.put_list(stops)?;
        self.stops = stops.to_vec();
        Ok(())
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        self.dialogue.release(cancel)?;
        let taken_up = self.take_up();
        let steps = self.unless_doubtful(taken_up)?;
        self.stop = 0;
        self.knowledge.begin_epoch();
        Ok(self.knowledge.arrived(steps))
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let at = self.knowledge.known_steps()?;
        let moved = if at == target {
            self.dialogue.catch_up().map(|()| self.knowledge.arrived(at))
        } else {
            let next = self.stops.get(self.stop + 1).copied();
            if next != Some(target) {
                return Err(DeviceError::NotNext { target, next });
            }
            self.step()
        };
        self.unless_doubtful(moved)
    }

    fn let_go(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        self.dialogue.release(cancel)?;
        let finished = self.finish();
        self.unless_doubtful(finished)
    }

    /// The answer to the bridge's only question begins with the same `OK` as that to a trigger, and a late one would be mistaken for it. So
    /// the question is sent only while no trigger can follow. Within a list what came unasked is read. After a stop only the connection is
    /// checked.
    fn check(&mut self) -> Result<(), DeviceError> {
        self.dialogue.still_there()?;
        if self.dialogue.is_stopped() {
            return Ok(());
        }
        if self.knowledge.is_known() {
            let found = self.dialogue.catch_up();
            return self.unless_doubtful(found);
        }
        self.dialogue.greet().map(|_settings| ())
    }

    fn position(&self) -> Position {
        self.knowledge.position()
    }

    fn stop_handle(&self) -> StopHandle {
        self.dialogue.stop_handle()
    }
}

#[cfg(test)]
mod tests;
