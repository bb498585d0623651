//! Requests and their answers, and how host and module find each other again.
//!
//! ```text
//! ask ──► answer of this command, whole ──► value
//!     └─► silence, noise, another's answer, "wrong checksum" ──► flush ──► asked once more
//!
//! flush:  version? ──► its answer, after whatever was late: both ends stand at the beginning of a frame
//!            └──────► none: zeros, one by one, until the module has filled up a frame and complains of it; drained; again
//! ```
//! An answer names its command and nothing more, so that a late one of a position is taken for the next position's. After
//! every disturbance another command is asked first: what comes before its answer is old. Every request of this driver may
//! be sent twice: absolute targets, readings, stops.

use super::frame::{BYTES, Reply, Request, status_text};
use super::{DEVICE, TmclSettings};
use crate::cancel::CancelToken;
use crate::device::DeviceError;
use crate::device::rotation::link::{Link, Stopper};
use std::time::{Duration, Instant};

/// Silence after which nothing more of a burst is coming: longer than the 16 ms that USB adapters hold bytes back.
const SILENCE: Duration = Duration::from_millis(20);
/// Wait for a complaint after each zero.
const ZERO_WAIT: Duration = Duration::from_millis(30);
/// Deadline of a flush in answer times: one for a late answer, one for the zeros, one for the answer after them.
const FLUSH_ANSWER_TIMES: u32 = 3;

pub(super) struct Wire {
    link: Link,
    module: u8,
    host: u8,
    wait: Duration,
}

pub(super) enum Answer {
    Value(i32),
    /// Understood, and not carried out.
    Refused(u8),
    /// Nothing that could be believed.
    Lost(String),
}

pub(super) fn refused(request: Request, status: u8) -> DeviceError {
    let found = format!("status {status} ({})", status_text(status));
    DeviceError::Unexpected { device: DEVICE, expected: format!("an answer to {request}"), found }
}

impl Wire {
    pub fn new(link: Link, settings: &TmclSettings) -> Self {
        Self { link, module: settings.module_address, host: settings.host_address, wait: settings.answer_timeout() }
    }

    pub fn stopper(&self) -> Stopper {
        self.link.stopper()
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
        let mut answer = self.once(request, self.wait)?;
        if let Answer::Lost(why) = &answer {
            tracing::debug!(device = DEVICE, %request, why, "asked again");
            self.flush()?;
            answer = self.once(request, self.wait)?;
        }
        match answer {
            Answer::Value(value) => Ok(value),
            Answer::Refused(status) => Err(refused(request, status)),
            Answer::Lost(found) => Err(DeviceError::Unexpected { device: DEVICE, expected: format!("an answer to {request}"), found }),
        }
    }

    /// What comes of one request; after [`Answer::Lost`] nothing may be asked but a flush.
    pub fn once(&mut self, request: Request, wait: Duration) -> Result<Answer, DeviceError> {
        self.link.send(&request.encode(self.module))?;
        let Some(bytes) = self.link.exact::<BYTES>(Instant::now() + wait)? else {
            return Ok(Answer::Lost(format!("nothing within {} ms", wait.as_millis())));
        };
        Ok(match self.decode(bytes) {
            Some(Reply { command, status: 100, value, .. }) if command == request.command => Answer::Value(value),
            Some(Reply { command, status: status @ (2..=6 | 128), .. }) if command == request.command => Answer::Refused(status),
            _ => Answer::Lost(format!("{bytes:02x?}")),
        })
    }

    fn decode(&self, bytes: [u8; BYTES]) -> Option<Reply> {
        Reply::decode(bytes).filter(|reply| (reply.host, reply.module) == (self.host, self.module))
    }

    /// Forgets what came unasked.
    pub fn hush(&mut self) -> Result<(), DeviceError> {
        self.link.quiet(Duration::ZERO, Instant::now() + self.wait)
    }

    /// Makes sure that nothing old is under way and that both ends stand at the beginning of a frame; returns type and
    /// version of the module.
    pub fn flush(&mut self) -> Result<i32, DeviceError> {
        let began = Instant::now();
        let deadline = began + FLUSH_ANSWER_TIMES * self.wait;
        while Instant::now() < deadline {
            self.link.quiet(SILENCE, deadline)?;
            if let Some(version) = self.version()? {
                return Ok(version);
            }
            self.fill_up()?;
        }
        Err(DeviceError::Silent { device: DEVICE, request: Request::version().to_string(), waited_ms: began.elapsed().as_millis() })
    }

    fn version(&mut self) -> Result<Option<i32>, DeviceError> {
        let request = Request::version();
        self.link.send(&request.encode(self.module))?;
        while let Some(bytes) = self.link.exact::<BYTES>(Instant::now() + self.wait)? {
            match self.decode(bytes) {
                Some(reply) if (reply.command, reply.status) == (request.command, 100) => return Ok(Some(reply.value)),
                // An answer that was late.
                Some(reply) if reply.status != 1 => {}
                _ => return Ok(None),
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
