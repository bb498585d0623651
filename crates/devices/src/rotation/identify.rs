//! Finds out which controller answers on a serial port, without moving or resetting anything.
//!
//! ```text
//! listen ── a greeting? ──► Grbl, grblHAL
//!   ?        <...>      ──► Grbl, grblHAL      then $I and $$
//!   / alone  @...       ──► Zaber ASCII
//!   X?       OK, ...    ──► VAST trigger bridge
//!   zeros, GFV  9 bytes ──► TMCL
//! ```
//! The order is that of the list of drivers (`driver.rs`). It prevents that a question of one protocol is a command of another:
//!
//! | to | `?` | LF `/` LF | `X?` LF | zeros, `01 88 01 .. 8a` |
//! |---|---|---|---|---|
//! | Grbl | status | empty lines | not asked any more | not asked any more |
//! | Zaber | a line without `/` | status, on a line of its own | not asked any more | not asked any more |
//! | bridge | an unknown line | unknown line | settings | not asked any more |
//! | TMCL | 7 bytes whose sum is none, made a frame of 9 by zeros | | | version |
//!
//! Opening a port raises its DTR line, which restarts an Arduino. This does no harm: a port that another program has open is left
//! alone, so nobody uses the position that is lost.

use super::driver::drivers;
use super::link::{Link, Stop};
use super::port::Port;
use crate::DeviceError;
use std::time::{Duration, Instant};

const DEVICE: &str = "serial port";
/// The slowest answer to a question.
pub(super) const ANSWER: Duration = Duration::from_millis(400);
/// A line on which nothing comes for this time is quiet.
pub(super) const SILENCE: Duration = Duration::from_millis(50);

/// The controller that answered, and what its answer says about its configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Name of its driver.
    pub driver: &'static str,
    /// What it is, for a person: the make, the version, and what else it says of itself.
    pub name: String,
    /// Why the driver does not accept it. `None` if the driver does.
    pub refusal: Option<&'static str>,
    /// Keys of `[rotation]` that follow from the controller's own settings.
    pub keys: Vec<Key>,
    /// What a person should know or change.
    pub remark: Option<String>,
}

/// A key of `[rotation]` that follows from a setting of the controller.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    /// The name of the key.
    pub name: &'static str,
    /// Its value, as TOML.
    pub value: String,
    /// The setting that it follows from.
    pub source: String,
}

impl Answer {
    /// A controller whose answer says nothing about its configuration.
    pub fn plain(driver: &'static str, name: String) -> Self {
        Self { driver, name, refusal: None, keys: Vec::new(), remark: None }
    }
}

/// Opens a port exclusively and asks which controller is there. `None` if nothing comes.
///
/// # Errors
/// The port cannot be opened, for example because another program has it open, or it disappears meanwhile. Bytes come that no controller of
/// the list sends, as at another baud rate.
pub fn identify(port: &Port, baud: u32) -> Result<Option<Answer>, DeviceError> {
    let mut wire = Wire(Link::serial(DEVICE, port, baud, Stop::default())?);
    for driver in drivers() {
        if let Some(serial) = &driver.serial
            && let Some(answer) = (serial.identify)(&mut wire)?
        {
            return Ok(Some(answer));
        }
    }
    let silent = wire.0.silent(format!("the questions of {}", protocols()), 0);
    match wire.0.first_contact(silent) {
        DeviceError::Silent { .. } => Ok(None),
        heard => Err(heard),
    }
}

/// The protocols that [`identify`] knows, for a person.
pub fn protocols() -> String {
    let names: Vec<&str> = drivers().filter_map(|driver| Some(driver.serial.as_ref()?.protocol)).collect();
    match names.split_last() {
        Some((last, [])) => (*last).to_owned(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    }
}

/// A port on which a controller is looked for.
pub struct Wire(pub(super) Link);

impl Wire {
    /// The first line within `wait` that `take` accepts.
    ///
    /// # Errors
    /// The port is gone.
    pub fn hear<T>(&mut self, wait: Duration, take: impl Fn(&str) -> Option<T>) -> Result<Option<T>, DeviceError> {
        let until = Instant::now() + wait;
        while let Some(text) = self.0.line(until)? {
            if let Some(taken) = take(text.trim()) {
                return Ok(Some(taken));
            }
        }
        Ok(None)
    }

    /// Sends a question. Returns the first line of the answer that `take` accepts.
    ///
    /// # Errors
    /// As [`Self::hear`].
    pub fn ask<T>(&mut self, question: &[u8], take: impl Fn(&str) -> Option<T>) -> Result<Option<T>, DeviceError> {
        self.0.send(question)?;
        self.hear(ANSWER, take)
    }

    /// Waits until nothing more comes.
    ///
    /// # Errors
    /// As [`Self::hear`].
    pub fn quiet(&mut self) -> Result<(), DeviceError> {
        self.0.quiet(SILENCE, Instant::now() + ANSWER)
    }

    /// All lines of an answer up to its `ok` or error.
    ///
    /// # Errors
    /// As [`Self::hear`].
    pub fn listing(&mut self, question: &[u8]) -> Result<Vec<String>, DeviceError> {
        self.0.send(question)?;
        let until = Instant::now() + ANSWER;
        let mut lines = Vec::new();
        while let Some(text) = self.0.line(until)? {
            let text = text.trim().to_owned();
            if text == "ok" || text.starts_with("error:") {
                break;
            }
            lines.push(text);
        }
        Ok(lines)
    }
}
