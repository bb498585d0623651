//! What the registry of drivers knows about the relay.

use crate::rotation::driver::{Entry, Example, Setup};

pub(in crate::rotation) const ENTRY: Entry = Entry {
    name: "relay",
    example: Example { file: "vast-relay.toml", text: include_str!("../../../../../config/vast-relay.toml") },
    serial: None,
    setup: Ok(Setup { can_home: false, usual_steps: "500", lights: &[] }),
    fixed_steps: Some([500, 1]),
};
