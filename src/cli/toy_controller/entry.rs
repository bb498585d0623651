//! What the registry of drivers knows about the toy.

use carved_devices::rotation::{Answer, Entry, Example, Serial, Setup};

pub static ENTRY: Entry = Entry {
    name: "toy",
    example: Example { file: "toy.toml", text: include_str!("toy.toml") },
    serial: Some(Serial {
        protocol: "toy lines",
        // The first line end ends what other protocols have asked. On a busy computer the emulated toy is slower than a controller.
        identify: |wire| {
            for _ in 0..20 {
                if let Some(name) = wire.ask(b"\nwho\n", |text| text.starts_with("Toy").then(|| text.to_owned()))? {
                    return Ok(Some(Answer::plain("toy", name)));
                }
            }
            Ok(None)
        },
    }),
    setup: Ok(Setup { can_home: false, usual_steps: "100", lights: &[] }),
    fixed_steps: Some([100, 1]),
};
