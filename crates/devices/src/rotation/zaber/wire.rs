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

    /// See [`Link::first_contact`].
    pub fn first_contact(&self, error: DeviceError) -> DeviceError {
        self.link.first_contact(error)
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
        self.link.pass_latch(true);
        let mut found = self.exchange(self.axis, command);
        if let Ok(None) = found {
            found = self.exchange(self.axis, command);
        }
        self.link.pass_latch(false);
        let (reply, _bare) = found?.ok_or_else(|| self.silent(command, 2))?;
        accepted(reply, command)
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

    /// Whether the last answer had no checksum. A controller that was told to send them was restarted since.
    pub fn is_bare(&self) -> bool {
        self.bare
    }

    /// The error of a command that was sent `times` and never answered.
    pub fn silent(&self, command: &str, times: u32) -> DeviceError {
        self.link.silent(request(command), u128::from(times) * self.wait.as_millis())
    }

    fn once(&mut self, axis: u8, command: &str) -> Result<Option<Reply>, DeviceError> {
        let found = self.exchange(axis, command)?;
        self.bare = found.as_ref().is_some_and(|(_, bare)| *bare);
        Ok(found.filter(|(_, bare)| !bare).map(|(reply, _)| reply))
    }

    /// Sends a command once. Returns the reply with its id, and whether the reply has no checksum; `None` if none came in time.
    fn exchange(&mut self, axis: u8, command: &str) -> Result<Option<(Reply, bool)>, DeviceError> {
        self.id = (self.id + 1) % IDS;
        self.link.send(packet::command(self.device, axis, self.id, command).as_bytes())?;
        let until = Instant::now() + self.wait;
        let mine = (self.device, axis, Some(self.id));
        let is_mine = |reply: &Reply| (reply.device, reply.axis, reply.id) == mine;
        while let Some(text) = self.link.line(until)? {
            match Line::parse(&text) {
                Line::Reply(reply) if is_mine(&reply) => return Ok(Some((reply, false))),
                Line::Bare(reply) if is_mine(&reply) => return Ok(Some((reply, true))),
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
