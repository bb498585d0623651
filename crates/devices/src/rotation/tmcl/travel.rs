//! Moves of the pair, and the checks while they last.
//!
//! ```text
//! travel ── start both ──► watch ─┬─ look ── skew, off the path or a reset, twice ──► both stopped, the cause is looked for
//!                                 ├─ no look for blind_time ── stop, read at rest ──► start both again, at most four times
//!                                 └─ both at the target, speeds 0 ──────────────────► arrived
//! search ── start both ──► both find their switches; the later one may be late by the permitted skew
//! ```

use super::frame::{Request, parameter};
use super::wire::{Answer, Answers, GroupReply, refused};
use super::{DEVICE, Tmcl};
use crate::DeviceError;
use carved_core::units::Steps;
use std::time::{Duration, Instant};

/// Pause between two looks at a turning pair.
const LOOK_AGAIN: Duration = Duration::from_millis(1);
/// Longest wait for each speed of a pair that must be stopped.
const SPEED_WAIT: Duration = Duration::from_millis(15);
/// Equal looks at a motor short of its target until it counts as being at rest. A ramp takes a moment to begin.
const STANDING_LOOKS: u32 = 4;
/// How often one move may be stopped and sent on because no look succeeded.
const MOST_BLIND_STOPS: u32 = 4;

/// Both counters: the first was read before and after the second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Look {
    before: i64,
    second: i64,
    after: i64,
    /// The mark that was read after them.
    mark: i32,
}

impl From<Answers<3>> for Look {
    fn from(Answers { values: [before, second, after], mark }: Answers<3>) -> Self {
        Self { before: before.into(), second: second.into(), after: after.into(), mark }
    }
}

impl Look {
    fn pair(self) -> [i64; 2] {
        [self.after, self.second]
    }

    fn both_at(self, place: i64) -> bool {
        [self.before, self.second, self.after] == [place; 3]
    }

    fn between(self, from: i64, to: i64) -> bool {
        [self.before, self.second, self.after].iter().all(|p| (from.min(to)..=from.max(to)).contains(p))
    }

    /// The least skew that fits these readings, at whatever moment in between the second was read.
    fn skew(self) -> u64 {
        let (low, high) = (self.before.min(self.after), self.before.max(self.after));
        self.second.abs_diff(self.second.clamp(low, high))
    }
}

/// The module was reset. carved never resets it, so somebody else did, or its supply was off.
fn was_reset() -> DeviceError {
    DeviceError::Intervention {
        device: DEVICE,
        what: "the module was reset, but not by carved (the number that the last reference wrote is gone)".into(),
        way_out: "Find out who reset it, or why it restarted. When the axis may turn, acknowledge the fault and let the run go on: it begins \
                  with a reference",
    }
}

fn was_cleared(place: i64) -> DeviceError {
    DeviceError::Intervention {
        device: DEVICE,
        what: format!("the position counters were set to 0, but not by carved (they were left at {place})"),
        way_out: "Find out which program uses the module, and exit it. Then acknowledge the fault and let the run go on: it begins with a \
                  reference",
    }
}

fn off_its_way(look: Look, from: i64, to: i64) -> DeviceError {
    let [first, second] = look.pair();
    DeviceError::Suspect { why: format!("on the way from {from} to {to} the motors count {first} and {second}") }
}

/// How often both motors are started, if the module acknowledges the first start too late.
const MOST_STARTS: u32 = 2;

/// How a pair is sent to its target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    /// The longest time of the way.
    pub wait: Duration,
    /// The speed has to be constant: a pair that was stopped is not sent on.
    pub is_even: bool,
}

impl Pace {
    fn tries(self) -> u32 {
        if self.is_even { 1 } else { MOST_STARTS }
    }

    fn most_blind_stops(self) -> u32 {
        if self.is_even { 0 } else { MOST_BLIND_STOPS }
    }
}

