//! Requests and their answers. One line is under way at a time, each with its deadline.
//!
//! ```text
//! version   $I ──► [VER:...] ... ok                               everything asked before is void
//! wake      0x18 ──► greeting, or a report                        the same, of a controller that is locked or does not answer
//! command   line ──► ok | error | nothing: a status report tells whether the line was taken
//! status    ?    ──► <...>                                        asked up to three times
//!
//! any greeting meanwhile ──► Intervention, or Suspect if it may be that of a reset of carved
//! ALARM:n ──► Alarm, or Intervention
//! ```

use super::geometry::Geometry;
use super::report::{Line, State, Status, alarm_text, error_text};
use super::{DEVICE, Dialect, FULL_FEED, FULL_STATUS, Grbl, SOFT_RESET, STATUS, intervention};
use crate::DeviceError;
use carved_core::units::Steps;
use std::time::{Duration, Instant};

/// Time after which a greeting of an identified controller is not that of a reset of carved. It says it within milliseconds.
pub(super) const OWN_GREETING: Duration = Duration::from_secs(2);
/// Number of soft resets until a greeting or a report must have come. A controller that restarts when its port is opened spends up to two
/// seconds in its boot loader, which ignores them.
const WAKE_ATTEMPTS: u32 = 4;
/// How often a first question is repeated, because the greetings of earlier resets may come before its answer.
const FIRST_ATTEMPTS: u32 = 8;
const WAKE_WAIT: Duration = Duration::from_millis(500);
/// Silence after which no more messages follow a greeting. A line of 80 bytes takes 7 ms at 115200 baud.
const SILENCE: Duration = Duration::from_millis(20);
/// How often a report, or the answer to a line, is requested until it can be read.
const ATTEMPTS: u32 = 3;
/// The same if resets were sent before: the greeting of each may come before the report.
const GLANCES: u32 = 16;
/// Pause between two reports of an axis that turns at a constant speed: shorter than the specimen needs to show that it stands.
const LOOK_AFTER_HANDS: Duration = Duration::from_millis(30);
/// Pause between two reports of a turning axis.
const LOOK_AGAIN: Duration = Duration::from_millis(5);
/// Its number was lost, or it follows a reset whose greeting was lost.
const ALARM_WITHOUT_A_NUMBER: &str = "the alarm state, and no alarm was received: it was reset, or the message was lost";
/// Number of the error of a command that needs an idle controller.
const NOT_IDLE: u16 = 8;
/// Number of the error that the controller sends at a start if its settings memory was erased.
const MEMORY_ERASED: u16 = 7;

/// What a controller says of itself.
#[derive(Debug)]
pub(super) struct Version {
    /// As in its greeting, `Grbl 1.1h`. Empty if it does not say it.
    pub name: String,
    /// Its answer to `$I`.
    pub lines: Vec<String>,
}

/// The name that the greeting has, by the answer to `$I`. A grblHAL writes its options in two lines, and most name the firmware.
fn name_of(lines: &[String]) -> Option<String> {
    let version = lines.iter().find_map(|line| line.strip_prefix("[VER:"))?;
    let is_hal = lines.iter().any(|line| line.starts_with("[FIRMWARE:grblHAL") || line.starts_with("[NEWOPT:"));
    // 1.1h.20190830:
    let numbers = version.split([':', '(', ' ', ']']).next()?;
    let version: Vec<&str> = numbers.splitn(3, '.').take(2).collect();
    Some(format!("{} {}", if is_hal { "GrblHAL" } else { "Grbl" }, version.join(".")))
}

impl Grbl {
    /// Makes the answers to earlier questions void, and returns the version. `is_idle`: the controller has just reported that it is idle.
    ///
    /// An idle controller is asked for its version, which it refuses in a hold. It is not reset, because a reset releases a hold that is
    /// pressed after the report. A controller that an alarm locks takes no hold, so it is reset. One that is idle and does not answer, as in a
    /// long dwell, is reset too, because nothing else ends that: it is asked for a report once more, and a hold that this shows is kept.
    pub(super) fn make_answers_void(&mut self, is_idle: bool) -> Result<Version, DeviceError> {
        if is_idle {
            match self.first(Self::version) {
                Ok(version) if !version.name.is_empty() => return Ok(version),
                Err(error @ (DeviceError::Intervention { .. } | DeviceError::Gone { .. } | DeviceError::Stopped)) => return Err(error),
                unknown => tracing::info!(?unknown, "the controller is idle and does not say its version: it is reset"),
            }
            self.wait_until_free()?;
        }
        let greeting = self.wake()?;
        let mut version = self.first(Self::version)?;
        version.name = greeting.unwrap_or(version.name);
        Ok(version)
    }

