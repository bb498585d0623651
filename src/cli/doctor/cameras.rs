//! The cameras that answer, who controls them, and the lines for `[camera]`.

use super::{advice, computer, indented};
use carved_devices::camera::{Controller, Listed, controller, discover};
use std::fmt::Write;
use std::net::Ipv4Addr;

pub fn look() -> anyhow::Result<()> {
    if cfg!(not(feature = "aravis")) {
        say!("Cameras\n  this build has no driver for them: it was built without the feature aravis\n");
        return Ok(());
    }
    let found = discover();
    if found.is_empty() {
        say!(
            "No camera answers. Check its power and cable, and that this computer has an address in the camera's network; a camera behind \
             a router is selected by its address and does not answer here\n"
        );
    }
    for camera in &found {
        say!("{}", heading(camera));
        say!("{}", indented(&advice(camera)));
    }
    Ok(())
}

fn heading(camera: &Listed) -> String {
    let word = |text: &Option<String>| text.clone().unwrap_or_else(|| "unknown".into());
    format!(
        "Camera {} {}, serial number {}, hardware address {}, address {}",
        word(&camera.vendor),
        word(&camera.model),
        word(&camera.serial),
        word(&camera.mac),
        word(&camera.address)
    )
}

fn advice(camera: &Listed) -> String {
    let address: Option<Ipv4Addr> = camera.address.as_deref().and_then(|a| a.parse().ok());
    let mut text = String::new();
    let _ = match address.map(controller) {
        Some(Controller::Nobody) => writeln!(text, "nobody controls it"),
        Some(Controller::Somebody(Some(host))) => {
            writeln!(text, "controlled by a program on {host}: end that one before carved is started")
        }
        Some(Controller::Somebody(None)) => writeln!(text, "controlled by a program: end that one before carved is started"),
        Some(Controller::Unknown) | None => writeln!(text, "it does not say whether somebody controls it"),
    };
    text.push_str("[camera]\ndriver = \"aravis\"\n");
    let _ = match (address, &camera.serial) {
        (Some(address), _) => writeln!(text, "select = {{ address = \"{address}\" }}"),
        (None, Some(serial)) => writeln!(text, "select = {{ serial = {serial:?} }}"),
        (None, None) => Ok(()),
    };
    if let Some(way) = address.and_then(computer::way_to) {
        let (packet_size, why) = if way.mtu >= 9000 {
            (8228, "if every switch on the way takes 9000 bytes, too")
        } else {
            (1500, "8228 with an MTU of 9000 from here to the camera: fewer, larger packets")
        };
        let _ = writeln!(text, "packet_size = {packet_size}   # {} has an MTU of {}; {why}", way.interface, way.mtu);
    }
    text.push_str(&advice::example("vast-grbl.toml"));
    text
}