impl Tmcl {
    fn questions(&self) -> [Request; 3] {
        let [first, second] = self.settings.motors.map(|motor| Request::get(parameter::ACTUAL_POSITION, motor));
        [first, second, first]
    }

    /// A look at a pair at rest.
    fn look(&mut self) -> Result<Look, DeviceError> {
        Ok(self.wire.ask_all(self.questions())?.into())
    }

    /// A look at a turning pair; `None` if no valid answer came until `until`.
    fn glimpse(&mut self, until: Instant) -> Result<Option<Look>, DeviceError> {
        while Instant::now() < until {
            match self.wire.try_all(self.questions(), self.settings.answer_timeout(), until)? {
                GroupReply::Answered(answers) => return Ok(Some(answers.into())),
                GroupReply::Refused(request, status) => return Err(refused(request, status)),
                GroupReply::Void(why) => tracing::debug!(device = DEVICE, why, "asked again"),
                GroupReply::Lost(why) => {
                    tracing::debug!(device = DEVICE, why, "asked again");
                    if Instant::now() >= until || !self.wire.resync(until)? {
                        return Ok(None);
                    }
                }
            }
        }
        Ok(None)
    }

    fn speed_questions(&self) -> [Request; 2] {
        self.settings.motors.map(|motor| Request::get(parameter::ACTUAL_SPEED, motor))
    }

    fn speeds(&mut self) -> Result<[i32; 2], DeviceError> {
        Ok(self.wire.ask_all(self.speed_questions())?.values)
    }

    fn max_skew(&self) -> u64 {
        self.settings.max_skew_steps.into()
    }

    fn skewed(&self, [first, second]: [i64; 2]) -> DeviceError {
        DeviceError::Skew { device: DEVICE, first: Steps(first), second: Steps(second), limit: self.settings.max_skew_steps }
    }

    /// Checks that the module was not reset since the reference.
    pub(super) fn check_mark(&mut self) -> Result<(), DeviceError> {
        if self.wire.mark()? == self.mark || self.wire.mark()? == self.mark { Ok(()) } else { Err(was_reset()) }
    }

    /// Confirms that both motors rest at `place`. Anything else must be read twice before it is an error.
    pub(super) fn confirm(&mut self, place: i64) -> Result<(), DeviceError> {
        let stands = |look: Look, mark| look.both_at(place) && look.mark == mark;
        if stands(self.look()?, self.mark) {
            return Ok(());
        }
        let look = self.look()?;
        if stands(look, self.mark) {
            return Ok(());
        }
        if look.mark != self.mark {
            return Err(was_reset());
        }
        if look.skew() > self.max_skew() {
            return Err(self.skewed(look.pair()));
        }
        let off = look.pair().into_iter().find(|p| *p != place).unwrap_or(look.before);
        Err(DeviceError::Missed { target: Steps(place), achieved: Steps(off) })
    }

    /// Confirms that nobody has reset the module or cleared its counters since it was left at `place`.
    pub(super) fn check_as_left(&mut self, place: i64) -> Result<(), DeviceError> {
        let cleared = |look: Look| place != 0 && look.both_at(0);
        let look = self.look()?;
        if look.mark != self.mark {
            self.check_mark()?;
        }
        if cleared(look) && cleared(self.look()?) { Err(was_cleared(place)) } else { Ok(()) }
    }

    /// Turns the pair from one position to another and returns once it has arrived. `begun` is called once both motors turn, with the time
    /// before the first was started.
    pub(super) fn travel(&mut self, from: i64, to: i64, pace: Pace, begun: impl FnOnce(Instant)) -> Result<(), DeviceError> {
        match self.confirm(from) {
            Err(DeviceError::Missed { achieved: Steps(0), .. }) => return Err(was_cleared(from)),
            confirmed => confirmed?,
        }
        if from == to {
            return Ok(());
        }
        let beyond = |_| DeviceError::Unexpected {
            device: DEVICE,
            expected: format!("a target within {} of the reference", Steps(i32::MAX.into())),
            found: Steps(to).to_string(),
        };
        let target = i32::try_from(to).map_err(beyond)?;
        self.in_flight = true;
        let sent = self.start_pair(pace.tries(), |motor| Request::go(motor, target))?;
        begun(sent);
        self.watch(from, to, pace)?;
        self.in_flight = false;
        Ok(())
    }

