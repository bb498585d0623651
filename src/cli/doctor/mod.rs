//! `carved doctor`: which devices are connected, which of them answer, and what to write into the configuration.
//!
//! ```text
//! serial ports ── held by a program? ── not opened
//!              └─ else asked for their identity ──► the lines for [rotation]
//! cameras that answer to discovery ───────────────► the lines for [camera], who controls them, the network's packet size
//! this computer ──────────────────────────────────► receive buffer, free space for runs
//! ```
//! Nothing is moved, and no camera is opened. A port that another program holds is not opened, because opening it could restart its
//! controller.

pub mod advice;
mod cameras;
mod computer;
pub mod holders;

use carved_devices::rotation::{Port, UsbAdapter, identify, protocols, serial_ports};
use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Check only this serial port; may be given more than once. Without it all ports are checked.
    #[arg(long, value_name = "PATH")]
    port: Vec<String>,
    /// Check only the serial ports, not the cameras.
    #[arg(long)]
    no_cameras: bool,
    /// Folder of the runs, whose disk is checked.
    #[arg(long, value_name = "DIR", default_value = "/var/lib/carved")]
    data: PathBuf,
    /// Baud rate for the serial ports.
    #[arg(long, default_value_t = 115_200)]
    baud: u32,
}

/// Prints the report.
///
/// # Errors
/// Only if the output cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let known = serial_ports();
    let ports: Vec<SerialPortInfo> = if args.port.is_empty() {
        known
    } else {
        let named = |path: &String| {
            let unknown = || SerialPortInfo { port_name: path.clone(), port_type: SerialPortType::Unknown };
            known.iter().find(|p| p.port_name == *path).cloned().unwrap_or_else(unknown)
        };
        args.port.iter().map(named).collect()
    };
    if ports.is_empty() {
        say!("No serial port. Plug the controller in; `dmesg | tail` tells whether the kernel sees it.");
    }
    for port in &ports {
        say!("{}", heading(port));
        say!("{}", indented(&format!("{}{}", computer::access(&port.port_name), answer(port, args.baud))));
    }
    if !args.no_cameras {
        cameras::look()?;
    }
    say!("This computer");
    say!("{}", indented(&computer::facts(&args.data)));
    Ok(())
}

fn usb(port: &SerialPortInfo) -> Option<&UsbPortInfo> {
    match &port.port_type {
        SerialPortType::UsbPort(usb) => Some(usb),
        _ => None,
    }
}

/// Name of the port and its adapter.
pub fn heading(port: &SerialPortInfo) -> String {
    let Some(usb) = usb(port) else { return port.port_name.clone() };
    let word = |text: &Option<String>| text.clone().unwrap_or_default();
    let names = [word(&usb.manufacturer), word(&usb.product)].join(" ");
    let serial = usb.serial_number.as_ref().map_or_else(|| "no serial number".into(), |s| format!("serial number {s:?}"));
    format!("{}  USB {:04x}:{:04x} {}, {serial}", port.port_name, usb.vid, usb.pid, names.trim())
}

/// Text and lines of configuration about the device on a port.
pub fn answer(port: &SerialPortInfo, baud: u32) -> String {
    let holders = holders::of(&port.port_name);
    if !holders.is_empty() {
        return format!("held by {}: not asked. End that program to have the port looked at", holders.join(", "));
    }
    match identify(&Port::Path(port.port_name.clone()), baud) {
        Ok(Some(answer)) => {
            let serial = usb(port).and_then(|u| u.serial_number.clone());
            let configured = serial.map_or_else(|| Port::Path(port.port_name.clone()), |usb_serial| Port::Usb(UsbAdapter { usb_serial }));
            advice::of(&answer, &configured, baud)
        }
        Ok(None) => {
            format!("nobody answers at {baud} baud: no {}; --baud asks at another", protocols())
        }
        Err(error) => error.to_string(),
    }
}

fn indented(text: &str) -> String {
    text.lines().map(|line| format!("  {line}\n")).collect()
}
