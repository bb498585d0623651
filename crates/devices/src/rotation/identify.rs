//! Finds out which controller answers on a serial port, without moving or resetting anything.
//!
//! ```text
//! listen ── a greeting? ──► Grbl, grblHAL
//!   ?        <...>      ──► Grbl, grblHAL      then $I and $$
//!   / alone  @...       ──► Zaber ASCII
//!   X?       OK, ...    ──► VAST trigger bridge
//!   zeros, GFV  9 bytes ──► TMCL
//! ```
//! The order prevents that a question of one protocol is a command of another:
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

use super::grbl::Dialect;
use super::link::{Link, Stop};
use super::port::Port;
use super::tmcl::frame::{BYTES, Version};
use crate::DeviceError;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const DEVICE: &str = "serial port";
/// Time of an Arduino's boot loader until its greeting.
const BOOT: Duration = Duration::from_millis(2500);
/// The slowest answer to a question.
const ANSWER: Duration = Duration::from_millis(400);
const SILENCE: Duration = Duration::from_millis(50);
/// TMCL modules leave the factory with this address.
const TMCL_MODULE: u8 = 1;

/// The controller that answered.
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    /// A controller with the lines of Grbl.
    Grbl {
        /// Whether the driver accepts its version: Grbl 1.1 and grblHAL 1.1. True where a busy controller did not say it.
        is_driven: bool,
        /// Whether it is grblHAL, by its greeting or its version.
        is_hal: bool,
        /// Greeting and answer to `$I`.
        version: String,
        /// Answer to `$$`; empty if the controller was too busy to print it.
        settings: BTreeMap<u16, f64>,
    },
    /// A Zaber controller with its ASCII protocol.
    Zaber {
        /// Its answer to an empty command: address, axis, state, warning.
        status: String,
    },
    /// The trigger bridge of a stock VAST.
    VastBridge {
        /// Lines of its answer to `X?`.
        settings: Vec<String>,
    },
    /// A Trinamic module.
    Tmcl {
        /// Type of the module, such as `TMCM-1140`.
        module: String,
        /// Version of its firmware.
        version: String,
    },
}

/// Opens a port exclusively and asks which controller is there. `None` if nothing answers.
///
/// # Errors
/// The port cannot be opened, for example because another program has it open, or it disappears meanwhile.
pub fn identify(port: &Port, baud: u32) -> Result<Option<Answer>, DeviceError> {
    let mut line = Wire(Link::serial(DEVICE, port, baud, Stop::default())?);
    // Grbl sends its name at a start. A bridge sends OK, which other controllers send as well.
    let greeting = line.hear(BOOT, |text| is_grbl(text).then(|| text.to_owned()))?;
    let status = if greeting.is_some() { None } else { line.ask(b"?", |text| text.starts_with('<').then(|| text.to_owned()))? };
    if greeting.is_some() || status.is_some() {
        return line.grbl(greeting, status).map(Some);
    }
    if let Some(status) = line.ask(b"\n/\n", |text| text.strip_prefix('@').map(str::to_owned))? {
        return Ok(Some(Answer::Zaber { status }));
    }
    if let Some(settings) = line.bridge()? {
        return Ok(Some(Answer::VastBridge { settings }));
    }
    line.tmcl()
}

fn is_grbl(text: &str) -> bool {
    text.get(..4).is_some_and(|head| head.eq_ignore_ascii_case("grbl"))
}

struct Wire(Link);

impl Wire {
    /// The first line within `wait` that `take` accepts.
    fn hear<T>(&mut self, wait: Duration, take: impl Fn(&str) -> Option<T>) -> Result<Option<T>, DeviceError> {
        let until = Instant::now() + wait;
        while let Some(text) = self.0.line(until)? {
            if let Some(taken) = take(text.trim()) {
                return Ok(Some(taken));
            }
        }
        Ok(None)
    }

    fn ask<T>(&mut self, question: &[u8], take: impl Fn(&str) -> Option<T>) -> Result<Option<T>, DeviceError> {
        self.0.send(question)?;
        self.hear(ANSWER, take)
    }

    fn quiet(&mut self) -> Result<(), DeviceError> {
        self.0.quiet(SILENCE, Instant::now() + ANSWER)
    }

    /// All lines of an answer up to its `ok` or error.
    fn listing(&mut self, question: &[u8]) -> Result<Vec<String>, DeviceError> {
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

    fn grbl(&mut self, greeting: Option<String>, status: Option<String>) -> Result<Answer, DeviceError> {
        self.quiet()?;
        let build: Vec<String> = self.listing(b"$I\n")?.into_iter().filter(|l| l.starts_with('[')).collect();
        let settings = self.listing(b"$$\n")?.iter().filter_map(|l| setting(l)).collect();
        let name = greeting.and_then(|g| Some(g.split(" [").next()?.to_owned()));
        // A controller that was not reset has said its version only.
        // Grbl 0.9 separates the fields of its status by commas.
        let is_driven = if let Some(name) = &name {
            Dialect::Auto.of(name).is_ok()
        } else {
            let is_1_1 = |line: &String| line.strip_prefix("[VER:").is_none_or(|version| version.starts_with("1.1"));
            build.iter().all(is_1_1) && status.is_none_or(|status| status.contains('|'))
        };
        let version = name.into_iter().chain(build).collect::<Vec<_>>().join(" ");
        Ok(Answer::Grbl { is_driven, is_hal: version.to_ascii_lowercase().contains("grblhal"), version, settings })
    }

    fn bridge(&mut self) -> Result<Option<Vec<String>>, DeviceError> {
        if self.ask(b"X?\n", |text| (text == "OK").then_some(()))?.is_none() {
            return Ok(None);
        }
        let until = Instant::now() + ANSWER;
        let mut settings = Vec::new();
        while settings.len() < 4
            && let Some(text) = self.0.line(until)?
        {
            settings.push(text.trim().to_owned());
        }
        Ok(Some(settings))
    }

    /// The module may have read the earlier questions as the begin of a frame. Zeros complete it, byte by byte, until the module answers
    /// that it is not a valid frame.
    fn tmcl(&mut self) -> Result<Option<Answer>, DeviceError> {
        self.quiet()?;
        let mut zeros = 0;
        while zeros < BYTES && self.0.exact::<BYTES>(Instant::now() + SILENCE)?.is_none() {
            self.0.send(&[0])?;
            zeros += 1;
        }
        if zeros == BYTES {
            // A module that does not answer invalid frames has now received 16 bytes. Its next frame begins two bytes later.
            self.0.send(&[0; 2])?;
        }
        self.quiet()?;
        self.0.send(&Version::question(TMCL_MODULE))?;
        let reply = self.0.exact::<BYTES>(Instant::now() + ANSWER)?;
        let version = reply.and_then(Version::in_answer);
        Ok(version.map(|version| Answer::Tmcl { module: format!("TMCM-{}", version.module), version: version.firmware() }))
    }
}

fn setting(line: &str) -> Option<(u16, f64)> {
    let (number, value) = line.strip_prefix('$')?.split_once('=')?;
    Some((number.parse().ok()?, value.parse().ok()?))
}