    /// Starts both motors, one after the other, and returns the time before the first. If an answer comes so late that one motor alone may
    /// exceed the permitted skew, both are stopped, and started again while there are `tries`.
    fn start_pair(&mut self, tries: u32, request: impl Fn(u8) -> Request) -> Result<Instant, DeviceError> {
        let mut lost = String::new();
        for _ in 0..tries {
            let mut started = 0;
            let sent = Instant::now();
            // One deadline for both: the first motor turns alone until the second starts.
            let until = sent + self.settings.start_time();
            for motor in self.settings.motors {
                match self.wire.once(request(motor), until)? {
                    Answer::Value(_) => started += 1,
                    Answer::Refused(status) => return Err(refused(request(motor), status)),
                    Answer::Lost(why) => {
                        self.wire.halt();
                        self.wire.flush()?;
                        lost = why;
                        break;
                    }
                }
            }
            if started == self.settings.motors.len() {
                return Ok(sent);
            }
        }
        Err(DeviceError::Unexpected { device: DEVICE, expected: "both motors to start".into(), found: lost })
    }

    /// Stops a pair after failed looks, and looks at it at rest.
    fn stop_and_look(&mut self) -> Result<Look, DeviceError> {
        self.wire.halt();
        self.wire.flush()?;
        self.stop_and_rest()?;
        let look = self.look_at_rest()?;
        if look.skew() > self.max_skew() { Err(self.skewed(look.pair())) } else { Ok(look) }
    }

