//! A motion controller that this folder alone adds: settings, driver, entry of the registry, example configuration and emulated
//! controller. The test takes it through everything that walks the registry.
//!
//! ```text
//! settings.rs, driver.rs ── entry.rs ──► registry ──► configuration, doctor, setup, serve
//! toy.toml ─────────────────────┘                                             │ lines
//!                                        emulated.rs (the other end of a pty) ◄┘
//! ```

mod driver;
mod emulated;
mod entry;
mod settings;

use super::doctor::{advice, answer};
use super::serve::open_axis;
use crate::config::Config;
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Port, added, protocols};
use carved_devices::{Achieved, DeviceError, Position};
use emulated::Emulated;
use serialport::{SerialPortInfo, SerialPortType};
use std::path::Path;

fn example() -> Config {
    Config::parse(entry::ENTRY.example.text, Path::new(entry::ENTRY.example.file)).unwrap()
}

#[test]
fn a_controller_in_one_folder_is_configured_found_opened_and_moved() {
    added::add(&entry::ENTRY, settings::read);

    // The configuration: its example is read, and what is wrong has its full path.
    let mut config = example();
    assert_eq!(config.rotation.entry().unwrap().name, "toy");
    for (right, wrong, expected) in [
        ("answer_timeout_ms = 9000", "answer_timeout_ms = 0", "rotation.answer_timeout_ms = 0; expected 1 to"),
        ("answer_timeout_ms = 9000", "patience = 1", "unknown field `patience`"),
        ("\"toy\"", "\"toys\"", "rotation.driver: unknown variant `toys`"),
    ] {
        let text = entry::ENTRY.example.text.replace(right, wrong);
        let refusal = Config::parse(&text, Path::new("toy.toml")).unwrap_err().to_string();
        assert!(refusal.contains(expected), "{refusal}");
    }

    // The doctor: the controller is found on its port, after all others, and its lines are printed.
    let emulated = Emulated::start();
    assert!(protocols().ends_with("or toy lines"), "{}", protocols());
    let port = SerialPortInfo { port_name: emulated.path().to_owned(), port_type: SerialPortType::Unknown };
    let found = answer(&port, 115_200);
    let lines =
        format!("Toy 1\n[rotation]\ndriver = \"toy\"\nport = {:?}\nbaud = 115200\n{}", emulated.path(), advice::example("toy.toml"));
    assert_eq!(found, lines);

    // The axis: it is opened as `carved serve` opens it, and its shaft turns to where its steps say.
    assert_eq!(config.rotation.serial(), Some((&Port::from("/dev/carved-rotation"), 115_200)));
    config.rotation.connect_to(emulated.path().to_owned());
    assert_eq!(example().rotation.serial(), Some((&Port::from("/dev/carved-rotation"), 115_200)), "another configuration is left alone");
    let mut axis = open_axis(&config).unwrap();
    assert_eq!(axis.identity(), "Toy 1");
    assert!(matches!(axis.move_to(Steps(1)), Err(DeviceError::NotReferenced)));
    assert_eq!(axis.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 1 });
    for target in [25, 75, -50] {
        assert_eq!(axis.move_to(Steps(target)).unwrap(), Achieved { steps: Steps(target), epoch: 1 });
        assert_eq!(emulated.shaft(), target);
    }
    axis.stop_handle().stop();
    assert!(matches!(axis.move_to(Steps(0)), Err(DeviceError::Stopped)));
    assert_eq!(emulated.shaft(), -50);

    // A pulled cable.
    axis.reference(&CancelToken::new()).unwrap();
    drop(emulated);
    assert!(axis.move_to(Steps(25)).is_err());
    assert!(matches!(axis.position(), Position::Suspect { .. }));
}
