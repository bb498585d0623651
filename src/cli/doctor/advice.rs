//! Turns the answer of a device into lines of the configuration.

use carved_devices::rotation::{Answer, Port, UsbAdapter};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// The identity of the controller, and the lines for `[rotation]`.
pub fn of(answer: &Answer, port: &Port, baud: u32) -> String {
    let port = match port {
        Port::Path(path) => format!("port = {path:?}"),
        Port::Usb(UsbAdapter { usb_serial }) => format!("port = {{ usb_serial = {usb_serial:?} }}"),
    };
    let table = |driver: &str| format!("[rotation]\ndriver = \"{driver}\"\n{port}\nbaud = {baud}\n");
    let example = |driver: &str, file: &str| format!("{}{}", table(driver), example(file));
    match answer {
        Answer::Grbl { is_driven: false, version, .. } => format!("{version}: {NOT_DRIVEN}\n"),
        Answer::Grbl { is_hal, version, settings, .. } => {
            let mut text = format!("{}: {version}\n{}", if *is_hal { "grblHAL" } else { "Grbl" }, table("grbl"));
            for GrblKey { key, value, number } in of_grbl(settings) {
                let _ = writeln!(text, "{key} = {value}   # its ${number}, for axis X; Y has ${}", number + 1);
            }
            if let Some(idle) = idle(*is_hal, settings) {
                let _ = writeln!(text, "# {idle}");
            }
            let homing = settings.get(&22).map(|on| *on as u32 & 1 == 1);
            match homing {
                Some(true) => text.push_str("reference = \"home\"   # its $22 is on\n"),
                Some(false) => text.push_str("reference = \"here\"   # its $22 is off\n"),
                None => text.push_str("# it is busy: its settings could not be read; run carved doctor again when it is idle\n"),
            }
            text
        }
        Answer::Zaber { status } => format!("Zaber, ASCII protocol: @{status}\n{}", example("zaber", "vast-zaber.toml")),
        Answer::VastBridge { settings } => {
            format!("VAST trigger bridge: {}\n{}", settings.join(", "), example("vast_bridge", "vast-bridge.toml"))
        }
        Answer::Tmcl { module, version } => format!("Trinamic {module}, firmware {version}\n{}", example("tmcl", "vast-tmcl.toml")),
    }
}

/// What is to be done with another firmware.
pub const NOT_DRIVEN: &str = "the driver of carved accepts Grbl 1.1 and grblHAL 1.1 only; install one of them on this controller";

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

/// A key of `[rotation]` that follows from a setting of a Grbl controller.
pub struct GrblKey {
    pub key: &'static str,
    /// As TOML.
    pub value: String,
    /// Number of the setting.
    pub number: u16,
}

/// The keys that follow from the settings of axis X.
pub fn of_grbl(settings: &BTreeMap<u16, f64>) -> Vec<GrblKey> {
    [(100, "steps_per_unit"), (110, "max_rate_units_per_min"), (120, "acceleration_units_per_s2")]
        .into_iter()
        .filter_map(|(number, key)| {
            let value = settings.get(&number)?;
            let value = if number == 100 { ratio(*value) } else { format!("{value:?}") };
            Some(GrblKey { key, value, number })
        })
        .collect()
}

/// What to change where the motors lose their current after each move. `None` where they keep it.
pub fn idle(is_hal: bool, settings: &BTreeMap<u16, f64>) -> Option<String> {
    // grblHAL may instead list the motors that stay powered.
    let kept = is_hal && settings.get(&37).is_some_and(|mask| *mask != 0.0);
    let ms = settings.get(&1).filter(|ms| **ms as u32 != 255 && !kept)?;
    Some(format!("set $1=255 in the controller: now its motors lose their current {ms} ms after each move"))
}

/// The exact ratio of a value that was printed with three decimals, if a fraction with a small denominator matches.
fn ratio(printed: f64) -> String {
    let fits = |den: &u32| {
        let num = printed * f64::from(*den);
        (num.round() / f64::from(*den) - printed).abs() <= 0.000_501
    };
    match (1..=1000).find(fits) {
        Some(den) => format!("[{}, {den}]", (printed * f64::from(den)).round()),
        None => format!("[{}, 1000]", (printed * 1000.0).round()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_configuration_is_offered_for_a_firmware_that_the_driver_refuses() {
        let of_version = |is_driven, version: &str| {
            let answer = Answer::Grbl { is_driven, is_hal: false, version: version.into(), settings: BTreeMap::new() };
            of(&answer, &Port::Path("/dev/ttyUSB0".into()), 115_200)
        };
        let refused = of_version(false, "Grbl 3.7 [VER:3.7 FluidNC v3.7.15:]");
        assert!(
            refused.contains("FluidNC") && refused.contains("Grbl 1.1 and grblHAL 1.1 only") && !refused.contains("[rotation]"),
            "{refused}"
        );
        assert!(of_version(true, "Grbl 1.1h").contains("[rotation]"));
    }

    #[test]
    fn an_example_is_a_file_that_is_there() {
        let installed = tempfile::tempdir().unwrap();
        assert!(example_in(installed.path(), "vast-grbl.toml").starts_with("# an example: config/vast-grbl.toml in the sources"));
        let path = installed.path().join("vast-grbl.toml");
        std::fs::write(&path, "").unwrap();
        assert!(example_in(installed.path(), "vast-grbl.toml").starts_with(&format!("# an example: {};", path.display())));
    }

    #[test]
    fn ratios_are_found_behind_three_decimals() {
        for (printed, written) in [(100.0, "[100, 1]"), (17.778, "[160, 9]"), (213.333, "[640, 3]"), (1.389, "[25, 18]"), (0.5, "[1, 2]")] {
            assert_eq!(ratio(printed), written);
        }
    }
}
