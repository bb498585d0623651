//! Emulated Grbl 1.1h on a pty. It speaks the firmware's bytes and turns the true [`Shaft`](crate::shaft::Shaft) on axis X.

mod faults;
mod firmware;
mod gcode;
mod port;
mod report;
mod settings;
mod words;

pub use faults::SerialFaults;
pub(crate) use faults::take_one;
pub use port::SerialPort;
pub use settings::Settings;
