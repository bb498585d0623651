//! What the registry of drivers knows about the trigger bridge of VAST.

use crate::DeviceError;
use crate::rotation::driver::{Entry, Example, Serial};
use crate::rotation::identify::{ANSWER, Answer, Wire};
use std::time::Instant;

pub(in crate::rotation) const ENTRY: Entry = Entry {
    name: "vast_bridge",
    example: Example { file: "vast-bridge.toml", text: include_str!("../../../../../config/vast-bridge.toml") },
    serial: Some(Serial { protocol: "VAST bridge", identify }),
    setup: Err("it only steps through VAST's own list. Set it up by docs/vast.md, or choose another port"),
    fixed_steps: Some([500, 1]),
};

fn identify(wire: &mut Wire) -> Result<Option<Answer>, DeviceError> {
    if wire.ask(b"X?\n", |text| (text == "OK").then_some(()))?.is_none() {
        return Ok(None);
    }
    let until = Instant::now() + ANSWER;
    let mut settings = Vec::new();
    while settings.len() < 4
        && let Some(text) = wire.0.line(until)?
    {
        settings.push(text.trim().to_owned());
    }
    Ok(Some(Answer::plain("vast_bridge", format!("VAST trigger bridge: {}", settings.join(", ")))))
}