    /// Asks for the version. An answer to an earlier question may come first, so the version is asked for until it comes.
    fn version(&mut self) -> Result<Version, DeviceError> {
        let mut lines = Vec::new();
        for asked in 0..ATTEMPTS {
            lines.clear();
            self.command("$I", self.settings.answer_timeout(), |line| {
                // A disturbed greeting may be under way still.
                if let Line::Message(text) = line
                    && text.starts_with('[')
                {
                    lines.push(text);
                }
            })?;
            if let Some(name) = name_of(&lines) {
                if asked > 0 {
                    self.link.quiet(SILENCE, Instant::now() + self.settings.answer_timeout())?;
                }
                return Ok(Version { name, lines });
            }
        }
        Ok(Version { name: String::new(), lines })
    }

    /// Sends a soft reset until the greeting comes, and returns it; `None` if only a report tells that the controller is awake. Answers to
    /// earlier requests have then arrived.
    fn wake(&mut self) -> Result<Option<String>, DeviceError> {
        for _ in 0..WAKE_ATTEMPTS {
            self.link.send(SOFT_RESET)?;
            self.own_reset = Instant::now();
            self.outputs.forget();
            let until = Instant::now() + WAKE_WAIT;
            while let Some(text) = self.link.line(until)? {
                let greeting = match Line::parse(&text) {
                    Line::Greeting(greeting) => greeting,
                    Line::Error(MEMORY_ERASED) => {
                        self.memory_erased = true;
                        continue;
                    }
                    // While an emergency stop is pressed the controller ignores a reset.
                    Line::Alarm(n) => match intervention::of_alarm(n) {
                        Some(error) => return Err(error),
                        None => continue,
                    },
                    _ => continue,
                };
                self.owe_no_greeting();
                self.link.quiet(SILENCE, Instant::now() + self.settings.answer_timeout())?;
                let greeting = greeting.split(" [").next().unwrap_or_default().to_owned();
                self.settings.dialect.of(&greeting)?;
                return Ok(Some(greeting));
            }
            // The greeting may be lost, and a person may hold the controller since: another reset would release it.
            if self.wait_until_free()? {
                return Ok(None);
            }
        }
        let waited_ms = u128::from(2 * WAKE_ATTEMPTS) * WAKE_WAIT.as_millis();
        let silent = self.link.silent("soft reset", waited_ms);
        Err(if self.is_identified { silent } else { self.link.first_contact(silent) })
    }

    /// Asks the first question after a reset. An earlier reset may have one more greeting under way. Nothing was asked of the axis yet, so
    /// this greeting is not treated as a restart, and the question is repeated.
    pub(super) fn first<T>(&mut self, mut ask: impl FnMut(&mut Self) -> Result<T, DeviceError>) -> Result<T, DeviceError> {
        for _ in 1..FIRST_ATTEMPTS {
            match ask(self) {
                Err(DeviceError::Suspect { .. }) => self.link.quiet(SILENCE, Instant::now() + self.settings.answer_timeout())?,
                answered => return answered,
            }
        }
        ask(self)
    }

    /// Sends one line and waits for its `ok`. Other lines go to `heard`. False if no `ok` came, because it or the line was lost or
    /// disturbed.
    pub(super) fn exchange(&mut self, line: &str, wait: Duration, mut heard: impl FnMut(Line)) -> Result<bool, DeviceError> {
        self.link.send(format!("{line}\n").as_bytes())?;
        let mut until = Instant::now() + wait;
        while let Some(text) = self.link.line(until)? {
            match Line::parse(&text) {
                Line::Ok => return Ok(true),
                Line::Error(n) => {
                    if n == NOT_IDLE {
                        // A person may have held the controller since it was asked.
                        self.check_free()?;
                    }
                    let refused = DeviceError::Unexpected { device: DEVICE, expected: format!("ok to {line}"), found: error_text(n) };
                    return Err(intervention::of_error(n).unwrap_or(refused));
                }
                // This may have been the answer, disturbed.
                Line::Other(noise) if !noise.is_empty() => until = until.min(Instant::now() + self.settings.answer_timeout()),
                other => {
                    let other = self.unless_lost(other)?;
                    heard(other);
                }
            }
        }
        Ok(false)
    }

    /// As [`Self::exchange`], but a missing `ok` is an error.
    pub(super) fn command(&mut self, line: &str, wait: Duration, heard: impl FnMut(Line)) -> Result<(), DeviceError> {
        if self.exchange(line, wait, heard)? { Ok(()) } else { Err(self.unanswered(line, wait)) }
    }