    /// Looks until both counters are at the target and both speeds are 0. If no look succeeds in the time in which the skew could exceed
    /// its limit, the pair is stopped, read at rest, and sent on.
    fn watch(&mut self, from: i64, to: i64, pace: Pace) -> Result<(), DeviceError> {
        let mut until = Instant::now() + pace.wait;
        let mut doubted = false;
        let mut last = None;
        let mut standing = 0;
        let mut blind_stops = 0;
        let mut seen = Instant::now();
        loop {
            let asked = Instant::now();
            let Some(look) = self.glimpse(seen + self.settings.blind_time())? else {
                blind_stops += 1;
                let look = self.stop_and_look()?;
                if look.mark != self.mark {
                    self.check_mark()?;
                }
                if !look.between(from, to) {
                    return Err(off_its_way(look, from, to));
                }
                if blind_stops > pace.most_blind_stops() {
                    let expected = format!("answers of the module within {} ms", self.settings.blind_time().as_millis());
                    let found = format!("later ones, {blind_stops} times in one move; both motors were stopped");
                    return Err(DeviceError::Unexpected { device: DEVICE, expected, found });
                }
                let target = i32::try_from(to).unwrap_or(i32::MAX);
                tracing::info!(device = DEVICE, at = look.after, to, "no answers came about the pair: it was stopped, and is sent on");
                self.start_pair(pace.tries(), |motor| Request::go(motor, target))?;
                seen = Instant::now();
                until = seen + pace.wait;
                (doubted, last, standing) = (false, None, 0);
                continue;
            };
            seen = asked;
            if look.skew() > self.max_skew() || !look.between(from, to) || look.mark != self.mark {
                if std::mem::replace(&mut doubted, true) {
                    return Err(self.gone_astray(look, from, to));
                }
                continue;
            }
            doubted = false;
            standing = if last == Some(look) { standing + 1 } else { 0 };
            if look.both_at(to) || standing >= STANDING_LOOKS {
                match self.speeds()? {
                    [0, 0] if look.both_at(to) => return Ok(()),
                    [0, 0] => return Err(self.why_short(look, to)),
                    _ => standing = 0,
                }
                seen = Instant::now();
            }
            last = Some(look);
            if Instant::now() > until {
                // The look at rest reports too much skew, which needs a person.
                let look = self.stop_and_look()?;
                let expected = format!("both motors at {to} before the deadline of their speed");
                let [first, second] = look.pair();
                return Err(DeviceError::Unexpected { device: DEVICE, expected, found: format!("{first} and {second}") });
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    /// After too much skew or a counter off its path: stops both motors, then looks for the cause.
    fn gone_astray(&mut self, look: Look, from: i64, to: i64) -> DeviceError {
        // The speeds show which motor is held only while the other still turns. This must not delay the stop.
        let speeds = self.wire.try_all(self.speed_questions(), SPEED_WAIT, Instant::now() + 2 * SPEED_WAIT);
        self.wire.halt();
        let cause = self.wire.flush().and_then(|_| {
            self.check_mark()?;
            match speeds {
                Ok(GroupReply::Answered(answers)) => self.obstacle(look, to, answers.values),
                _ => Ok(None),
            }
        });
        match cause {
            Err(error) | Ok(Some(error)) => error,
            Ok(None) if look.skew() > self.max_skew() => self.skewed(look.pair()),
            Ok(None) => off_its_way(look, from, to),
        }
    }

    /// The cause why both motors rest short of the target.
    fn why_short(&mut self, look: Look, to: i64) -> DeviceError {
        match self.check_mark().and_then(|()| self.obstacle(look, to, [0, 0])) {
            Err(error) | Ok(Some(error)) => error,
            Ok(None) => {
                let off = look.pair().into_iter().find(|p| *p != to).unwrap_or(look.before);
                DeviceError::Missed { target: Steps(to), achieved: Steps(off) }
            }
        }
    }

    /// The limit switch or the stall that holds a motor short of its target, if any.
    fn obstacle(&mut self, look: Look, to: i64, speeds: [i32; 2]) -> Result<Option<DeviceError>, DeviceError> {
        for ((motor, at), speed) in self.settings.motors.into_iter().zip(look.pair()).zip(speeds) {
            if at == to || speed != 0 {
                continue;
            }
            for (number, side) in [(parameter::RIGHT_LIMIT, "right"), (parameter::LEFT_LIMIT, "left")] {
                if self.wire.ask(Request::get(number, motor))? != 0 {
                    let what = format!("that motor {motor} stands on its {side} limit switch, at {at} on its way to {to}");
                    return Ok(Some(DeviceError::Alarm { device: DEVICE, what }));
                }
            }
            if self.settings.stop_on_stall.is_some() {
                let evidence = format!("load value {}", self.wire.ask(Request::get(parameter::LOAD, motor))?);
                let (at, target) = (Steps(at), Steps(to));
                return Ok(Some(DeviceError::Stalled { device: DEVICE, motor: format!("motor {motor}"), at, target, evidence }));
            }
        }
        Ok(None)
    }

    /// Ends all motions and targets of both motors, and waits until they rest.
    pub(super) fn stop_and_rest(&mut self) -> Result<(), DeviceError> {
        self.wire.ask_all(self.settings.motors.map(Request::stop))?;
        let until = Instant::now() + self.settings.travel_time(0);
        while self.speeds()? != [0, 0] {
            if Instant::now() > until {
                let expected = "both motors to stand after a stop".into();
                return Err(DeviceError::Unexpected { device: DEVICE, expected, found: format!("speeds {:?}", self.speeds()?) });
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        Ok(())
    }

    /// A look at a pair at rest, which a second look must confirm.
    fn look_at_rest(&mut self) -> Result<Look, DeviceError> {
        let mut before = self.look()?;
        for _ in 0..STANDING_LOOKS {
            let look = self.look()?;
            if look == before && look.before == look.after {
                return Ok(look);
            }
            before = look;
        }
        let [first, second] = before.pair();
        let found = format!("{first} and {second}, and other positions in each of {} looks", STANDING_LOOKS + 1);
        Err(DeviceError::Unexpected { device: DEVICE, expected: "motors that stand".into(), found })
    }

    /// Makes the present position step 0. A small skew, as after a stop, is removed first.
    pub(super) fn take_here(&mut self) -> Result<(), DeviceError> {
        let look = self.look_at_rest()?;
        self.mark = look.mark;
        let [first, second] = look.pair();
        if look.skew() > self.max_skew() {
            return Err(self.skewed([first, second]));
        }
        if first != second {
            self.wire.ask(Request::go(self.settings.motors[1], first as i32))?;
            self.watch(second, first, Pace { wait: self.settings.travel_time(first - second), is_even: false })?;
        }
        // In positioning mode a motor would follow its changed counter to the old target.
        self.stop_and_rest()?;
        self.wire.ask_all(self.settings.motors.map(|motor| Request::set(parameter::ACTUAL_POSITION, motor, 0)))?;
        Ok(())
    }

    /// Whether each motor still searches its switch. The end of a search must be read twice.
    fn searching(&mut self) -> Result<[bool; 2], DeviceError> {
        let questions = self.settings.motors.map(Request::searching);
        let searching = self.wire.ask_all(questions)?.values.map(|state| state != 0);
        if searching == [true, true] {
            return Ok(searching);
        }
        let again = self.wire.ask_all(questions)?.values.map(|state| state != 0);
        Ok([searching[0] || again[0], searching[1] || again[1]])
    }

    /// Both motors search their switches at the same time. A motor that has lost steps comes to its switch late.
    pub(super) fn search(&mut self) -> Result<(), DeviceError> {
        let limit = self.max_skew();
        let until = Instant::now() + self.settings.homing_timeout();
        let began = self.look_at_rest()?;
        // With the mark, the counters are those of a reference, and their skew means a twisted capillary. This is reported once. After
        // that the search itself shows which motor comes late.
        if began.mark & !0xffff == super::MARK && began.skew() > limit && !self.skew_reported {
            return Err(self.skewed(began.pair()));
        }
        // From here to the end of the search the counters do not show the skew.
        self.mark = 0;
        self.wire.ask(Request::set_mark(0))?;
        self.start_pair(MOST_STARTS, Request::search)?;
        // The first two positions of each motor after the other has found its switch: two, because one reading may be wrong.
        let mut late: [Vec<i64>; 2] = [Vec::new(), Vec::new()];
        let mut doubted = false;
        loop {
            let searching = self.searching()?;
            let look = self.look()?;
            // A counter jumps to 0 at the switch. So a motor is compared with its own earlier position, or with one that still searches.
            let apart = match searching {
                [false, false] => break,
                [true, true] => {
                    let (before, after) = (look.before - began.after, look.after - began.after);
                    let travelled = Look { before, second: look.second - began.second, after, mark: look.mark };
                    (travelled.skew() > limit).then(|| travelled.pair())
                }
                [first_searches, _] => {
                    let motor = usize::from(!first_searches);
                    let at = look.pair()[motor];
                    if late[motor].len() < 2 {
                        late[motor].push(at);
                    }
                    let since = late[motor].iter().copied().min_by_key(|since| at.abs_diff(*since)).unwrap_or(at);
                    (at.abs_diff(since) > limit).then(|| if first_searches { [at - since, 0] } else { [0, at - since] })
                }
            };
            if let Some(pair) = apart {
                if std::mem::replace(&mut doubted, true) {
                    return Err(self.skewed(pair));
                }
                continue;
            }
            doubted = false;
            if Instant::now() > until {
                let waited_ms = self.settings.homing_timeout().as_millis();
                return Err(DeviceError::Late { device: DEVICE, what: "the motors did not find their reference switches", waited_ms });
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        Ok(())
    }
}
