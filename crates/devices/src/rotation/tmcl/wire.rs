//! Requests and their answers, and how host and module find each other again.
//!
//! ```text
//! group of requests ──► an answer to each ──► the mark, another command: its answer next? ──► values and mark
//!                                                └─► an answer too many, and it is not a copy ──► the group is asked again
//!                └─► silence, noise, "wrong checksum" ──► flush ──► the group is asked again
//!
//! flush:  version? ──► its answer, after whatever was late: both ends stand at the beginning of a frame
//!            └──────► none: zeros, one by one, until the module has filled up a frame and complains of it; drained; again
//! ```
//! An answer names its command and nothing more. A late or a doubled answer of a position can therefore be taken for the answer
//! to the next position, and every later answer is then one too early. So no value is believed before a request of another
//! command, the fence, has its own answer and no answer was left over. Before each request the driver forgets what has
//! arrived: a copy of the last answer does no harm, anything else makes the group void. Every request of this driver may be sent
//! twice: absolute targets, readings, stops.

use super::frame::{BYTES, Reply, Request, status_text};
use super::{DEVICE, TmclSettings};
use crate::DeviceError;
use crate::cancel::CancelToken;
use crate::rotation::link::{Link, Stopper};
use std::time::{Duration, Instant};

/// Silence after which nothing more of a burst is coming: longer than the 16 ms that USB adapters hold bytes back.
const SILENCE: Duration = Duration::from_millis(20);
/// Wait for a complaint after each zero.
const ZERO_WAIT: Duration = Duration::from_millis(30);
/// After a complaint of an earlier frame the answer follows within this, however late both are.
const AFTER_COMPLAINT: Duration = Duration::from_millis(60);
/// How long a flush waits for an answer that is late, in answer times.
const LATE_ANSWER_TIMES: f64 = 2.5;
/// Deadline of a flush in answer times: the late answer, the zeros, the answer after them.
const FLUSH_ANSWER_TIMES: u32 = 5;
/// How often a group is asked.
const ATTEMPTS: u32 = 4;

pub(super) struct Wire {
    link: Link,
    module: u8,
    host: u8,
    wait: Duration,
    /// The last answer.
    last: [u8; BYTES],
    /// Answers of other commands that came before the one that was waited for.
    passed: Vec<u8>,
    /// Something else than a copy of the last answer has come unasked.
    disturbed: bool,
}

/// What comes of one request.
pub(super) enum Answer {
    Value(i32),
    /// Understood, and not carried out.
    Refused(u8),
    /// Nothing that could be believed.
    Lost(String),
}

/// The answers to a group of requests, and the mark that was read behind them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Answers<const N: usize> {
    pub values: [i32; N],
    pub mark: i32,
}

/// What comes of a group of requests.
pub(super) enum GroupReply<const N: usize> {
    Answered(Answers<N>),
    Refused(Request, u8),
    /// Answers came twice or late; both ends are in step again.
    Void(String),
    /// A flush has to come first.
    Lost(String),
}

pub(super) fn refused(request: Request, status: u8) -> DeviceError {
    let found = format!("status {status} ({})", status_text(status));
    DeviceError::Unexpected { device: DEVICE, expected: format!("an answer to {request}"), found }
}

impl Wire {
    pub fn new(link: Link, settings: &TmclSettings) -> Self {
        let (module, host, wait) = (settings.module_address, settings.host_address, settings.answer_timeout());
        Self { link, module, host, wait, last: [0; BYTES], passed: Vec::new(), disturbed: false }
    }

    pub fn stopper(&self) -> Stopper {
        self.link.stopper()
    }

    pub fn is_stopped(&self) -> bool {
        self.link.is_stopped()
    }

    pub fn still_there(&mut self) -> Result<(), DeviceError> {
        self.link.still_there()
    }

    pub fn release(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        self.link.release(cancel)
    }

    pub fn halt(&mut self) {
        self.link.halt();
    }

    /// The value that the module answers with.
    pub fn ask(&mut self, request: Request) -> Result<i32, DeviceError> {
        Ok(self.ask_all([request])?.values[0])
    }

    /// The number that was written at the last reference, 0 after a reset.
    pub fn mark(&mut self) -> Result<i32, DeviceError> {
        Ok(self.ask_all([])?.mark)
    }

    /// The values that the module answers with. What was lost is waited for longer when it is asked for again: the pair stands, or
    /// stands at its target.
    pub fn ask_all<const N: usize>(&mut self, requests: [Request; N]) -> Result<Answers<N>, DeviceError> {
        let mut found = String::new();
        let mut wait = self.wait;
        for _ in 0..ATTEMPTS {
            let until = Instant::now() + wait * (N as u32 + 1);
            found = match self.try_all(requests, wait, until)? {
                GroupReply::Answered(told) => return Ok(told),
                GroupReply::Refused(request, status) => return Err(refused(request, status)),
                GroupReply::Void(why) => why,
                GroupReply::Lost(why) => {
                    self.flush()?;
                    wait = self.wait.mul_f64(LATE_ANSWER_TIMES);
                    why
                }
            };
            tracing::debug!(device = DEVICE, why = found, "asked again");
        }
        let expected = requests.first().map_or_else(|| "an answer to the mark".into(), |request| format!("an answer to {request}"));
        Err(DeviceError::Unexpected { device: DEVICE, expected, found })
    }

