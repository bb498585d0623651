//! What the firmware sends, and what it remembers of it.
//!
//! ```text
//!   ok ── (fault: dropped) ──┐
//!   error:n ── remembered ───┤
//!   ALARM:n, [MSG:...] ──────┼──► bytes for the host
//!   reports ─────────────────┘
//! ```

use crate::grbl::Dialect;
use crate::serial::SerialFaults;
use std::sync::Arc;

pub(super) struct Answers {
    dialect: Dialect,
    faults: Arc<SerialFaults>,
    bytes: Vec<u8>,
    /// The last error of grblHAL, which it repeats.
    last_error: Option<u8>,
    /// The parser's modes, as the host knows them.
    reported_modes: String,
}

impl Answers {
    /// No answer yet. `modes` is the report of the modes at power-up.
    pub fn new(dialect: Dialect, faults: Arc<SerialFaults>, modes: String) -> Self {
        Self { dialect, faults, bytes: Vec::new(), last_error: None, reported_modes: modes }
    }

    /// The bytes since the last call.
    pub fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Forgets the last error and takes `modes` as known to the host. Bytes that are on their way stay.
    pub fn reset(&mut self, modes: String) {
        self.last_error = None;
        self.reported_modes = modes;
    }

    /// The error that a line of G-code must repeat. It is repeated once, unless `error` remembers it again.
    pub fn take_last_error(&mut self) -> Option<u8> {
        self.last_error.take()
    }

    pub fn ok(&mut self) {
        if !self.faults.take_dropped_ok() {
            self.text("ok\r\n");
        }
    }

    pub fn error(&mut self, number: u8) {
        self.last_error = self.dialect.is_hal().then_some(number);
        self.text(&format!("error:{number}\r\n"));
    }

    pub fn alarm(&mut self, number: u8) {
        self.text(&format!("ALARM:{number}\r\n"));
    }

    pub fn message(&mut self, text: &str) {
        self.text(&format!("[MSG:{text}]\r\n"));
    }

    pub fn text(&mut self, text: &str) {
        self.bytes.extend_from_slice(text.as_bytes());
    }

    /// grblHAL sends changed modes without being asked.
    pub fn modes_if_changed(&mut self, modes: String) {
        if self.dialect.is_hal() && modes != self.reported_modes {
            self.text(&modes);
            self.reported_modes = modes;
        }
    }
}
