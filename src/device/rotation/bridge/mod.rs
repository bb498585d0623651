//! Driver for a stock VAST BioImager behind its trigger bridge, an Arduino between two of VAST's plugs.
//!
//! ```text
//!  announce ──► external.txt ··· VAST takes up a specimen, reads the list ···► R1   reference: stands at the first stop
//!  move_to(next) ──► TT ── OK ······························· turns ·········► R1   stands at the next one
//!  let_go ──► TT ... ──► TT ── OK ·· end of the list: VAST goes on with the specimen as its own program says
//! ```
//! VAST cannot be asked where it stands and cannot be stopped or sent anywhere but on: its angle is known from the list, as
//! long as exactly one arrival follows each trigger, not sooner and not later than it can turn. Any arrival that no trigger
//! explains, and any that is missing, makes the position suspect: no trigger is ever repeated, for nobody knows whether it
//! was seen. A stop ends the triggers; VAST finishes its step by itself.

mod list;
mod message;
mod settings;

pub use settings::{Degrees, VastBridgeSettings};

use super::link::Link;
use crate::cancel::CancelToken;
use crate::device::{Achieved, Capabilities, DeviceError, Position, RotationAxis, StopHandle};
use crate::units::{Steps, StepsPerRevolution};
use message::Message;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

const DEVICE: &str = "rotation axis (VAST trigger bridge)";

/// Nothing on the wire stops VAST: a stop only latches.
const NO_STOP: &[u8] = b"";
/// Asked until it answers: a controller that restarts when its port is opened hears nothing for up to two seconds.
const WAKE_ATTEMPTS: u32 = 8;
/// Lines of settings after the `OK` to `X?`.
const SETTINGS_LINES: usize = 4;

/// The rotation of a VAST that is stepped through a list.
pub struct VastBridge {
    link: Link,
    settings: VastBridgeSettings,
    per_revolution: StepsPerRevolution,
    hundredths_per_step: i64,
    identity: String,
    heard: VecDeque<Message>,
    stops: Vec<Steps>,
    knowledge: Knowledge,
    /// Arrivals at the first stop, heard before anyone waited for them.
    arrivals: u32,
    /// Until when the arrival of the last trigger may still come.
    due: Instant,
    epoch: u32,
}

#[derive(Debug, Clone, PartialEq)]
enum Knowledge {
    /// VAST is not within a list, or has not come to its first stop.
    Unknown,
    /// It stands at this stop of the list.
    At(usize),
    Suspect {
        why: String,
    },
}

impl VastBridge {
    /// Opens the port and asks the bridge for its settings. Nothing moves.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a bridge that does not answer.
    pub fn open(settings: VastBridgeSettings, per_revolution: StepsPerRevolution) -> Result<Self, DeviceError> {
        settings.check(per_revolution)?;
        let hundredths_per_step = list::hundredths_per_step(per_revolution)?;
        let link = Link::serial(DEVICE, &settings.port, settings.baud, NO_STOP)?;
        let mut bridge = Self {
            link,
            settings,
            per_revolution,
            hundredths_per_step,
            identity: String::new(),
            heard: VecDeque::new(),
            stops: Vec::new(),
            knowledge: Knowledge::Unknown,
            arrivals: 0,
            due: Instant::now(),
            epoch: 0,
        };
        bridge.identity = format!("VAST trigger bridge ({})", bridge.greet()?.join(", "));
        tracing::info!(identity = bridge.identity, port = %bridge.settings.port, "rotation axis opened");
        Ok(bridge)
    }

    /// Asks for the bridge's settings until it answers.
    fn greet(&mut self) -> Result<Vec<String>, DeviceError> {
        let wait = self.settings.answer_timeout();
        let mut error = None;
        for _ in 0..WAKE_ATTEMPTS {
            self.link.send(b"X?\n")?;
            let until = Instant::now() + wait;
            let mut lines = Vec::new();
            while lines.len() < SETTINGS_LINES {
                match self.next(until)? {
                    Some(Message::Other(line)) if line.chars().all(|c| c == ' ' || c.is_ascii_graphic()) => lines.push(line),
                    Some(Message::Arrived) => self.arrivals += 1,
                    Some(Message::Error(number)) => error = Some(number),
                    // A greeting, the answer's `OK`, noise: the lines tell whether it was heard.
                    Some(_) => {}
                    None => break,
                }
            }
            if lines.len() == SETTINGS_LINES {
                return Ok(lines);
            }
        }
        let waited_ms = u128::from(WAKE_ATTEMPTS) * wait.as_millis();
        Err(error.map_or(DeviceError::Silent { device: DEVICE, request: "X?".into(), waited_ms }, refused))
    }

