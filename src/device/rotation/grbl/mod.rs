//! Driver for Grbl 1.1 (and grblHAL, which speaks the same lines).
//!
//! ```text
//! Unknown ──reference──► Referenced(epoch) ──any doubt──► Suspect(epoch + 1) ──reference──► Referenced(epoch + 2)
//!                          │  move_to:  ?  idle at the expected step?
//!                          │            G53 absolute line, await ok     (queued)
//!                          │            G4 barrier, await ok            (planner drained)
//!                          └────────    ?  idle at the target?          (re-asked once: a flipped bit can parse)
//! ```
//! All positions are whole machine steps: the reported units times steps per unit. Step 0 of the axis is the machine step
//! found by the reference. Moves are absolute and in machine coordinates, their modes on the same line, because a reset
//! restores the controller's modes and work offsets survive in its memory.
//!
//! `ok` means queued, never arrived. Any greeting means a restart: the controller then counts from 0 without an alarm, so
//! the place it was left at is checked before every move and the target after it. A failed move is stopped, makes the
//! position suspect and is never tried again from here.

mod report;
mod settings;

pub use settings::{AxisLetter, GrblSettings, Reference};

use super::link::Link;
use crate::cancel::CancelToken;
use crate::device::{Achieved, Capabilities, DeviceError, Position, RotationAxis, StopHandle};
use crate::units::Steps;
use report::{Line, State, Status, alarm_text, error_text};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const DEVICE: &str = "rotation axis (Grbl)";

/// Feed hold, then soft reset: the hold begins to brake at once, the reset ends the cycle and empties the queue.
const STOP: &[u8] = b"!\x18";
const SOFT_RESET: &[u8] = b"\x18";
const STATUS: &[u8] = b"?";
/// Answered only once every queued motion has ended.
const BARRIER: &str = "G4P0.01";

/// Soft resets sent until a greeting comes. A controller that restarts when its port is opened spends up to two seconds
/// in its boot loader and hears none of them.
const WAKE_ATTEMPTS: u32 = 8;
const WAKE_WAIT: Duration = Duration::from_millis(500);
/// Silence after which a greeting's messages have ended; a line of 80 bytes takes 7 ms at 115200 baud.
const SILENCE: Duration = Duration::from_millis(20);
/// Status reports asked for until one can be read.
const STATUS_ATTEMPTS: u32 = 3;
/// Pause between two looks at an axis that is still turning.
const LOOK_AGAIN: Duration = Duration::from_millis(5);
/// Machine steps beyond which a reference "here" turns the axis back first: float32 holds 2^24 steps, and a hundredth of
/// a step is to stay resolved.
const FARTHEST_STEPS: i64 = (1 << 24) / 100;

/// A rotation axis on a Grbl controller.
pub struct Grbl {
    link: Link,
    settings: GrblSettings,
    identity: String,
    knowledge: Knowledge,
    epoch: u32,
    /// A motion has been asked for and its end has not been seen.
    in_flight: bool,
}

/// Machine steps count from the controller's own zero.
#[derive(Debug, Clone, PartialEq)]
enum Knowledge {
    Unknown,
    Referenced { origin: i64, at: i64 },
    Suspect { why: String },
}

impl Grbl {
    /// Opens the port, wakes the controller and holds its settings against the configured ones. Nothing moves.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a silent controller, one of another kind or with other settings.
    pub fn open(settings: GrblSettings) -> Result<Self, DeviceError> {
        settings.check()?;
        let link = Link::serial(DEVICE, &settings.port, settings.baud, STOP)?;
        let mut grbl = Self { link, settings, identity: String::new(), knowledge: Knowledge::Unknown, epoch: 0, in_flight: false };
        let greeting = grbl.wake()?;
        let mut version = Vec::new();
        grbl.command("$I", grbl.settings.answer_timeout(), |line| {
            if let Line::Message(text) = line {
                version.push(text);
            }
        })?;
        grbl.identity = format!("{greeting} {}", version.join(" "));
        grbl.compare_settings()?;
        tracing::info!(identity = grbl.identity, port = grbl.settings.port, "rotation axis opened");
        Ok(grbl)
    }

    /// Soft reset until the controller greets.
    fn wake(&mut self) -> Result<String, DeviceError> {
        for _ in 0..WAKE_ATTEMPTS {
            self.link.send(SOFT_RESET)?;
            let until = Instant::now() + WAKE_WAIT;
            while let Some(text) = self.link.line(until)? {
                let Line::Greeting(greeting) = Line::parse(&text) else { continue };
                self.link.quiet(SILENCE, Instant::now() + self.settings.answer_timeout())?;
                let greeting = greeting.split(" [").next().unwrap_or_default().to_owned();
                return match greeting.split(' ').nth(1) {
                    Some(version) if version.starts_with("1.1") => Ok(greeting),
                    _ => Err(DeviceError::Unexpected { device: DEVICE, expected: "Grbl 1.1".into(), found: greeting }),
                };
            }
        }
        let waited_ms = u128::from(WAKE_ATTEMPTS) * WAKE_WAIT.as_millis();
        Err(DeviceError::Silent { device: DEVICE, request: "soft reset".into(), waited_ms })
    }

