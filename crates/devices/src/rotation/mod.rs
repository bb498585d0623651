//! Rotation axes: drivers behind [`super::RotationAxis`].
//!
//! ```text
//!              ┌─ Grbl ───────┐  (protocol, knowledge of the position)
//! one_sided ───┼─ Tmcl, Zaber ┤
//! (backlash)   ├─ VastBridge ─┼─ Link (bytes, lines, deadlines, the latched stop) ── Transport (tty, TCP)
//!              └─ Relay ──────┘
//! ```
//! `driver` is the registry of the makes. Each make is a folder with its settings, its driver and its entry in the registry.

#[cfg(any(test, feature = "testing"))]
pub mod added;
mod bridge;
mod driver;
mod grbl;
mod identify;
mod knowledge;
mod link;
mod one_sided;
mod pace;
#[cfg(any(test, feature = "testing"))]
pub mod parsers;
mod port;
mod reference;
mod relay;
#[cfg(test)]
mod scripted;
mod tmcl;
mod transport;
mod zaber;

pub use bridge::{VastBridge, VastBridgeSettings};
pub use driver::{DRIVERS, Driver, Entry, Example, RotationDriver, Serial, Setup, drivers, entry};
pub use grbl::{AxisLetter, Dialect, Grbl, GrblPin, GrblSettings, TranslationSettings};
pub use identify::{Answer, Wire, identify, protocols};
pub use one_sided::{OneSided, one_sided};
pub use port::{Port, UsbAdapter, list as serial_ports};
pub use reference::Reference;
pub use relay::{Relay, RelaySettings};
pub use tmcl::{ClockDivisors, Tmcl, TmclPin, TmclSettings};
pub use zaber::{Zaber, ZaberPin, ZaberSettings};
