//! `carved doctor` on emulated controllers: what they are, what to configure, and that nothing moved.

use crate::common::{controllers, run, stderr};
use carved_devices::rotation::{Grbl, Reference};
use hardware_sim::grbl::Settings;
use hardware_sim::{Controller, Rig, RigSettings, TestCard};
use std::io::{Read, Write};
use std::sync::Arc;
use std::time::Duration;

fn rig(controller: Controller) -> Rig {
    Rig::start(RigSettings { controller, ..RigSettings::default() }, Arc::new(TestCard::new(64, 64))).unwrap()
}

fn doctor(port: &str) -> String {
    let output = run(&["doctor", "--no-cameras", "--port", port]);
    assert!(output.status.success(), "{}", stderr(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// The report of the doctor, after a check that the shaft did not move.
fn examined(rig: &Rig) -> String {
    let before = rig.shaft().angle_rad();
    let said = doctor(rig.serial_path().to_str().unwrap());
    assert_eq!(rig.shaft().angle_rad().to_bits(), before.to_bits(), "it moved: {said}");
    said
}

#[test]
fn grbl_and_grblhal_are_distinguished_and_their_settings_written_down() {
    for (controller, name) in
        [(Controller::default(), "Grbl: Grbl 1.1h"), (Controller::GrblHal(Settings::default()), "grblHAL: GrblHAL 1.1f")]
    {
        let said = examined(&rig(controller));
        for part in [name, "driver = \"grbl\"", "steps_per_unit = [100, 1]", "max_rate_units_per_min = 500.0", "reference = \"home\""] {
            assert!(said.contains(part), "{part:?} is missing: {said}");
        }
    }
}

#[test]
fn motors_that_are_switched_off_after_a_move_are_reported() {
    for (idle_ms, told) in [(25.0, true), (255.0, false)] {
        let mut settings = Settings::default();
        settings.set(1, idle_ms).unwrap();
        let said = examined(&rig(Controller::Grbl(settings)));
        assert_eq!(said.contains("set $1=255 in the controller"), told, "{said}");
    }
}

#[test]
fn a_controller_that_does_not_restart_is_known_by_its_report() {
    let rig = rig(Controller::default());
    // The controller has started once. The greeting of the restart that the doctor causes is lost on the way.
    let mut first = serialport::new(rig.serial_path().to_str().unwrap(), 115_200).timeout(Duration::from_secs(30)).open_native().unwrap();
    let mut heard = Vec::new();
    while !heard.ends_with(b"unlock]\r\n") {
        let mut byte = [0];
        first.read_exact(&mut byte).unwrap();
        heard.push(byte[0]);
    }
    drop(first);
    rig.faults().serial().rewrite_next(b"Grbl 1.1h", b"\xff\xff");
    let said = examined(&rig);
    assert!(said.contains("Grbl: [VER:1.1h") && said.contains("driver = \"grbl\""), "{said}");
}

#[test]
fn a_trigger_bridge_is_known_by_its_settings_and_never_triggered() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(Controller::Bridge(hardware_sim::bridge::Settings::reading(folder.path().join("external.txt"))));
    let said = examined(&rig);
    assert!(said.contains("VAST trigger bridge") && said.contains("driver = \"vast_bridge\""), "{said}");
}

#[test]
fn trinamic_modules_and_zaber_controllers_are_known_without_being_moved() {
    for (controller, parts) in [
        (
            Controller::Tmcl(hardware_sim::tmcl::Settings::default()),
            ["Trinamic TMCM-6212, firmware 1.", "driver = \"tmcl\"", "vast-tmcl.toml"],
        ),
        (
            Controller::Zaber(hardware_sim::zaber::Settings::default()),
            ["Zaber, ASCII protocol: @01", "driver = \"zaber\"", "vast-zaber.toml"],
        ),
        (
            Controller::Zaber(hardware_sim::zaber::Settings { slash_first: true, ..hardware_sim::zaber::Settings::default() }),
            ["Zaber, ASCII protocol: @01", "driver = \"zaber\"", "vast-zaber.toml"],
        ),
    ] {
        let said = examined(&rig(controller));
        for part in parts {
            assert!(said.contains(part), "{part:?} is missing: {said}");
        }
    }
}

#[cfg(feature = "aravis")]
#[test]
fn cameras_are_listed_with_who_has_them_and_what_to_configure() {
    use carved_core::frame::PixelFormat;
    use carved_devices::camera::{self, AravisSettings, CameraSelect};
    let rig = rig(Controller::default());
    let look = || {
        let output = run(&["doctor", "--port", "/dev/no-such-port", "--data", "/no/such/folder"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let said = String::from_utf8(output.stdout).unwrap();
        let own = said.split("Camera ").find(|part| part.contains(rig.camera_serial()));
        (own.unwrap_or_else(|| panic!("{} is not listed: {said}", rig.camera_serial())).to_owned(), said)
    };
    let (own, said) = look();
    let address = rig.camera_address().to_string();
    let [_, b, c, d] = rig.camera_address().octets();
    for part in [
        "carved Emulated GE1050C, serial number ",
        &format!("hardware address 02:7f:{b:02x}:{c:02x}:{d:02x}:50"),
        "nobody controls it",
        &format!("select = {{ address = \"{address}\" }}"),
        "packet_size = 8228   # lo has an MTU of ",
    ] {
        assert!(own.contains(part), "{part:?} is missing: {own}");
    }
    assert!(said.contains("net.core.rmem_max = ") && said.contains("GB free for runs in /no/such/folder"), "{said}");
    // The doctor's look at a camera disturbs neither the camera nor the program that controls it.
    let settings = AravisSettings::new(CameraSelect::Address(rig.camera_address()), PixelFormat::Mono8, 64, 64, 1000.0);
    let mut ours = camera::open(settings).unwrap();
    ours.arm().unwrap();
    assert!(look().0.contains("controlled by a program"));
    ours.grab(Duration::from_secs(10)).unwrap();
}

#[test]
fn a_port_that_somebody_holds_is_left_alone() {
    let rig = rig(Controller::default());
    let path = rig.serial_path();
    // The port is held by the driver itself, which locks it against all others.
    let _held = Grbl::open(controllers::grbl(controllers::serial_port(&rig), Reference::Here)).unwrap();
    let said = doctor(path.to_str().unwrap());
    assert!(said.contains("Close the other program"), "{said}");
}

/// As at another baud rate: the answers cannot be read, and that is not silence.
#[test]
fn bytes_that_no_controller_sends_are_shown() {
    let port = nix::pty::openpty(None, None).unwrap();
    let mut raw = nix::sys::termios::tcgetattr(&port.slave).unwrap();
    nix::sys::termios::cfmakeraw(&mut raw);
    nix::sys::termios::tcsetattr(&port.slave, nix::sys::termios::SetArg::TCSANOW, &raw).unwrap();
    std::fs::File::from(port.master.try_clone().unwrap()).write_all(b"\x01\x0f\x81\x05").unwrap();
    let said = doctor(nix::unistd::ttyname(&port.slave).unwrap().to_str().unwrap());
    assert!(said.contains(r"\x01\x0f\x81\x05") && !said.contains("nobody answers"), "{said}");
    // This process holds the other end open, so it may be the cause.
    assert!(said.contains("Exit the other program that has the port open: ") && !said.contains("baud rate"), "{said}");
}

#[test]
fn silence_and_absence_are_said() {
    let (_master, slave) = serialport::TTYPort::pair().unwrap();
    let silent = serialport::SerialPort::name(&slave).unwrap();
    drop(slave);
    let said = doctor(&silent);
    assert!(said.contains("nobody answers at 115200 baud"), "{said}");
    let said = doctor("/dev/no-such-port");
    assert!(said.contains("/dev/no-such-port") && said.contains("cable"), "{said}");
}
