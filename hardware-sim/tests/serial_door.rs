//! Tests of the emulated serial port with the crate `serialport`, as a host uses it.

#![allow(clippy::unwrap_used, clippy::float_cmp)]

use hardware_sim::{Rig, RigSettings, TestCard};
use serialport::TTYPort;
use std::io::{ErrorKind, Read, Write};
use std::sync::Arc;
use std::time::{Duration, Instant};

const DEADLINE: Duration = Duration::from_secs(20);

fn rig(settings: RigSettings) -> Rig {
    Rig::start(RigSettings { time_scale: 20.0, ..settings }, Arc::new(TestCard::new(256, 64))).unwrap()
}

struct Host {
    port: TTYPort,
    heard: String,
}

impl Host {
    fn open(rig: &Rig) -> Self {
        let path = rig.serial_path();
        let port = serialport::new(path.to_string_lossy(), 115_200).timeout(Duration::from_millis(50)).open_native().unwrap();
        Self { port, heard: String::new() }
    }

    /// A host that has opened the port, read the greeting and unlocked the controller.
    fn ready(rig: &Rig) -> Self {
        let mut host = Self::open(rig);
        host.expect("to unlock]\r\n");
        host.ask("$X", "ok\r\n");
        host
    }

    fn send(&mut self, bytes: &[u8]) {
        self.port.write_all(bytes).unwrap();
    }

    /// Reads up to `end`. Returns everything up to it.
    fn expect(&mut self, end: &str) -> String {
        let deadline = Instant::now() + DEADLINE;
        loop {
            if let Some(at) = self.heard.find(end) {
                let rest = self.heard.split_off(at + end.len());
                return std::mem::replace(&mut self.heard, rest);
            }
            assert!(Instant::now() < deadline, "waiting for {end:?}, heard {:?}", self.heard);
            let mut chunk = [0; 256];
            match self.port.read(&mut chunk) {
                Ok(n) => self.heard.push_str(std::str::from_utf8(&chunk[..n]).unwrap()),
                Err(e) if e.kind() == ErrorKind::TimedOut => {}
                Err(e) => panic!("{e}"),
            }
        }
    }

    fn ask(&mut self, line: &str, end: &str) -> String {
        self.send(format!("{line}\n").as_bytes());
        self.expect(end)
    }

    fn status(&mut self) -> String {
        self.send(b"?");
        self.expect(">\r\n")
    }
}

#[test]
fn opening_the_port_resets_the_board_and_it_greets_once() {
    let rig = rig(RigSettings::default());
    let mut host = Host::open(&rig);
    assert_eq!(host.expect("unlock]\r\n"), "\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n");
    host.ask("$X", "ok\r\n");
    host.ask("G91 G0 X1", "ok\r\n");
    host.ask("G4 P0.01", "ok\r\n");
    assert!(host.status().contains("MPos:1.000"));
    // The close drops unread bytes and the exclusive lock.
    host.send(b"$$\n");
    drop(host);
    let mut again = Host::ready(&rig);
    assert!(again.status().contains("MPos:0.000"), "the board restarted");
}

#[test]
fn homing_moving_and_waiting_for_the_planner_over_the_port() {
    let rig = rig(RigSettings::default());
    let mut host = Host::ready(&rig);
    assert_eq!(host.ask("$H", "ok\r\n"), "ok\r\n");
    host.ask("G90 G1 X2.5 F400", "ok\r\n");
    host.ask("G4 P0.01", "ok\r\n");
    assert!(host.status().starts_with("<Idle|MPos:2.500,0.000,0.000|FS:0,0"));
    let half_turn = std::f64::consts::PI;
    assert!((rig.shaft().angle_rad() - half_turn).abs() < 1e-9);
}

#[test]
fn a_reset_over_the_port_stops_the_shaft() {
    let rig = rig(RigSettings::default());
    let mut host = Host::ready(&rig);
    let start = rig.shaft().angle_rad();
    host.ask("G91 G1 X5000 F300", "ok\r\n");
    let deadline = Instant::now() + DEADLINE;
    while rig.shaft().angle_rad() == start {
        assert!(Instant::now() < deadline, "the shaft never turned");
        std::thread::yield_now();
    }
    host.send(&[0x18]);
    host.expect("ALARM:3\r\n");
    host.expect("to unlock]\r\n");
    let stopped = rig.shaft().angle_rad();
    assert!(host.status().starts_with("<Alarm|"));
    assert_eq!(rig.shaft().angle_rad(), stopped);
}

#[test]
fn a_reboot_in_motion_is_silent() {
    let rig = rig(RigSettings::default());
    let mut host = Host::ready(&rig);
    host.ask("G91 G1 X5000 F300", "ok\r\n");
    rig.faults().reboot_controller();
    let said = host.expect("to unlock]\r\n");
    assert!(!said.contains("ALARM"), "{said}");
    assert!(host.status().contains("|MPos:0.000,"));
}

#[test]
fn an_unplugged_cable_closes_the_port_and_comes_back_at_the_link() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("motor");
    let rig = rig(RigSettings { serial_link: Some(link.clone()), ..RigSettings::default() });
    assert_eq!(rig.serial_path(), link);
    let mut host = Host::ready(&rig);
    rig.faults().unplug_serial();
    assert!(host.port.write_all(b"?").is_err() || host.port.read(&mut [0; 8]).is_err_and(|e| e.kind() != ErrorKind::TimedOut));
    assert!(std::fs::symlink_metadata(&link).is_err(), "the next pty of this computer may get the name to which it leads");
    drop(host);
    rig.faults().replug_serial().unwrap();
    let mut host = Host::ready(&rig);
    assert!(host.status().starts_with("<Idle|"));
    drop(host);
    drop(rig);
    assert!(std::fs::symlink_metadata(&link).is_err(), "nothing is left behind");
}

#[test]
fn answers_can_be_delayed_and_lost() {
    let rig = rig(RigSettings::default());
    let mut host = Host::ready(&rig);
    rig.faults().serial().drop_oks(1);
    host.send(b"G91 G0 X1\nG4 P0\n");
    assert_eq!(host.expect("ok\r\n"), "ok\r\n");
    assert!(host.status().starts_with("<Idle|MPos:1.000"), "the first line was carried out, one ok is missing");
    assert_eq!(host.heard, "");
    let delay = Duration::from_millis(300);
    rig.faults().serial().delay_answers(delay);
    let asked = Instant::now();
    host.status();
    assert!(asked.elapsed() >= delay);
}