    fn next(&mut self, until: Instant) -> Result<Option<Message>, DeviceError> {
        loop {
            if let Some(message) = self.heard.pop_front() {
                return Ok(Some(message));
            }
            let Some(line) = self.link.line(until)? else { return Ok(None) };
            self.heard.extend(message::of(&line));
        }
    }

    /// What has been said since the last answer.
    fn next_now(&mut self) -> Result<Option<Message>, DeviceError> {
        loop {
            if let Some(message) = self.heard.pop_front() {
                return Ok(Some(message));
            }
            let Some(line) = self.link.line_now()? else { return Ok(None) };
            self.heard.extend(message::of(&line));
        }
    }

    /// Counts arrivals while VAST is in no list.
    fn listen(&mut self) -> Result<(), DeviceError> {
        while let Some(message) = self.next_now()? {
            match message {
                Message::Arrived => self.arrivals += 1,
                Message::Error(number) => return Err(refused(number)),
                Message::Ok | Message::Second | Message::Other(_) => {}
            }
        }
        Ok(())
    }

    /// Hears what was said while VAST stood: nothing is expected then.
    fn catch_up(&mut self) -> Result<(), DeviceError> {
        while let Some(message) = self.next_now()? {
            match message {
                Message::Arrived => return Err(suspect("VAST reported an arrival that no trigger explains")),
                Message::Ok => return Err(restarted()),
                Message::Error(number) => return Err(refused(number)),
                Message::Second | Message::Other(_) => {}
            }
        }
        Ok(())
    }

    /// Triggers once; returns when that was asked for.
    fn trigger(&mut self) -> Result<Instant, DeviceError> {
        self.catch_up()?;
        let wait = self.settings.answer_timeout();
        let sent = Instant::now();
        self.link.send(b"TT\n")?;
        loop {
            match self.next(sent + wait)? {
                Some(Message::Ok) => return Ok(sent),
                Some(Message::Arrived) => return Err(suspect("VAST reported an arrival before the trigger was acknowledged")),
                Some(Message::Error(number)) => return Err(refused(number)),
                Some(Message::Second | Message::Other(_)) => {}
                None => return Err(DeviceError::Silent { device: DEVICE, request: "TT".into(), waited_ms: wait.as_millis() }),
            }
        }
    }

    /// Waits for the one arrival, between `soonest` and `latest` after `since`.
    fn arrive(&mut self, since: Instant, soonest: Duration, latest: Duration) -> Result<(), DeviceError> {
        loop {
            match self.next(since + latest)? {
                Some(Message::Arrived) => {
                    let took = since.elapsed();
                    if took < soonest {
                        return Err(suspect(&format!(
                            "VAST reported an arrival after {} ms, the turn takes at least {} ms at the configured speed_deg_per_s",
                            took.as_millis(),
                            soonest.as_millis()
                        )));
                    }
                    return Ok(());
                }
                Some(Message::Ok) => return Err(restarted()),
                Some(Message::Error(number)) => return Err(refused(number)),
                Some(Message::Second | Message::Other(_)) => {}
                None => {
                    return Err(DeviceError::Late { device: DEVICE, what: "VAST was not in position (R1)", waited_ms: latest.as_millis() });
                }
            }
        }
    }

    /// Steps from a stop to the one after it.
    fn step(&mut self, from: usize) -> Result<(), DeviceError> {
        let way = Steps(self.stops[from + 1].0 - self.stops[from].0);
        let deg = self.per_revolution.angle(way).to_degrees();
        let pace = self.settings.pace();
        self.due = Instant::now() + pace.longest(deg);
        let since = self.trigger()?;
        self.arrive(since, pace.shortest(deg), pace.longest(deg))?;
        self.knowledge = Knowledge::At(from + 1);
        Ok(())
    }

    /// Waits until VAST stands at the first stop.
    fn take_up(&mut self) -> Result<Steps, DeviceError> {
        let Some(first) = self.stops.first().copied() else {
            return Err(suspect("no list has been announced, so VAST has none to go by"));
        };
        if self.knowledge != Knowledge::Unknown {
            self.begin_anew()?;
        }
        self.listen()?;
        self.greet()?;
        match std::mem::take(&mut self.arrivals) {
            0 => self.arrive(Instant::now(), Duration::ZERO, self.settings.first_arrival_timeout())?,
            1 => {}
            many => return Err(suspect(&format!("VAST reported {many} arrivals for one specimen and no trigger"))),
        }
        Ok(first)
    }

