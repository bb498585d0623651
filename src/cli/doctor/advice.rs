//! Turns the answer of a device into lines of the configuration.

use carved_devices::rotation::{Answer, Port, UsbAdapter, entry};
use std::path::Path;

/// The identity of the controller, and the lines for `[rotation]`.
pub fn of(answer: &Answer, port: &Port, baud: u32) -> String {
    if let Some(refusal) = answer.refusal {
        return format!("{}: {refusal}\n", answer.name);
    }
    let port = match port {
        Port::Path(path) => format!("port = {path:?}"),
        Port::Usb(UsbAdapter { usb_serial }) => format!("port = {{ usb_serial = {usb_serial:?} }}"),
    };
    let mut text = format!("{}\n[rotation]\ndriver = \"{}\"\n{port}\nbaud = {baud}\n", answer.name, answer.driver);
    text.extend(answer.keys.iter().map(|key| format!("{} = {}   # {}\n", key.name, key.value, key.source)));
    text.extend(answer.remark.iter().map(|remark| format!("# {remark}\n")));
    if answer.keys.is_empty() {
        text.extend(entry(answer.driver).map(|entry| example(entry.example.file)));
    }
    text
}

/// Folder of the configurations of the package.
const INSTALLED: &str = "/etc/carved";

/// A line with an example of a configuration and with what explains its keys.
pub fn example(file: &str) -> String {
    example_in(Path::new(INSTALLED), file)
}

fn example_in(installed: &Path, file: &str) -> String {
    let path = installed.join(file);
    let path = if path.exists() { path.display().to_string() } else { format!("config/{file} in the sources of carved") };
    format!("# an example: {path}; every key: carved config schema --markdown\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_example_is_a_file_that_is_there() {
        let installed = tempfile::tempdir().unwrap();
        assert!(example_in(installed.path(), "vast-grbl.toml").starts_with("# an example: config/vast-grbl.toml in the sources"));
        let path = installed.path().join("vast-grbl.toml");
        std::fs::write(&path, "").unwrap();
        assert!(example_in(installed.path(), "vast-grbl.toml").starts_with(&format!("# an example: {};", path.display())));
    }
}