    /// Asks a group once, all of it until `until`.
    pub fn try_all<const N: usize>(
        &mut self,
        requests: [Request; N],
        wait: Duration,
        until: Instant,
    ) -> Result<GroupReply<N>, DeviceError> {
        // What has come since the last group belongs to none.
        self.link.unasked()?;
        (self.disturbed, self.last) = (false, [0; BYTES]);
        self.passed.clear();
        let mut values = [0; N];
        for (value, request) in values.iter_mut().zip(requests) {
            *value = match self.once(request, until.min(Instant::now() + wait))? {
                Answer::Value(value) => value,
                Answer::Refused(status) => return Ok(GroupReply::Refused(request, status)),
                Answer::Lost(why) => return Ok(GroupReply::Lost(why)),
            };
        }
        let mark = match self.once(Request::mark(), until.min(Instant::now() + wait))? {
            Answer::Value(mark) => mark,
            Answer::Refused(status) => return Ok(GroupReply::Refused(Request::mark(), status)),
            Answer::Lost(why) => return Ok(GroupReply::Lost(why)),
        };
        if self.disturbed || requests.iter().any(|request| self.passed.contains(&request.command)) {
            return Ok(GroupReply::Void("an answer too many: one came twice, or late".into()));
        }
        Ok(GroupReply::Answered(Answers { values, mark }))
    }

    /// What comes of one request; after [`Answer::Lost`] nothing may be asked but a flush.
    pub fn once(&mut self, request: Request, until: Instant) -> Result<Answer, DeviceError> {
        let left = self.link.unasked()?;
        self.disturbed |= left.chunks(BYTES).any(|frame| frame != self.last);
        let asked = Instant::now();
        self.link.send(&request.encode(self.module))?;
        while let Some(bytes) = self.link.exact::<BYTES>(until)? {
            match self.decode(bytes) {
                Some(Reply { command, status: 100, value, .. }) if command == request.command => {
                    self.last = bytes;
                    return Ok(Answer::Value(value));
                }
                Some(Reply { command, status: status @ (2..=6 | 128), .. }) if command == request.command => {
                    return Ok(Answer::Refused(status));
                }
                // The answer to an earlier request.
                Some(Reply { command, status: 100, .. }) if command != request.command => self.passed.push(command),
                _ => return Ok(Answer::Lost(format!("{bytes:02x?}"))),
            }
        }
        Ok(Answer::Lost(format!("nothing within {} ms", until.saturating_duration_since(asked).as_millis())))
    }

    fn decode(&self, bytes: [u8; BYTES]) -> Option<Reply> {
        Reply::decode(bytes).filter(|reply| (reply.host, reply.module) == (self.host, self.module))
    }

    /// Whether a module answers that was stopped, and must be asked for nothing else.
    pub fn sign_of_life(&mut self) -> Result<(), DeviceError> {
        let request = Request::version();
        if self.link.probe_bytes(&request.encode(self.module), self.wait)?.is_empty() {
            return Err(DeviceError::Silent { device: DEVICE, request: request.to_string(), waited_ms: self.wait.as_millis() });
        }
        Ok(())
    }

    /// Makes sure that nothing old is under way and that both ends stand at the beginning of a frame; returns type and
    /// version of the module.
    pub fn flush(&mut self) -> Result<i32, DeviceError> {
        let began = Instant::now();
        let deadline = began + FLUSH_ANSWER_TIMES * self.wait;
        let mut wait = self.wait.mul_f64(LATE_ANSWER_TIMES);
        while Instant::now() < deadline {
            self.link.quiet(SILENCE, deadline)?;
            if let Some(version) = self.version(Instant::now() + wait)? {
                return Ok(version);
            }
            self.fill_up()?;
            wait = self.wait;
        }
        Err(DeviceError::Silent { device: DEVICE, request: Request::version().to_string(), waited_ms: began.elapsed().as_millis() })
    }

    /// Like [`Self::flush`], without the wait for what is late; false where that was not enough.
    pub fn resync(&mut self, until: Instant) -> Result<bool, DeviceError> {
        self.link.quiet(SILENCE, until)?;
        Ok(self.version(until)?.is_some())
    }

    fn version(&mut self, until: Instant) -> Result<Option<i32>, DeviceError> {
        let request = Request::version();
        self.link.send(&request.encode(self.module))?;
        let mut until = until;
        while let Some(bytes) = self.link.exact::<BYTES>(until)? {
            match self.decode(bytes) {
                Some(reply) if (reply.command, reply.status) == (request.command, 100) => return Ok(Some(reply.value)),
                // An answer that was late.
                Some(reply) if reply.status != 1 => {}
                // A complaint: of this request, or of an earlier frame.
                Some(_) => until = until.min(Instant::now() + AFTER_COMPLAINT),
                None => return Ok(None),
            }
        }
        Ok(None)
    }

    /// Fills up the frame that the module may be waiting for.
    fn fill_up(&mut self) -> Result<(), DeviceError> {
        for _ in 0..BYTES {
            self.link.send(&[0])?;
            if self.link.exact::<1>(Instant::now() + ZERO_WAIT)?.is_some() {
                break;
            }
        }
        Ok(())
    }
}
