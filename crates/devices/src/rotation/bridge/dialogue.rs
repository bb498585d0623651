//! Requests to the bridge and their answers.
//!
//! ```text
//!  X? ──► OK, four lines of settings       TT ──► OK ······► R1        E0 to E3 instead of an OK
//! ```
//! An arrival does not name its trigger. Its meaning depends on the situation: the first stop before any trigger, the end of a turn
//! while one is waited for, and a fault otherwise.

use super::message::{self, Message};
use super::{DEVICE, VastBridgeSettings};
use crate::cancel::CancelToken;
use crate::rotation::link::{Link, Stop};
use crate::{DeviceError, StopHandle};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Number of questions until an answer must have come. A controller that restarts when its port is opened ignores them for up to two
/// seconds.
const WAKE_ATTEMPTS: u32 = 8;
/// Lines of settings after the `OK` to `X?`.
const SETTINGS_LINES: usize = 4;

/// The connection to the bridge.
pub(super) struct Dialogue {
    link: Link,
    answer_timeout: Duration,
    heard: VecDeque<Message>,
    /// Arrivals at the first stop that came before they were waited for.
    pub arrivals: u32,
}

impl Dialogue {
    pub fn open(settings: &VastBridgeSettings) -> Result<Self, DeviceError> {
        // No message stops VAST, so a stop only latches.
        let link = Link::serial(DEVICE, &settings.port, settings.baud, Stop::default())?;
        Ok(Self { link, answer_timeout: settings.answer_timeout(), heard: VecDeque::new(), arrivals: 0 })
    }

    /// See [`Link::first_contact`].
    pub fn first_contact(&self, error: DeviceError) -> DeviceError {
        self.link.first_contact(error)
    }

    pub fn still_there(&mut self) -> Result<(), DeviceError> {
        self.link.still_there()
    }

    pub fn stop_handle(&self) -> StopHandle {
        let stopper = self.link.stopper();
        let link = stopper.link();
        StopHandle::new(move || stopper.stop()).with_link(link)
    }

    pub fn is_stopped(&self) -> bool {
        self.link.is_stopped()
    }

    pub fn release(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        self.link.release(cancel)
    }

    /// Drops all messages until now, and those that still come until the bridge is silent for `silence`.
    pub fn forget(&mut self, silence: Duration) -> Result<(), DeviceError> {
        self.link.quiet(silence, Instant::now() + self.answer_timeout.max(silence))?;
        self.heard.clear();
        self.arrivals = 0;
        Ok(())
    }

    /// Asks for the bridge's settings until it answers.
    pub fn greet(&mut self) -> Result<Vec<String>, DeviceError> {
        let wait = self.answer_timeout;
        let mut error = None;
        for asked in 1..=WAKE_ATTEMPTS {
            self.link.send(b"X?\n")?;
            let until = Instant::now() + wait;
            let mut lines = Vec::new();
            while lines.len() < SETTINGS_LINES {
                match self.next(until)? {
                    Some(Message::Other(line)) if line.chars().all(|c| c == ' ' || c.is_ascii_graphic()) => lines.push(line),
                    Some(Message::Arrived) => self.arrivals += 1,
                    Some(Message::Error(number)) => error = Some(number),
                    // A greeting, the answer's `OK`, noise: only the lines prove an answer.
                    Some(_) => {}
                    None => break,
                }
            }
            if lines.len() == SETTINGS_LINES {
                if asked > 1 {
                    self.hear_out()?;
                }
                return Ok(lines);
            }
        }
        let waited_ms = u128::from(WAKE_ATTEMPTS) * wait.as_millis();
        Err(error.map_or_else(|| self.link.silent("X?", waited_ms), refused))
    }

    /// Waits for late answers to a repeated question. Their `OK` would count as that of the next trigger.
    fn hear_out(&mut self) -> Result<(), DeviceError> {
        while let Some(message) = self.next(Instant::now() + self.answer_timeout)? {
            self.arrivals += u32::from(message == Message::Arrived);
        }
        Ok(())
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

    /// The next message that has already arrived.
    fn next_now(&mut self) -> Result<Option<Message>, DeviceError> {
        loop {
            if let Some(message) = self.heard.pop_front() {
                return Ok(Some(message));
            }
            let Some(line) = self.link.line_now()? else { return Ok(None) };
            self.heard.extend(message::of(&line));
        }
    }

    /// Counts arrivals while VAST follows no list.
    pub fn listen(&mut self) -> Result<(), DeviceError> {
        while let Some(message) = self.next_now()? {
            match message {
                Message::Arrived => self.arrivals += 1,
                Message::Error(number) => return Err(refused(number)),
                Message::Ok | Message::Second | Message::Other(_) => {}
            }
        }
        Ok(())
    }

    /// Reads the messages that came while VAST was at rest. None is expected then.
    pub fn catch_up(&mut self) -> Result<(), DeviceError> {
        while let Some(message) = self.next_now()? {
            match message {
                Message::Arrived => return Err(out_of_step("VAST reported an arrival that no trigger explains")),
                Message::Ok => return Err(restarted()),
                Message::Error(number) => return Err(refused(number)),
                Message::Second | Message::Other(_) => {}
            }
        }
        Ok(())
    }

    /// Triggers once. Returns the time at which the trigger was sent.
    pub fn trigger(&mut self) -> Result<Instant, DeviceError> {
        self.catch_up()?;
        let wait = self.answer_timeout;
        let sent = Instant::now();
        self.link.send(b"TT\n")?;
        loop {
            match self.next(sent + wait)? {
                Some(Message::Ok) => return Ok(sent),
                Some(Message::Arrived) => return Err(out_of_step("VAST reported an arrival before the trigger was acknowledged")),
                Some(Message::Error(number)) => return Err(refused(number)),
                Some(Message::Second | Message::Other(_)) => {}
                None => return Err(self.link.silent("TT", wait.as_millis())),
            }
        }
    }

    /// Waits for the one arrival, between `soonest` and `latest` after `since`.
    pub fn arrive(&mut self, since: Instant, soonest: Duration, latest: Duration) -> Result<(), DeviceError> {
        loop {
            match self.next(since + latest)? {
                Some(Message::Arrived) => {
                    let took = since.elapsed();
                    if took < soonest {
                        return Err(out_of_step(&format!(
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
}

pub(super) fn out_of_step(why: &str) -> DeviceError {
    DeviceError::OutOfStep { why: why.into() }
}

/// An `OK` to no request is the greeting of a restart. carved never restarts the bridge, so somebody else did.
fn restarted() -> DeviceError {
    DeviceError::Intervention {
        device: DEVICE,
        what: "the bridge was reset, or VAST was triggered, but not by carved (an OK came without a request)".into(),
        way_out: "Find out who reset it. End the list at VAST, then acknowledge the fault and let the run go on",
    }
}

/// The bridge's firmware reports an input or request that it could not serve, by a number only.
fn refused(number: u8) -> DeviceError {
    DeviceError::Alarm { device: DEVICE, what: format!("its error E{number}: a request or VAST's answer to it failed") }
}