    /// Holds `$$` against the configuration.
    fn compare_settings(&mut self) -> Result<(), DeviceError> {
        let mut found = BTreeMap::new();
        self.command("$$", self.settings.answer_timeout(), |line| {
            if let Line::Setting { number, value } = line {
                found.insert(number, value);
            }
        })?;
        let mismatch = |name: String, expected: String, found: Option<&f64>| {
            let found = found.map_or_else(|| "not reported".into(), f64::to_string);
            Err(DeviceError::Mismatch { device: DEVICE, name, expected, found })
        };
        let axis = self.settings.axis.index();
        let steps_per_unit = self.settings.steps_per_unit();
        // Printed with three decimals.
        match found.get(&(100 + axis)) {
            Some(value) if (value - steps_per_unit).abs() <= 0.0006 => {}
            other => return mismatch(format!("${} (steps per unit)", 100 + axis), format!("{steps_per_unit:.3}"), other),
        }
        for (number, least, name) in [
            (110 + axis, self.settings.max_rate_units_per_min, "maximum rate, units/min"),
            (120 + axis, self.settings.acceleration_units_per_s2, "acceleration, units/s^2"),
        ] {
            match found.get(&number) {
                Some(value) if *value >= least - 0.0006 => {}
                other => return mismatch(format!("${number} ({name})"), format!("at least {least:.3}"), other),
            }
        }
        match found.get(&10) {
            Some(mask) if (*mask as u32) & 1 == 1 => {}
            other => return mismatch("$10 (status report)".into(), "odd, to report machine positions".into(), other),
        }
        match found.get(&13) {
            Some(inches) if *inches != 0.0 => mismatch("$13 (report in inches)".into(), "0".into(), Some(inches)),
            _ => Ok(()),
        }
    }

    /// Sends one line and awaits its `ok`; everything else that is said meanwhile goes to `heard`.
    fn command(&mut self, line: &str, wait: Duration, mut heard: impl FnMut(Line)) -> Result<(), DeviceError> {
        self.link.send(format!("{line}\n").as_bytes())?;
        let until = Instant::now() + wait;
        while let Some(text) = self.link.line(until)? {
            match Line::parse(&text) {
                Line::Ok => return Ok(()),
                Line::Error(n) => {
                    return Err(DeviceError::Unexpected { device: DEVICE, expected: format!("ok to {line}"), found: error_text(n) });
                }
                other => heard(unless_lost(other)?),
            }
        }
        Err(DeviceError::Silent { device: DEVICE, request: line.into(), waited_ms: wait.as_millis() })
    }

    /// Asks for a status report, again if it comes garbled.
    fn status(&mut self) -> Result<Status, DeviceError> {
        let wait = self.settings.answer_timeout();
        let mut garbled = None;
        for _ in 0..STATUS_ATTEMPTS {
            self.link.send(STATUS)?;
            let until = Instant::now() + wait;
            loop {
                let Some(text) = self.link.line(until)? else {
                    return Err(DeviceError::Silent { device: DEVICE, request: "?".into(), waited_ms: wait.as_millis() });
                };
                match unless_lost(Line::parse(&text))? {
                    Line::Status(status) => return Ok(status),
                    Line::BrokenStatus(text) => {
                        garbled = Some(text);
                        break;
                    }
                    _ => {}
                }
            }
        }
        Err(DeviceError::Unexpected { device: DEVICE, expected: "a status report".into(), found: garbled.unwrap_or_default() })
    }

    /// Waits until the axis is idle and returns the machine step where it stands; `None` between two steps.
    fn standing(&mut self, until: Instant) -> Result<Option<i64>, DeviceError> {
        loop {
            let status = self.status()?;
            match status.state {
                State::Idle => {
                    let axis = usize::from(self.settings.axis.index());
                    let units = status.machine.as_ref().and_then(|m| m.get(axis));
                    let found = || format!("{status:?}");
                    let units = *units.ok_or_else(|| DeviceError::Unexpected {
                        device: DEVICE,
                        expected: format!("a machine position of axis {:?}", self.settings.axis),
                        found: found(),
                    })?;
                    return Ok(self.settings.machine_steps(units));
                }
                State::Run | State::Jog | State::Home if Instant::now() < until => std::thread::sleep(LOOK_AGAIN),
                State::Alarm => return Err(DeviceError::Alarm { device: DEVICE, what: "the alarm state".into() }),
                other => {
                    return Err(DeviceError::Unexpected { device: DEVICE, expected: "an idle axis".into(), found: format!("{other:?}") });
                }
            }
        }
    }

    /// Sure that the axis stands at `expected`? A reading that says otherwise is asked for once more before it is believed.
    fn confirm(&mut self, expected: i64, origin: i64, until: Instant) -> Result<(), DeviceError> {
        if self.standing(until)? == Some(expected) {
            return Ok(());
        }
        match self.standing(until)? {
            Some(found) if found == expected => Ok(()),
            Some(found) => Err(DeviceError::Missed { target: Steps(expected - origin), achieved: Steps(found - origin) }),
            None => Err(DeviceError::Suspect { why: "the controller reports a place between two steps".into() }),
        }
    }

