//! Common parts of all emulated controllers on a serial line: the port, the faults of the line, and the interface of the firmware.
//!
//! ```text
//!   host ── pty ── SerialPort ── Firmware (grbl, ...) ── steps ──► Shaft
//! ```

mod faults;
mod plug;
mod port;

pub use faults::SerialFaults;
pub(crate) use faults::take_one;
pub use port::SerialPort;

/// A control input of the controller: a button, or a safety circuit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Button {
    FeedHold,
    /// Resumes a held motion when it is pressed.
    CycleStart,
    /// The safety door. Pressed means open.
    Door,
    /// A latching emergency stop. It is wired to the reset input if the controller has no other input for it.
    EmergencyStop,
}

/// The program of a controller. Its inputs are bytes and rig time.
pub trait Firmware: Send {
    /// Whether the controller restarts when a host opens the port, as an Arduino does because of its DTR line.
    fn restarts_when_opened(&self) -> bool;
    /// The controller loses power or is reset. The motor stops, and the controller loses its count.
    fn lose_power(&mut self, now_s: f64);
    /// The controller starts.
    fn boot(&mut self);
    /// The next time at which something happens without a byte from the host, rig seconds.
    fn next_event_s(&self) -> Option<f64>;
    /// Executes everything that is due by `now_s`.
    fn advance(&mut self, now_s: f64);
    /// Takes bytes from the host.
    fn receive(&mut self, bytes: &[u8], now_s: f64);
    /// A button is pressed or released. Firmware without this input does nothing.
    fn button(&mut self, _button: Button, _pressed: bool, _now_s: f64) {}
    /// Bytes for the host since the last call. They are sent together.
    fn take_output(&mut self) -> Vec<u8>;
}
