//! `carved doctor`: what is plugged into this computer, what answers, and what to write into the configuration.
//!
//! ```text
//! serial ports ── held by a program? ── left alone
//!              └─ else asked who they are ──► the lines for [rotation]
//! cameras that answer to discovery ─────────► the lines for [camera], who controls it, what the network takes
//! this computer ────────────────────────────► receive buffer, room for runs
//! ```
//! Nothing is moved, and no camera is opened. A port that another program holds is not opened, so that no controller restarts under it.

mod advice;
mod cameras;
mod computer;
mod holders;

use carved_devices::rotation::{Port, UsbAdapter, identify, serial_ports};
use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Look at this serial port only; may be given more than once. Else at all that there are.
    #[arg(long, value_name = "PATH")]
    port: Vec<String>,
    /// Only the serial ports; cameras are not looked for.
    #[arg(long)]
    no_cameras: bool,
    /// Folder of the runs, whose disk is looked at.
    #[arg(long, value_name = "DIR", default_value = "/var/lib/carved")]
    data: PathBuf,
    /// Baud at which the ports are asked.
    #[arg(long, default_value_t = 115_200)]
    baud: u32,
}

/// # Errors
/// Only output that cannot be written.
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

fn heading(port: &SerialPortInfo) -> String {
    let Some(usb) = usb(port) else { return port.port_name.clone() };
    let word = |text: &Option<String>| text.clone().unwrap_or_default();
    let names = [word(&usb.manufacturer), word(&usb.product)].join(" ");
    let serial = usb.serial_number.as_ref().map_or_else(|| "no serial number".into(), |s| format!("serial number {s:?}"));
    format!("{}  USB {:04x}:{:04x} {}, {serial}", port.port_name, usb.vid, usb.pid, names.trim())
}

/// What is found on a port, in words and lines of configuration.
fn answer(port: &SerialPortInfo, baud: u32) -> String {
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
            format!("nobody answers at {baud} baud: no Grbl, grblHAL, Zaber ASCII, VAST bridge or TMCL module 1; --baud asks at another")
        }
        Err(error) => error.to_string(),
    }
}

fn indented(text: &str) -> String {
    text.lines().map(|line| format!("  {line}\n")).collect()
}
