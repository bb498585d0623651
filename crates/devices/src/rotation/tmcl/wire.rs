//! Requests and their answers, and how host and module are synchronised again after a disturbance.
//!
//! ```text
//! group of requests ──► an answer to each ──► the mark, another command: its answer next? ──► values and mark
//!                                                └─► one answer too many, and not a copy ──► the group is repeated
//!                └─► silence, noise, "wrong checksum" ──► flush ──► the group is repeated
//!
//! flush:  version? ──► its answer, after late ones: both sides are at the beginning of a frame
//!            └──────► none: zeros, one by one, until the module has completed a frame and rejects it; drained; repeated
//! ```
//! An answer names its command and nothing else. A late or doubled answer with a position can therefore be mistaken for the answer to
//! the next position, and every later answer then comes one too early. So no value counts before a request with another command, the
//! fence, has its own answer and no answer is left over. Before each request the driver drops received bytes: a copy of the last answer
//! is harmless, anything else makes the group void. Every request of this driver may be sent twice: absolute targets, readings, stops.

use super::frame::{BYTES, Reply, Request, status_text};
use super::{DEVICE, TmclSettings};
use crate::DeviceError;
use crate::cancel::CancelToken;
use crate::rotation::link::{Link, Stopper};
use std::time::{Duration, Instant};

/// Silence that ends a burst. It is longer than the 16 ms for which USB adapters hold bytes back.
const SILENCE: Duration = Duration::from_millis(20);
/// Wait for a rejection after each zero.
const ZERO_WAIT: Duration = Duration::from_millis(30);
/// After the rejection of an earlier frame the answer follows within this time, however late both are.
const AFTER_REJECTION: Duration = Duration::from_millis(60);
/// How long a flush waits for a late answer, in answer times.
const LATE_ANSWER_TIMES: f64 = 2.5;
/// Deadline of a flush in answer times: the late answer, the zeros, the answer after them.
const FLUSH_ANSWER_TIMES: u32 = 5;
/// How often a group is sent.
const ATTEMPTS: u32 = 4;

/// The requests of the driver over one link.
pub(super) struct Wire {
    link: Link,
    module: u8,
    host: u8,
    wait: Duration,
    /// The last answer.
    last: [u8; BYTES],
    /// Commands whose answers came before the expected one.
    passed: Vec<u8>,
    /// Bytes other than a copy of the last answer came without a request.
    disturbed: bool,
}

/// The outcome of one request.
pub(super) enum Answer {
    Value(i32),
    /// The module understood the request and refuses it, with this status.
    Refused(u8),
    /// There was no valid answer.
    Lost(String),
}

/// The answers to a group of requests, and the mark that was read after them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Answers<const N: usize> {
    pub values: [i32; N],
    pub mark: i32,
}

/// The outcome of a group of requests.
pub(super) enum GroupReply<const N: usize> {
    Answered(Answers<N>),
    Refused(Request, u8),
    /// Answers came twice or late. Both sides are synchronised again.
    Void(String),
    /// A flush is needed first.
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

    /// See [`Link::first_contact`].
    pub fn first_contact(&self, error: DeviceError) -> DeviceError {
        self.link.first_contact(error)
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

    pub fn pass_latch(&mut self, passes: bool) {
        self.link.pass_latch(passes);
    }

    pub fn halt(&mut self) {
        self.link.halt();
    }

    /// The value in the module's answer.
    pub fn ask(&mut self, request: Request) -> Result<i32, DeviceError> {
        Ok(self.ask_all([request])?.values[0])
    }

    /// The number that the last reference has written; 0 after a reset.
    pub fn mark(&mut self) -> Result<i32, DeviceError> {
        Ok(self.ask_all([])?.mark)
    }

    /// The values in the module's answers. After a loss the next attempt waits longer, which is safe while the pair is at rest.
    pub fn ask_all<const N: usize>(&mut self, requests: [Request; N]) -> Result<Answers<N>, DeviceError> {
        let mut found = String::new();
        let mut wait = self.wait;
        for _ in 0..ATTEMPTS {
            let until = Instant::now() + wait * (N as u32 + 1);
            found = match self.try_all(requests, wait, until)? {
                GroupReply::Answered(answers) => return Ok(answers),
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
        let request = requests.first().map_or_else(|| "the mark".into(), Request::to_string);
        Err(self.link.garbled(request.clone(), format!("an answer to {request}"), found))
    }

    /// Sends a group once. The whole group has until `until`.
    pub fn try_all<const N: usize>(
        &mut self,
        requests: [Request; N],
        wait: Duration,
        until: Instant,
    ) -> Result<GroupReply<N>, DeviceError> {
        // Bytes that came since the last group belong to no group.
        self.link.take_unread()?;
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
            return Ok(GroupReply::Void("one answer too many: one came twice, or late".into()));
        }
        Ok(GroupReply::Answered(Answers { values, mark }))
    }

    /// Sends one request. After [`Answer::Lost`] only a flush may follow.
    pub fn once(&mut self, request: Request, until: Instant) -> Result<Answer, DeviceError> {
        let left = self.link.take_unread()?;
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

    /// Checks that a stopped module answers. Nothing else may be asked of it.
    pub fn sign_of_life(&mut self) -> Result<(), DeviceError> {
        let request = Request::version();
        if self.link.probe_bytes(&request.encode(self.module), self.wait)?.is_empty() {
            return Err(self.link.silent(request.to_string(), self.wait.as_millis()));
        }
        Ok(())
    }

    /// Ensures that no old answer is under way and that both sides are at the beginning of a frame. Returns type and version of the module.
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
        Err(self.link.silent(Request::version().to_string(), began.elapsed().as_millis()))
    }

    /// Like [`Self::flush`], without the wait for late answers. False if that was not enough.
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
                // A late answer.
                Some(reply) if reply.status != 1 => {}
                // A rejection of this request, or of an earlier frame.
                Some(_) => until = until.min(Instant::now() + AFTER_REJECTION),
                None => return Ok(None),
            }
        }
        Ok(None)
    }

    /// Completes the frame of which the module may wait for the rest.
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
