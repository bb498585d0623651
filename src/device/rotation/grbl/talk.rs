//! Requests and their answers: one line under way at a time, each with its deadline.

use super::geometry::Geometry;
use super::report::{Line, State, Status, alarm_text, error_text};
use super::{DEVICE, Dialect, FULL_STATUS, Grbl, SOFT_RESET, STATUS};
use crate::device::DeviceError;
use crate::units::Steps;
use std::time::{Duration, Instant};

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
/// What the controller says at a start on which it found its settings memory erased.
const MEMORY_ERASED: u16 = 7;

impl Grbl {
    /// Soft reset until the controller greets. Answers to what was asked before are behind us then.
    pub(super) fn wake(&mut self) -> Result<String, DeviceError> {
        for _ in 0..WAKE_ATTEMPTS {
            self.link.send(SOFT_RESET)?;
            let until = Instant::now() + WAKE_WAIT;
            while let Some(text) = self.link.line(until)? {
                let greeting = match Line::parse(&text) {
                    Line::Greeting(greeting) => greeting,
                    Line::Error(MEMORY_ERASED) => {
                        self.memory_erased = true;
                        continue;
                    }
                    _ => continue,
                };
                self.link.quiet(SILENCE, Instant::now() + self.settings.answer_timeout())?;
                let greeting = greeting.split(" [").next().unwrap_or_default().to_owned();
                self.is_hal = self.settings.dialect.of(&greeting)?;
                return Ok(greeting);
            }
        }
        let waited_ms = u128::from(WAKE_ATTEMPTS) * WAKE_WAIT.as_millis();
        Err(DeviceError::Silent { device: DEVICE, request: "soft reset".into(), waited_ms })
    }

    /// The first question after [`Self::wake`]. A reset that was answered late has one more greeting under way; nothing has been
    /// asked of the axis yet, so that is no restart to fear, and the question is put again.
    pub(super) fn first(&mut self, mut ask: impl FnMut(&mut Self) -> Result<(), DeviceError>) -> Result<(), DeviceError> {
        for _ in 1..WAKE_ATTEMPTS {
            match ask(self) {
                Err(DeviceError::Suspect { .. }) => self.link.quiet(SILENCE, Instant::now() + self.settings.answer_timeout())?,
                answered => return answered,
            }
        }
        ask(self)
    }

    /// Sends one line and awaits its `ok`; everything else that is said meanwhile goes to `heard`.
    pub(super) fn command(&mut self, line: &str, wait: Duration, mut heard: impl FnMut(Line)) -> Result<(), DeviceError> {
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

    /// A line of G-code. grblHAL answers each of them by the last error, whatever that was about, until an empty line
    /// has come: a disturbed byte on the line would else refuse all that follows.
    pub(super) fn code(&mut self, line: &str, wait: Duration) -> Result<(), DeviceError> {
        if self.is_hal {
            self.command("", self.settings.answer_timeout(), |_| {})?;
        }
        self.command(line, wait, |_| {})
    }

    /// Asks for a status report, again if it comes garbled.
    pub(super) fn status(&mut self) -> Result<Status, DeviceError> {
        self.report(STATUS)
    }

    /// The report with every field that grblHAL has.
    pub(super) fn full_status(&mut self) -> Result<Status, DeviceError> {
        self.report(FULL_STATUS)
    }

    fn report(&mut self, request: &[u8]) -> Result<Status, DeviceError> {
        let wait = self.settings.answer_timeout();
        let mut garbled = None;
        for _ in 0..STATUS_ATTEMPTS {
            self.link.send(request)?;
            let until = Instant::now() + wait;
            loop {
                let Some(text) = self.link.line(until)? else {
                    let request = request.escape_ascii().to_string();
                    return Err(DeviceError::Silent { device: DEVICE, request, waited_ms: wait.as_millis() });
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

    /// Waits until the controller is idle and returns the machine step where the axis stands; `None` between two steps.
    pub(super) fn standing(&mut self, axis: &Geometry, until: Instant) -> Result<Option<i64>, DeviceError> {
        loop {
            let status = self.status()?;
            match status.state {
                State::Idle => {
                    let units = status.machine.as_ref().and_then(|m| m.get(usize::from(axis.letter.index())));
                    let found = || format!("{status:?}");
                    let units = *units.ok_or_else(|| DeviceError::Unexpected {
                        device: DEVICE,
                        expected: format!("a machine position of axis {:?}", axis.letter),
                        found: found(),
                    })?;
                    return Ok(axis.machine_steps(units));
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
    pub(super) fn confirm(&mut self, axis: &Geometry, expected: i64, origin: i64, until: Instant) -> Result<(), DeviceError> {
        if self.standing(axis, until)? == Some(expected) {
            return Ok(());
        }
        match self.standing(axis, until)? {
            Some(found) if found == expected => Ok(()),
            Some(found) => Err(DeviceError::Missed { target: Steps(expected - origin), achieved: Steps(found - origin) }),
            None => Err(DeviceError::Suspect { why: "the controller reports a place between two steps".into() }),
        }
    }

    /// Whether the controller answers; what it says of a restart or an alarm is heard on the way.
    pub(super) fn answers(&mut self) -> Result<(), DeviceError> {
        let wait = self.settings.answer_timeout();
        let lines = self.link.probe(STATUS, wait)?;
        if lines.is_empty() {
            return Err(DeviceError::Silent { device: DEVICE, request: "?".into(), waited_ms: wait.as_millis() });
        }
        for line in lines {
            if let Err(error) = unless_lost(Line::parse(&line)) {
                self.doubt(&error);
            }
        }
        Ok(())
    }

    /// Hears what was said since the last answer: a restart or an alarm between two moves.
    pub(super) fn catch_up(&mut self) -> Result<(), DeviceError> {
        while let Some(text) = self.link.line_now()? {
            unless_lost(Line::parse(&text))?;
        }
        Ok(())
    }
}

impl Dialect {
    /// Whether `greeting` is grblHAL's; refuses what is not spoken here, or not what was configured.
    fn of(self, greeting: &str) -> Result<bool, DeviceError> {
        let mut words = greeting.split(' ');
        let (name, version) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        let is_hal = name.eq_ignore_ascii_case("grblHAL");
        let expected = match self {
            Self::Auto => "Grbl 1.1 or grblHAL 1.1",
            Self::Grbl => "Grbl 1.1",
            Self::GrblHal => "grblHAL 1.1",
        };
        let other = if is_hal { Self::Grbl } else { Self::GrblHal };
        if version.starts_with("1.1") && self != other {
            return Ok(is_hal);
        }
        Err(DeviceError::Unexpected { device: DEVICE, expected: expected.into(), found: greeting.into() })
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