    /// Hears what was said since the last answer: a restart or an alarm between two moves.
    fn catch_up(&mut self) -> Result<(), DeviceError> {
        while let Some(text) = self.link.line_now()? {
            unless_lost(Line::parse(&text))?;
        }
        Ok(())
    }

    /// Turns the axis from one machine step to another and returns once it stands there.
    fn travel(&mut self, from: i64, to: i64, origin: i64) -> Result<(), DeviceError> {
        self.catch_up()?;
        self.confirm(from, origin, Instant::now())?;
        if from == to {
            return Ok(());
        }
        let line = format!(
            "G21G90G53G1{:?}{}F{:.3}",
            self.settings.axis,
            three_decimals(self.settings.units(to)),
            self.settings.max_rate_units_per_min
        );
        let wait = self.settings.travel_time(to - from);
        let until = Instant::now() + wait;
        self.in_flight = true;
        self.command(&line, self.settings.answer_timeout(), |_| {})?;
        self.command(BARRIER, wait, |_| {})?;
        self.confirm(to, origin, until)?;
        self.in_flight = false;
        Ok(())
    }

    /// Brings the axis to rest and no longer believes its position.
    fn doubt(&mut self, error: &DeviceError) {
        if self.in_flight {
            self.link.halt();
            self.in_flight = false;
        }
        if matches!(self.knowledge, Knowledge::Referenced { .. }) {
            self.epoch += 1;
            self.knowledge = Knowledge::Suspect { why: error.to_string() };
            tracing::warn!(epoch = self.epoch, why = %error, "the position of the rotation axis is suspect");
        }
    }

    fn find_origin(&mut self) -> Result<i64, DeviceError> {
        if let (Reference::Here, Knowledge::Referenced { origin, at }) = (self.settings.reference, &self.knowledge)
            && at.abs() > FARTHEST_STEPS
        {
            let (origin, at) = (*origin, *at);
            self.travel(at, 0, origin)?;
        }
        self.wake()?;
        self.compare_settings()?;
        let how = self.settings.reference;
        match how {
            Reference::Home => {
                self.in_flight = true;
                self.command("$H", self.settings.homing_timeout(), |_| {})?;
                self.in_flight = false;
            }
            Reference::Here if self.status()?.state == State::Alarm => {
                self.command("$X", self.settings.answer_timeout(), |_| {})?;
            }
            Reference::Here => {}
        }
        let until = Instant::now() + self.settings.answer_timeout();
        let lies_between = || DeviceError::Suspect { why: "the controller reports a place between two steps".into() };
        let origin = self.standing(until)?.ok_or_else(lies_between)?;
        // Read twice: every later angle hangs on this number.
        self.confirm(origin, origin, until)?;
        Ok(origin)
    }
}

impl RotationAxis for Grbl {
    fn identity(&self) -> &str {
        &self.identity
    }

    /// Open loop: the position is what was commanded, and a lost step shows only in the pictures.
    fn capabilities(&self) -> Capabilities {
        Capabilities { has_position: true, has_encoder: false, has_stall: false, can_stop: true, absolute: true, trigger_only: false }
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        self.link.release(cancel)?;
        match self.find_origin() {
            Ok(origin) => {
                self.epoch += 1;
                self.knowledge = Knowledge::Referenced { origin, at: origin };
                Ok(Achieved { steps: Steps(0), epoch: self.epoch })
            }
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let (origin, from) = match &self.knowledge {
            Knowledge::Unknown => return Err(DeviceError::NotReferenced),
            Knowledge::Suspect { why } => return Err(DeviceError::Suspect { why: why.clone() }),
            Knowledge::Referenced { origin, at } => (*origin, *at),
        };
        let to = origin + target.0;
        match self.travel(from, to, origin) {
            Ok(()) => {
                self.knowledge = Knowledge::Referenced { origin, at: to };
                Ok(Achieved { steps: target, epoch: self.epoch })
            }
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn position(&self) -> Position {
        match self.knowledge {
            Knowledge::Unknown => Position::Unknown,
            Knowledge::Referenced { origin, at } => Position::Referenced { steps: Steps(at - origin), epoch: self.epoch },
            Knowledge::Suspect { .. } => Position::Suspect { epoch: self.epoch },
        }
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.link.stopper();
        StopHandle::new(move || stopper.stop())
    }
}

impl Drop for Grbl {
    fn drop(&mut self) {
        if self.in_flight {
            self.link.halt();
        }
    }
}

/// Lines after which the position is no longer known, as errors.
fn unless_lost(line: Line) -> Result<Line, DeviceError> {
    match line {
        Line::Greeting(greeting) => Err(DeviceError::Suspect { why: format!("the controller restarted: {greeting}") }),
        Line::Alarm(n) => Err(DeviceError::Alarm { device: DEVICE, what: alarm_text(n) }),
        other => Ok(other),
    }
}

/// Three decimals and no minus zero.
fn three_decimals(units: f64) -> String {
    let text = format!("{units:.3}");
    if text == "-0.000" { "0.000".into() } else { text }
}

#[cfg(test)]
mod dialogues;