    /// Puts the list in place, unless VAST has it already.
    fn put_list(&mut self, stops: &[Steps]) -> Result<(), DeviceError> {
        let path = self.settings.list.clone();
        let text = list::text(stops, self.hundredths_per_step, &self.settings);
        let is_there = std::fs::read(&path).is_ok_and(|there| there == text.as_bytes());
        let stopped = self.link.is_stopped();
        if is_there && self.stops == stops && !stopped && matches!(self.knowledge, Knowledge::At(_)) {
            return Ok(());
        }
        if stopped || self.knowledge != Knowledge::Unknown {
            self.begin_anew()?;
        }
        if is_there {
            return Ok(());
        }
        if !stopped {
            self.listen()?;
        }
        if std::mem::take(&mut self.arrivals) > 0 {
            return Err(suspect("VAST was in position before its list was written, so it goes by another: end its list and begin again"));
        }
        list::write(&path, &text).map_err(|e| DeviceError::List { device: DEVICE, path, why: e.to_string() })?;
        tracing::info!(stops = stops.len(), list = %self.settings.list.display(), "VAST's list written");
        Ok(())
    }

    /// After a stop or a fault somebody ends VAST's list; what was said until now says nothing of the next specimen, and
    /// what is still to be said of the last trigger is waited for, or it would be taken for the next specimen's arrival.
    fn begin_anew(&mut self) -> Result<(), DeviceError> {
        let still_due = self.due.saturating_duration_since(Instant::now());
        self.link.quiet(still_due, Instant::now() + self.settings.answer_timeout().max(still_due))?;
        self.heard.clear();
        self.arrivals = 0;
        self.epoch += u32::from(matches!(self.knowledge, Knowledge::At(_)));
        self.knowledge = Knowledge::Unknown;
        Ok(())
    }

    /// Goes through what is left of the list and out of its end.
    fn finish(&mut self) -> Result<(), DeviceError> {
        while let Knowledge::At(stop) = self.knowledge {
            if stop + 1 < self.stops.len() {
                self.step(stop)?;
                continue;
            }
            if self.settings.end_with_trigger {
                self.trigger()?;
            }
            self.knowledge = Knowledge::Unknown;
            self.arrivals = 0;
        }
        Ok(())
    }

    /// No longer believes where VAST stands.
    fn doubt(&mut self, error: &DeviceError) {
        if matches!(self.knowledge, Knowledge::At(_)) {
            self.epoch += 1;
            tracing::warn!(epoch = self.epoch, why = %error, "the position of the rotation axis is suspect");
        }
        self.knowledge = Knowledge::Suspect { why: error.to_string() };
    }

    fn unless_doubtful<T>(&mut self, outcome: Result<T, DeviceError>) -> Result<T, DeviceError> {
        if let Err(error) = &outcome {
            self.doubt(error);
        }
        outcome
    }
}

impl RotationAxis for VastBridge {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities { has_position: false, has_encoder: false, has_stall: false, can_stop: false, absolute: false, trigger_only: true }
    }

    fn announce(&mut self, stops: &[Steps]) -> Result<(), DeviceError> {
        self.put_list(stops)?;
        self.stops = stops.to_vec();
        Ok(())
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        self.link.release(cancel)?;
        let taken_up = self.take_up();
        let steps = self.unless_doubtful(taken_up)?;
        self.epoch += 1;
        self.knowledge = Knowledge::At(0);
        Ok(Achieved { steps, epoch: self.epoch })
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let at = match &self.knowledge {
            Knowledge::Unknown => return Err(DeviceError::NotReferenced),
            Knowledge::Suspect { why } => return Err(DeviceError::Suspect { why: why.clone() }),
            Knowledge::At(at) => *at,
        };
        let moved = if self.stops[at] == target {
            self.catch_up()
        } else {
            let next = self.stops.get(at + 1).copied();
            if next != Some(target) {
                return Err(DeviceError::NotNext { target, next });
            }
            self.step(at)
        };
        self.unless_doubtful(moved)?;
        Ok(Achieved { steps: target, epoch: self.epoch })
    }

    fn let_go(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        self.link.release(cancel)?;
        let finished = self.finish();
        self.unless_doubtful(finished)
    }

    fn position(&self) -> Position {
        match self.knowledge {
            Knowledge::Unknown => Position::Unknown,
            Knowledge::At(stop) => Position::Referenced { steps: self.stops[stop], epoch: self.epoch },
            Knowledge::Suspect { .. } => Position::Suspect { epoch: self.epoch },
        }
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.link.stopper();
        StopHandle::new(move || stopper.stop())
    }
}

fn suspect(why: &str) -> DeviceError {
    DeviceError::Suspect { why: why.into() }
}

fn restarted() -> DeviceError {
    suspect("the bridge said OK to nothing: it restarted, or VAST saw a trigger that was not meant")
}

/// The bridge's firmware says which of its inputs or requests it could not serve; the number is all that it tells.
fn refused(number: u8) -> DeviceError {
    DeviceError::Alarm { device: DEVICE, what: format!("its error E{number}: a request or VAST's answer to it failed") }
}

#[cfg(test)]
mod tests;