    /// The error of a line without an `ok`: the one that a status report shows, or else silence.
    fn unanswered(&mut self, line: &str, wait: Duration) -> DeviceError {
        let silent = self.link.silent(line, wait.as_millis());
        self.free_status().map_or_else(|error| error, |_status| silent)
    }

    /// Sends a line of G-code. grblHAL repeats its last error for every such line until it gets an empty line. Without that, one disturbed
    /// byte would make it refuse everything that follows.
    pub(super) fn code(&mut self, line: &str) -> Result<(), DeviceError> {
        self.clear_error()?;
        self.command(line, self.settings.answer_timeout(), |_| {})
    }

    fn clear_error(&mut self) -> Result<(), DeviceError> {
        if self.is_hal {
            // An empty line does nothing, so its `ok` does not matter.
            self.exchange("", self.settings.answer_timeout(), |_| {})?;
        }
        Ok(())
    }

    /// Sends an axis from one machine step to another. A line without an `ok` may have been taken or not. It is sent again only if the axis
    /// still rests at `from`. This is safe, because the target is absolute.
    pub(super) fn send_off(&mut self, axis: &Geometry, from: i64, to: i64) -> Result<(), DeviceError> {
        let line = axis.line(to);
        for _ in 0..ATTEMPTS {
            self.clear_error()?;
            self.link.send(FULL_FEED)?;
            if self.exchange(&line, self.settings.answer_timeout(), |_| {})? {
                return Ok(());
            }
            let status = self.free_status()?;
            if status.state != State::Idle || axis.units_of(&status).and_then(|units| axis.machine_steps(units)) != Some(from) {
                return Ok(());
            }
            tracing::info!(line, "no answer, and the axis has not moved: the line is sent again");
        }
        Err(self.unanswered(&line, self.settings.answer_timeout()))
    }

    /// Runs a homing cycle. Without an `ok` it is run again: it ends at the same switch from any position.
    pub(super) fn home(&mut self, line: &str) -> Result<(), DeviceError> {
        self.link.set_moving(true);
        if !self.exchange(line, self.settings.homing_timeout(), |_| {})? {
            // A controller that still homes after the deadline will not find its switch.
            let status = self.status()?;
            if status.state != State::Home
                && let Some(error) = intervention::of(&status, true)
            {
                return Err(error);
            }
            if status.state != State::Idle || !self.exchange(line, self.settings.homing_timeout(), |_| {})? {
                let waited_ms = self.settings.homing_timeout().as_millis();
                return Err(self.link.silent(line, waited_ms));
            }
        }
        self.link.set_moving(false);
        Ok(())
    }

    /// A report of a controller that no person holds. An intervention must be read twice.
    pub(super) fn free_status(&mut self) -> Result<Status, DeviceError> {
        let status = self.status()?;
        if intervention::of(&status, true).is_none() {
            return Ok(status);
        }
        let status = self.status()?;
        intervention::of(&status, true).map_or(Ok(status), Err)
    }

    /// An error while a person holds the controller.
    pub(super) fn check_free(&mut self) -> Result<(), DeviceError> {
        self.free_status().map(drop)
    }

    /// Waits for a motion to end, and is an error while a person holds the controller. The controller is neither moved nor reset. One that
    /// does not answer is starting, or waits for a reset after a limit: neither is an intervention. Returns whether it is idle.
    pub(super) fn wait_until_free(&mut self) -> Result<bool, DeviceError> {
        let until = Instant::now() + self.settings.homing_timeout();
        let mut asked_again = false;
        while let Some(status) = self.glance()? {
            match intervention::of(&status, true).or_else(|| self.elsewhere_at_rest(&status)) {
                Some(error) if asked_again => return Err(error),
                Some(_) => asked_again = true,
                None if status.state != State::Run => return Ok(status.state == State::Idle),
                // A motion continues after a hold.
                None if Instant::now() < until => std::thread::sleep(LOOK_AGAIN),
                None => return Err(intervention::still_turning(&status)),
            }
        }
        Ok(false)
    }

    /// The error of a report at rest from another place than where the rotation axis was left.
    fn elsewhere_at_rest(&self, status: &Status) -> Option<DeviceError> {
        let axis = self.rotation();
        let left = self.origin + self.knowledge.known_steps().ok()?.0;
        let found = axis.machine_steps(axis.units_of(status)?)?;
        (status.state != State::Run && found != left).then(|| intervention::elsewhere(axis.units(left), axis.units(found)))
    }

