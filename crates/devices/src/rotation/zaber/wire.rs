//! Commands and their replies, matched by message id.
//!
//! ```text
//! ask ──► the reply of this id ──► accepted: data and flag
//!     │                        └─► refused: the controller's reason, as an error
//!     ├─► replies of other ids, alerts, information, noise: ignored
//!     └─► nothing in time, or without a checksum ──► sent once more, with another id
//! ```
//! A late reply carries the id of its own command and answers no other. Readings, settings and stops may be sent twice. A motion
//! is sent once ([`Wire::begin`]): a second one would interrupt the first, and the controller would report an intervention.

use super::packet::{self, Line, Reply};
use super::{DEVICE, ZaberSettings};
use crate::DeviceError;
use crate::cancel::CancelToken;
use crate::rotation::link::{Link, Stopper};
use std::time::{Duration, Instant};

const IDS: u8 = 100;

/// The name of a command in messages. The empty command asks for the state.
fn request(command: &str) -> String {
    if command.is_empty() { "its state".to_owned() } else { command.to_owned() }
}

/// A refusal as an error, with the controller's reason.
fn accepted(reply: Reply, command: &str) -> Result<Reply, DeviceError> {
    if reply.accepted {
        return Ok(reply);
    }
    let expected = format!("OK to {:?}", request(command));
    Err(DeviceError::Unexpected { device: DEVICE, expected, found: format!("RJ {}", reply.data) })
}

/// The requests of the driver over one link.
pub(super) struct Wire {
    link: Link,
    device: u8,
    axis: u8,
    wait: Duration,
    id: u8,
    /// The last answer had no checksum.
    bare: bool,
}

impl Wire {
    pub fn new(link: Link, settings: &ZaberSettings) -> Self {
        // The first command is number 0.
        Self { link, device: settings.device, axis: settings.axis, wait: settings.answer_timeout(), id: IDS - 1, bare: false }
    }

    pub fn stopper(&self) -> Stopper {
        self.link.stopper()
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

    /// The reply to a command to the axis. A refusal is an error.
    pub fn ask(&mut self, command: &str) -> Result<Reply, DeviceError> {
        self.ask_of(self.axis, command)
    }

    /// The reply to a command to the whole device. A refusal is an error.
    pub fn ask_device(&mut self, command: &str) -> Result<Reply, DeviceError> {
        self.ask_of(0, command)
    }

    /// Whether the axis accepts a command.
    pub fn is_accepted(&mut self, command: &str) -> Result<bool, DeviceError> {
        Ok(self.reply_to(self.axis, command)?.accepted)
    }

    /// Sends a motion once. False if no reply came: the controller may have received it or not.
    ///
    /// # Errors
    /// The controller refuses it.
    pub fn begin(&mut self, command: &str) -> Result<bool, DeviceError> {
        match self.once(self.axis, command)? {
            Some(reply) => accepted(reply, command).map(|_reply| true),
            None => Ok(false),
        }
    }

    /// Asks the axis a question that moves nothing, also while a stop is latched. A reply without a checksum counts.
    pub fn probe(&mut self, command: &str) -> Result<Reply, DeviceError> {
        for _ in 0..2 {
            self.id = (self.id + 1) % IDS;
            let mine = (self.device, self.axis, Some(self.id));
            let lines = self.link.probe(packet::command(self.device, self.axis, self.id, command).as_bytes(), self.wait)?;
            for line in &lines {
                if let Line::Reply(reply) | Line::Bare(reply) = Line::parse(line)
                    && (reply.device, reply.axis, reply.id) == mine
                {
                    return accepted(reply, command);
                }
            }
        }
        Err(self.silent(command, 2))
    }

    fn ask_of(&mut self, axis: u8, command: &str) -> Result<Reply, DeviceError> {
        accepted(self.reply_to(axis, command)?, command)
    }

    fn reply_to(&mut self, axis: u8, command: &str) -> Result<Reply, DeviceError> {
        let reply = match self.once(axis, command)? {
            Some(reply) => Some(reply),
            None => self.once(axis, command)?,
        };
        match reply {
            Some(reply) => Ok(reply),
            None if self.bare => Err(DeviceError::Suspect {
                why: "the controller answers without checksums, which it was told to send: it was restarted".into(),
            }),
            None => Err(self.silent(command, 2)),
        }
    }

    /// The error of a command that was sent `times` and never answered.
    pub fn silent(&self, command: &str, times: u32) -> DeviceError {
        DeviceError::Silent { device: DEVICE, request: request(command), waited_ms: u128::from(times) * self.wait.as_millis() }
    }

    fn once(&mut self, axis: u8, command: &str) -> Result<Option<Reply>, DeviceError> {
        self.id = (self.id + 1) % IDS;
        self.link.send(packet::command(self.device, axis, self.id, command).as_bytes())?;
        let until = Instant::now() + self.wait;
        self.bare = false;
        let mine = (self.device, axis, Some(self.id));
        while let Some(text) = self.link.line(until)? {
            match Line::parse(&text) {
                Line::Reply(reply) if (reply.device, reply.axis, reply.id) == mine => return Ok(Some(reply)),
                Line::Bare(reply) if (reply.device, reply.axis, reply.id) == mine => {
                    self.bare = true;
                    return Ok(None);
                }
                Line::Reply(_) | Line::Bare(_) | Line::Aside => {}
                Line::Noise => tracing::debug!(device = DEVICE, noise = text),
            }
        }
        Ok(None)
    }

    /// The value of a setting.
    pub fn get(&mut self, setting: &str) -> Result<i64, DeviceError> {
        let data = self.ask(&format!("get {setting}"))?.data;
        data.parse().map_err(|_| DeviceError::Unexpected { device: DEVICE, expected: format!("a whole number as {setting}"), found: data })
    }
}
