//! The states of the controller and its control inputs.
//!
//! ```text
//!             G-code            ! , feed hold          ~ , cycle start
//!    Idle ──────────────► Run ──────────────► Hold ───────────────────► Idle
//!     ├── $J= ──► Jog ──── arrived, 0x85 ─────────────────────────────► Idle
//!     ├── $C ───► Check ── $C ────────────────────────────────────────► Idle
//!     ├── $H ───► Home ─── arrived ───────────────────────────────────► Idle
//!     │            └────── failed, reset ──► Alarm ── $X, $H ─────────► Idle
//!     ├── door ─► Door ─── closed, then ~ or cycle start ─────────────► Idle
//!     └── $SLP ─► Sleep ── reset ──► Alarm
//!    hard or soft limit ──► Critical ── reset ──► Alarm
//!    emergency stop (grblHAL) ──► EmergencyStop ── released, then reset ──► Alarm
//! ```

use crate::grbl::Dialect;
use crate::serial::Button;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Idle,
    Run,
    Hold,
    Jog,
    Home,
    /// The safety door is open. Or it was open, and nobody has pressed cycle start since.
    Door,
    /// Lines are parsed and nothing moves, until the next `$C`.
    Check,
    /// Nothing is read until a reset.
    Sleep,
    Alarm,
    /// grblHAL: the emergency stop is pressed. Or it was pressed, and nobody has reset since.
    EmergencyStop,
    /// A limit was hit. Nothing is read or answered until a reset.
    Critical,
}

impl Mode {
    /// Whether the main loop reads lines. Otherwise they stay in the receive buffer.
    pub fn reads_lines(self) -> bool {
        !matches!(self, Self::Critical | Self::Hold | Self::Door | Self::Sleep | Self::EmergencyStop)
    }

    /// Whether the planner may start a block.
    pub fn starts_moves(self) -> bool {
        matches!(self, Self::Idle | Self::Run | Self::Jog)
    }

    /// Whether `$` commands that use the EEPROM or print much are accepted.
    pub fn is_quiet(self) -> bool {
        matches!(self, Self::Idle | Self::Alarm)
    }

    /// Whether a reset leaves the controller locked.
    pub fn stays_locked(self) -> bool {
        matches!(self, Self::Alarm | Self::Critical | Self::Sleep | Self::EmergencyStop)
    }

    /// The name in a status report, or `None` if the controller sends no report. By default grblHAL gives the number of an alarm
    /// in a `full` report only.
    pub fn name(self, is_moving: bool, door_open: bool, full: bool) -> Option<&'static str> {
        Some(match self {
            Self::Critical => return None,
            Self::Idle => "Idle",
            Self::Run => "Run",
            Self::Hold if is_moving => "Hold:1",
            Self::Hold => "Hold:0",
            Self::Jog => "Jog",
            Self::Home => "Home",
            Self::Door if is_moving => "Door:2",
            Self::Door if door_open => "Door:1",
            Self::Door => "Door:0",
            Self::Check => "Check",
            Self::Sleep => "Sleep",
            Self::EmergencyStop if full => "Alarm:10",
            Self::Alarm | Self::EmergencyStop => "Alarm",
        })
    }
}

/// Levels of the control inputs.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Inputs {
    hold: bool,
    door_open: bool,
    /// The emergency stop of grblHAL, or the reset input of Grbl.
    stop: bool,
}

impl Inputs {
    pub fn set(&mut self, button: Button, pressed: bool) {
        match button {
            Button::FeedHold => self.hold = pressed,
            Button::CycleStart => {}
            Button::Door => self.door_open = pressed,
            Button::EmergencyStop => self.stop = pressed,
        }
    }

    pub fn door_open(self) -> bool {
        self.door_open
    }

    pub fn stop_pressed(self) -> bool {
        self.stop
    }

    /// Letters of the active inputs, as a status report lists them.
    pub fn letters(self, dialect: Dialect) -> String {
        let stop = if dialect.is_hal() { "E" } else { "R" };
        [(self.door_open, "D"), (self.hold, "H"), (self.stop, stop)]
            .into_iter()
            .filter_map(|(active, letter)| active.then_some(letter))
            .collect()
    }
}