    /// Confirms that the axis rests where it was left, before it is moved. Another place, or an alarm there, is an intervention.
    pub(super) fn confirm_left(&mut self, axis: &Geometry, left: i64, origin: i64) -> Result<(), DeviceError> {
        let found = match self.confirm(axis, left, origin, Instant::now()) {
            Err(DeviceError::Missed { achieved, .. }) => achieved.0 + origin,
            Err(error @ DeviceError::Alarm { .. }) => {
                let units = axis.units_of(&self.status()?);
                units.and_then(|units| axis.machine_steps(units)).filter(|found| *found != left).ok_or(error)?
            }
            confirmed => return confirmed,
        };
        Err(intervention::elsewhere(axis.units(left), axis.units(found)))
    }

    /// A report, also if other lines come before it; `None` without an answer.
    fn glance(&mut self) -> Result<Option<Status>, DeviceError> {
        let mut asked = 0;
        'ask: while asked < GLANCES {
            asked += 1;
            self.link.send(STATUS)?;
            let until = Instant::now() + WAKE_WAIT;
            while let Some(text) = self.link.line(until)? {
                match Line::parse(&text) {
                    Line::Status(status) => return Ok(Some(status)),
                    Line::Error(MEMORY_ERASED) => self.memory_erased = true,
                    // It restarted and may have missed the question.
                    greeting @ Line::Greeting(_) => match self.unless_lost(greeting) {
                        Err(error @ DeviceError::Intervention { .. }) => return Err(error),
                        _ => continue 'ask,
                    },
                    Line::BrokenStatus(_) => continue 'ask,
                    _ => {}
                }
            }
            return Ok(None);
        }
        Ok(None)
    }

    /// Asks for a status report, again if it is lost or garbled.
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
        for _ in 0..ATTEMPTS {
            self.link.send(request)?;
            let until = Instant::now() + wait;
            while let Some(text) = self.link.line(until)? {
                match self.unless_lost(Line::parse(&text))? {
                    Line::Status(status) => return Ok(status),
                    Line::BrokenStatus(text) => garbled = Some(text),
                    Line::Other(text) if !text.is_empty() => garbled = Some(text),
                    _ => continue,
                }
                self.link.quiet(SILENCE, Instant::now() + wait)?;
                break;
            }
        }
        let request = request.escape_ascii().to_string();
        Err(match garbled {
            Some(found) => self.link.garbled(request, "a status report".into(), found),
            None => self.link.silent(request, wait.as_millis() * u128::from(ATTEMPTS)),
        })
    }

    /// Waits until the controller is idle and returns the machine step of the axis; `None` between two steps.
    pub(super) fn standing(&mut self, axis: &Geometry, until: Instant) -> Result<Option<i64>, DeviceError> {
        let unexpected = |expected: String, status: Status| {
            let found = status.to_string();
            Err(DeviceError::Unexpected { device: DEVICE, expected, found })
        };
        let mut without_position = 0;
        loop {
            let status = self.free_status()?;
            match status.state {
                State::Idle => match axis.units_of(&status) {
                    Some(units) => return Ok(axis.machine_steps(units)),
                    None if without_position < ATTEMPTS => without_position += 1,
                    None => return unexpected(format!("a machine position of axis {:?}", axis.letter), status),
                },
                State::Alarm => return Err(DeviceError::Alarm { device: DEVICE, what: ALARM_WITHOUT_A_NUMBER.into() }),
                _ if Instant::now() < until => std::thread::sleep(LOOK_AGAIN),
                _ => return unexpected("an axis at rest by now".into(), status),
            }
        }
    }

    /// Waits until the axis rests at `to`, or until the deadline, and is an error as soon as a person holds the controller.
    pub(super) fn watch(&mut self, axis: &Geometry, to: i64, until: Instant) -> Result<(), DeviceError> {
        loop {
            let status = self.free_status()?;
            let stands_at = axis.units_of(&status).and_then(|units| axis.machine_steps(units));
            if (status.state == State::Idle && stands_at == Some(to)) || Instant::now() > until {
                return Ok(());
            }
            std::thread::sleep(LOOK_AFTER_HANDS);
        }
    }

    /// Confirms that the axis rests at `expected`. Another position must be read twice before it is an error.
    pub(super) fn confirm(&mut self, axis: &Geometry, expected: i64, origin: i64, until: Instant) -> Result<(), DeviceError> {
        if self.standing(axis, until)? == Some(expected) {
            return Ok(());
        }
        match self.standing(axis, until)? {
            Some(found) if found == expected => Ok(()),
            Some(found) => Err(DeviceError::Missed { target: Steps(expected - origin), achieved: Steps(found - origin) }),
            None => Err(DeviceError::Suspect { why: "the controller reports a position between two steps".into() }),
        }
    }

    /// The report of a controller at rest that no person holds; `None` if it cannot be read. An intervention must be read twice.
    pub(super) fn free_report_at_rest(&mut self) -> Result<Option<Status>, DeviceError> {
        let intervention_in = |report: &Option<Status>| report.as_ref().and_then(|status| intervention::of(status, false));
        let report = self.report_at_rest()?;
        if intervention_in(&report).is_none() {
            return Ok(report);
        }
        let report = self.report_at_rest()?;
        intervention_in(&report).map_or(Ok(report), Err)
    }

    /// A report of a controller that may be stopped; `None` if none can be read. A restart or an alarm before it makes the position
    /// suspect. One that a person caused is an error.
    pub(super) fn report_at_rest(&mut self) -> Result<Option<Status>, DeviceError> {
        let wait = self.settings.answer_timeout();
        self.note_stops();
        let mut lines = self.link.probe(STATUS, wait)?;
        if lines.is_empty() {
            lines = self.link.probe(STATUS, wait)?;
        }
        if lines.is_empty() {
            return Err(self.link.silent("?", 2 * wait.as_millis()));
        }
        let mut newest = None;
        for line in lines {
            match self.unless_lost(Line::parse(&line)) {
                Ok(Line::Status(status)) => newest = Some(status),
                Ok(_) => {}
                Err(error @ DeviceError::Intervention { .. }) => return Err(error),
                Err(error) => self.doubt(&error),
            }
        }
        // Two resets at once may have one greeting. What has not come before this answer does not come.
        if newest.is_some() && self.own_stop.elapsed() > OWN_GREETING {
            self.owe_no_greeting();
        }
        Ok(newest)
    }

    /// Counts the greetings of the stops that were written since the last call.
    fn note_stops(&mut self) {
        let stops = self.link.take_stops();
        if stops > 0 {
            (self.owed_greetings, self.own_stop) = (self.owed_greetings.saturating_add(stops), Instant::now());
        }
    }

    /// Every greeting of a stop of carved was read.
    fn owe_no_greeting(&mut self) {
        self.link.take_stops();
        self.owed_greetings = 0;
    }

    /// Reads the lines that came since the last answer. A restart or an alarm is an error.
    pub(super) fn catch_up(&mut self) -> Result<(), DeviceError> {
        while let Some(text) = self.link.line_now()? {
            self.unless_lost(Line::parse(&text))?;
        }
        Ok(())
    }

    /// Makes lines after which the position is not known errors.
    ///
    /// A greeting belongs to a reset. carved resets the controller with a stop, when it is opened and while it takes a reference. Otherwise
    /// somebody else did, and the reset counts as a person's, also before the first reference: it is the emergency stop of a controller
    /// without one. It is announced once, so it is remembered until it is reported.
    fn unless_lost(&mut self, line: Line) -> Result<Line, DeviceError> {
        let sign = match &line {
            Line::Greeting(greeting) => greeting.clone(),
            Line::Alarm(intervention::RESET_IN_MOTION) => alarm_text(intervention::RESET_IN_MOTION),
            _ => return unless_alarm(line),
        };
        self.note_stops();
        let is_late = self.is_identified && self.owed_greetings == 0 && self.own_reset.elapsed() > OWN_GREETING;
        let is_own = self.link.is_stopped() || !(is_late || self.knowledge.is_known() || self.link.is_moving());
        if !is_own {
            let error = intervention::reset(&sign);
            self.knowledge.doubt(&error);
            self.unreported_reset = Some(sign);
            return Err(error);
        }
        match line {
            Line::Greeting(greeting) => {
                self.owed_greetings = self.owed_greetings.saturating_sub(1);
                Err(DeviceError::Suspect { why: format!("the controller restarted: {greeting}") })
            }
            alarm => unless_alarm(alarm),
        }
    }

    /// The error of a reset that was seen where it could not be reported, as while an output was switched.
    pub(super) fn check_no_reset(&mut self) -> Result<(), DeviceError> {
        self.unreported_reset.take().map_or(Ok(()), |sign| Err(intervention::reset(&sign)))
    }
}

impl Dialect {
    /// Whether `greeting` is that of grblHAL. An unknown firmware, or another one than configured, is an error.
    pub(in crate::rotation) fn of(self, greeting: &str) -> Result<bool, DeviceError> {
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

/// Makes an alarm an error.
fn unless_alarm(line: Line) -> Result<Line, DeviceError> {
    match line {
        Line::Alarm(n) => Err(intervention::of_alarm(n).unwrap_or_else(|| DeviceError::Alarm { device: DEVICE, what: alarm_text(n) })),
        other => Ok(other),
    }
}
