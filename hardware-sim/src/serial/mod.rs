//! What every emulated controller on a serial line shares: the port, the line's faults, and what firmware must answer.
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

/// A hand at the controller, or a safety circuit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Button {
    FeedHold,
    /// It resumes a motion that was held; it acts when it is pressed.
    CycleStart,
    /// The safety door: pressed is open.
    Door,
    /// A latching emergency stop. It ends at the reset input of a controller that has no other.
    EmergencyStop,
}

/// The program of a controller, driven by bytes and rig time.
pub trait Firmware: Send {
    /// Whether the host's opening of the port restarts the controller, as the DTR line of an Arduino does.
    fn restarts_when_opened(&self) -> bool;
    /// The controller loses power or is reset: the motor stands still, what it counted is gone.
    fn lose_power(&mut self, now_s: f64);
    /// The controller starts.
    fn boot(&mut self);
    /// The next instant at which something happens without a byte coming in.
    fn next_event_s(&self) -> Option<f64>;
    /// Lets everything happen that is due by `now_s`.
    fn advance(&mut self, now_s: f64);
    /// Bytes from the host.
    fn receive(&mut self, bytes: &[u8], now_s: f64);
    /// A button is pressed or let go; firmware without such an input does nothing.
    fn button(&mut self, _button: Button, _pressed: bool, _now_s: f64) {}
    /// Bytes for the host since the last call; one call, one piece that leaves together.
    fn take_output(&mut self) -> Vec<u8>;
}
