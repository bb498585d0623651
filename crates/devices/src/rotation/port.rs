//! The choice of a serial port: by its name, or by the serial number of its USB adapter, whose name may change.

use crate::DeviceError;
use serde::{Deserialize, Serialize};
use serialport::{SerialPortInfo, SerialPortType};
use std::path::Path;

/// `port = "/dev/ttyUSB0"` or `port = { usb_serial = "A10K5V2M" }`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "a path such as \"/dev/ttyUSB0\", or { usb_serial = \"the adapter's serial number\" }")]
pub enum Port {
    /// Name of the device file.
    Path(String),
    /// A USB adapter.
    Usb(UsbAdapter),
}

/// A USB adapter by its serial number.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct UsbAdapter {
    /// As `carved doctor` lists it.
    pub usb_serial: String,
}

impl From<&str> for Port {
    fn from(path: &str) -> Self {
        Self::Path(path.into())
    }
}

impl std::fmt::Display for Port {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Path(path) => f.write_str(path),
            Self::Usb(UsbAdapter { usb_serial }) => write!(f, "the USB adapter with serial number {usb_serial:?}"),
        }
    }
}

impl Port {
    /// The present name of the device file. It may change when the adapter is replugged.
    pub(super) fn resolve(&self, device: &'static str) -> Result<String, DeviceError> {
        match self {
            Self::Path(path) => Ok(path.clone()),
            Self::Usb(adapter) => adapter.among(&list()).map_err(|why| DeviceError::Open {
                device,
                address: self.to_string(),
                why,
                remedy: "Check the cable; `carved doctor` lists the ports with their serial numbers",
            }),
        }
    }
}

impl UsbAdapter {
    fn among(&self, ports: &[SerialPortInfo]) -> Result<String, String> {
        let serial_of = |port: &SerialPortInfo| match &port.port_type {
            SerialPortType::UsbPort(usb) => usb.serial_number.clone(),
            _ => None,
        };
        let mut found = ports.iter().filter(|p| serial_of(p).as_ref() == Some(&self.usb_serial)).map(|p| p.port_name.clone());
        match (found.next(), found.next()) {
            (Some(one), None) => Ok(one),
            (Some(one), Some(other)) => Err(format!("both {one} and {other} have it")),
            (None, _) => {
                let others: Vec<_> = ports.iter().filter_map(|p| serial_of(p).map(|s| format!("{} ({s:?})", p.port_name))).collect();
                let others =
                    if others.is_empty() { "no port has a serial number".into() } else { format!("there are {}", others.join(", ")) };
                Err(format!("it is not plugged in; {others}"))
            }
        }
    }
}

/// The serial ports of this computer; empty if they cannot be listed.
pub fn list() -> Vec<SerialPortInfo> {
    // The crate panics without sysfs.
    if !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_else(|error| {
        tracing::warn!(%error, "the serial ports cannot be listed");
        Vec::new()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serialport::UsbPortInfo;

    fn usb(name: &str, serial: Option<&str>) -> SerialPortInfo {
        let info = UsbPortInfo { vid: 0x0403, pid: 0x6001, serial_number: serial.map(Into::into), manufacturer: None, product: None };
        SerialPortInfo { port_name: name.into(), port_type: SerialPortType::UsbPort(info) }
    }

    #[test]
    fn an_adapter_is_found_under_whatever_name_it_has_and_never_mistaken() {
        let adapter = UsbAdapter { usb_serial: "A1".into() };
        let built_in = SerialPortInfo { port_name: "/dev/ttyS0".into(), port_type: SerialPortType::Unknown };
        let other = usb("/dev/ttyUSB0", Some("B2"));
        let found = adapter.among(&[built_in.clone(), other.clone(), usb("/dev/ttyUSB1", None), usb("/dev/ttyUSB7", Some("A1"))]);
        assert_eq!(found.unwrap(), "/dev/ttyUSB7");
        let said = adapter.among(&[built_in, other]).unwrap_err();
        assert!(said.contains("/dev/ttyUSB0 (\"B2\")"), "{said}");
        let said = adapter.among(&[usb("/dev/ttyUSB0", Some("A1")), usb("/dev/ttyUSB1", Some("A1"))]).unwrap_err();
        assert!(said.contains("both /dev/ttyUSB0 and /dev/ttyUSB1"), "{said}");
    }

    #[test]
    fn it_is_written_as_a_path_or_as_a_serial_number() {
        #[derive(Deserialize)]
        struct Table {
            port: Port,
        }
        let read = |text: &str| toml::from_str::<Table>(text).map(|t| t.port).map_err(|e| e.to_string());
        assert_eq!(read("port = \"/dev/ttyUSB0\"").unwrap(), Port::from("/dev/ttyUSB0"));
        assert_eq!(read("port = { usb_serial = \"A1\" }").unwrap(), Port::Usb(UsbAdapter { usb_serial: "A1".into() }));
        let said = read("port = { serial = \"A1\" }").unwrap_err();
        assert!(said.contains("usb_serial"), "{said}");
    }
}
