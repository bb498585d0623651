//! What the registry of drivers knows about Trinamic modules.

use super::frame::{BYTES, Version};
use crate::DeviceError;
use crate::rotation::driver::{Entry, Example, Serial, Setup};
use crate::rotation::identify::{ANSWER, Answer, SILENCE, Wire};
use std::time::Instant;

/// Modules leave the factory with this address.
const MODULE: u8 = 1;

pub(in crate::rotation) const ENTRY: Entry = Entry {
    name: "tmcl",
    example: Example { file: "vast-tmcl.toml", text: include_str!("../../../../../config/vast-tmcl.toml") },
    serial: Some(Serial { protocol: "TMCL module 1", identify }),
    setup: Ok(Setup {
        can_home: true,
        usual_steps: "6400",
        lights: &[
            ("0", "OUT 0"),
            ("1", "OUT 1"),
            ("2", "OUT 2"),
            ("3", "OUT 3"),
            ("4", "OUT 4"),
            ("5", "OUT 5"),
            ("6", "OUT 6"),
            ("7", "OUT 7"),
        ],
    }),
    fixed_steps: None,
};

/// The module may have read the earlier questions as the begin of a frame. Zeros complete it, byte by byte, until the module answers that
/// it is not a valid frame.
fn identify(wire: &mut Wire) -> Result<Option<Answer>, DeviceError> {
    wire.quiet()?;
    let mut zeros = 0;
    while zeros < BYTES && wire.0.exact::<BYTES>(Instant::now() + SILENCE)?.is_none() {
        wire.0.send(&[0])?;
        zeros += 1;
    }
    if zeros == BYTES {
        // A module that does not answer invalid frames has now received 16 bytes. Its next frame begins two bytes later.
        wire.0.send(&[0; 2])?;
    }
    wire.quiet()?;
    wire.0.send(&Version::question(MODULE))?;
    let version = wire.0.exact::<BYTES>(Instant::now() + ANSWER)?.and_then(Version::in_answer);
    Ok(version.map(|version| Answer::plain("tmcl", format!("Trinamic TMCM-{}, firmware {}", version.module, version.firmware()))))
}
