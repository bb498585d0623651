//! What the registry of drivers knows about Zaber controllers.

use crate::rotation::driver::{Entry, Example, Serial, Setup};
use crate::rotation::identify::Answer;

pub(in crate::rotation) const ENTRY: Entry = Entry {
    name: "zaber",
    example: Example { file: "vast-zaber.toml", text: include_str!("../../../../../config/vast-zaber.toml") },
    serial: Some(Serial {
        protocol: "Zaber ASCII",
        // An empty command: the answer has address, axis, state and warning.
        identify: |wire| {
            let status = wire.ask(b"\n/\n", |text| text.starts_with('@').then(|| text.to_owned()))?;
            Ok(status.map(|status| Answer::plain("zaber", format!("Zaber, ASCII protocol: {status}"))))
        },
    }),
    setup: Ok(Setup {
        can_home: true,
        usual_steps: "6400",
        lights: &[("1", "Digital output 1"), ("2", "Digital output 2"), ("3", "Digital output 3"), ("4", "Digital output 4")],
    }),
    fixed_steps: None,
};
