//! Settings that are refused, and a list that is not a regular file. `tests/devices/motion_bridge.rs` tests the driver against an
//! emulated bridge.

use super::*;
use crate::rotation::scripted::Scripted;
use std::path::Path;
use std::sync::mpsc::channel;

pub(super) fn settings(port: &str, list: &Path) -> VastBridgeSettings {
    VastBridgeSettings {
        port: port.into(),
        baud: 115_200,
        list: list.to_owned(),
        x_position_um: 0,
        tray_led: true,
        speed_deg_per_s: 360.0,
        turn_margin_ms: 400,
        first_arrival_timeout_ms: 400,
        answer_timeout_ms: 400,
        end_with_trigger: true,
    }
}

#[test]
fn settings_that_no_bridge_can_have_are_named_with_their_value() {
    let refused = |change: fn(&mut VastBridgeSettings), steps: u32| {
        let mut changed = settings("port", Path::new("external.txt"));
        change(&mut changed);
        changed.check(StepsPerRevolution::new(steps, 1).unwrap()).map_err(|e| e.to_string())
    };
    refused(|_| {}, 500).unwrap();
    let said = |change, steps, words: [&str; 2]| {
        let said = refused(change, steps).unwrap_err();
        assert!(words.iter().all(|w| said.contains(w)), "{words:?} are not in: {said}");
    };
    said(|_| {}, 6400, ["steps_per_revolution", "6400"]);
    said(|s| s.speed_deg_per_s = -3.0, 500, ["speed_deg_per_s", "-3"]);
    said(|s| s.speed_deg_per_s = f64::NAN, 500, ["speed_deg_per_s", "NaN"]);
    said(|s| s.turn_margin_ms = 0, 500, ["turn_margin_ms", "0"]);
    said(|s| s.answer_timeout_ms = 0, 500, ["answer_timeout_ms", "0"]);
    said(|s| s.first_arrival_timeout_ms = 0, 500, ["first_arrival_timeout_ms", "0"]);
    said(|s| s.list = "/".into(), 500, ["list", "/"]);
}

#[test]
fn a_pipe_in_the_place_of_the_list_is_an_error_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("external.txt");
    nix::unistd::mkfifo(&list, nix::sys::stat::Mode::S_IRWXU).unwrap();
    let controller = Scripted::play(vec![(b"X?\n".to_vec(), b"OK\r\n1\r\n2\r\n3\r\n4\r\n".to_vec())]);
    let mut bridge = VastBridge::open(settings(&controller.port(), &list), StepsPerRevolution::new(500, 1).unwrap()).unwrap();
    let (send, receive) = channel();
    // Reading a pipe would wait for ever, so this thread may never end.
    std::thread::spawn(move || {
        let announced = bridge.announce(&[Steps(0), Steps(250)]);
        send.send((announced, bridge)).unwrap();
    });
    let (announced, bridge) = receive.recv_timeout(Duration::from_secs(20)).expect("an answer at once");
    let error = announced.unwrap_err();
    assert!(matches!(&error, DeviceError::List { path, why, .. } if *path == list && why.contains("a pipe")), "{error}");
    controller.followed(bridge);
}
