//! `carved serve` as on an instrument: a configuration file, a plate-loader that speaks HTTP, and an emulated rig whose true shaft,
//! exposures and faults the test can see.
//!
//! ```text
//! test = plate-loader ── HTTP ──► carved serve (child) ── pty, GigE ──► emulated rig (in this process)
//!   └──────────────── true angle, exposures, faults, specimens ────────────┘
//! ```
#![cfg(feature = "aravis")]

use crate::common::held_disk::HeldDisk;
use crate::common::receiver::{Receiver, Reply};
use crate::common::{Daemon, Instrument, PATIENCE, QUICK, Rate, SLOW, SLOW_REFERENCE, json, run, standing, stderr, until};
use hardware_sim::scene::Specimen;
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::io::{Read, Write};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;

/// Steps per revolution of the rig and of the configuration.
const STEPS: f64 = 500.0;
/// Diameter of the bead, um.
const BEAD_UM: f64 = 500.0;

/// The policy keys of every method here.
const POLICY: &str = "retries = 1, bead_gate = \"off\"";
/// As `POLICY`, without a second attempt.
const ONCE: &str = "retries = 0, bead_gate = \"off\"";

fn start(rate: &Rate, policy: &str) -> Instrument {
    Instrument::start(rate, policy, |scene| scene)
}

impl Instrument {
    fn angle(&self) -> f64 {
        self.rig.shaft().angle_rad()
    }

    /// Starts a run of one larva and waits until the instrument asks for it.
    fn awaited(&self, run: &str) {
        let plan = plan(&[json!({"well": "A01", "specimen": "larva", "dpf": 4})]);
        assert_eq!(self.daemon.put_run(run, &plan), 201);
        let status = self.daemon.wait("the loader to be asked", |s| s["run"]["id"] == run && s["state"] == "Suspended");
        assert!(status["plate"]["needs"].as_str().unwrap().contains("A01"), "{status}");
    }

    fn load(&self, run: &str, well: &str, specimen: Specimen) {
        self.scene.load(Some(specimen)).unwrap();
        assert_eq!(self.daemon.put_loaded(run, well), 200);
    }

    /// A run on the slow instrument during the move to its second view. Returns the true angles at the start and at the target of this
    /// move.
    fn in_mid_move(&self, run: &str) -> (f64, f64) {
        self.awaited(run);
        self.load(run, "A01", Specimen::larva(4, 1).unwrap());
        self.moving()
    }

    /// As `in_mid_move`, of a larva that is loaded already.
    fn moving(&self) -> (f64, f64) {
        // The frame that judges the well, and the first view.
        until("the first view", || self.rig.exposures().len() >= 2);
        let from = self.rig.exposures()[1].angle_rad;
        let to = from + (STEPS / f64::from(SLOW.asd)).round() * TAU / STEPS;
        until("the move to the second view", || self.angle() > from + 0.1 * (to - from));
        (from, to)
    }

    /// Checks that during several answers of the daemon the shaft does not move and no exposure is made.
    fn nothing_follows(&self) {
        let (angle, exposures) = (standing(&self.rig), self.rig.exposures().len());
        for _ in 0..50 {
            self.daemon.status();
            assert_eq!(self.angle().to_bits(), angle.to_bits(), "the shaft moves again");
        }
        assert_eq!(self.rig.exposures().len(), exposures, "a frame was taken");
    }

    fn aborted(&self, run: &str) -> Value {
        self.aborted_with(run, 0)
    }

    fn aborted_with(&self, run: &str, faults: usize) -> Value {
        assert_eq!(self.daemon.post(&format!("/v1/runs/{run}/abort")), 200);
        let status = self.daemon.wait("the abort", |s| s["state"] == "Aborted");
        assert_eq!(status["run"]["outcome"], "aborted", "{status}");
        assert_eq!(status["run"]["results"][0]["outcome"], "aborted", "{status}");
        assert_eq!(status["faults"].as_array().unwrap().len(), faults, "an abort is no fault");
        status
    }

    /// The shaft stopped before its target.
    fn short_of(&self, (from, to): (f64, f64)) {
        let angle = standing(&self.rig);
        assert!(angle > from && angle < to - 0.1 * (to - from), "stands at {angle} rad on the way from {from} to {to}");
    }
}

fn plan(wells: &[Value]) -> Value {
    json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells})
}

#[test]
fn a_loader_brings_two_wells_and_both_are_measured() {
    // A receiver of notices that takes connections and never answers costs the run nothing.
    let receiver = Receiver::start(&[Reply::Never]);
    let notify = ("[store]", format!("[notify]\nurl = \"{}/T0SECRET\"\ntimeout_s = 1\n\n[store]", receiver.url));
    let instrument = Instrument::filled_by(None, &QUICK, POLICY, &[notify], |scene| scene);
    let daemon = &instrument.daemon;
    let kinds = ["bead", "larva"];
    let wells = [json!({"well": "A01", "specimen": kinds[0]}), json!({"well": "A02", "specimen": kinds[1], "dpf": 4})];
    assert_eq!(daemon.put_run("r1", &plan(&wells)), 201);
    // The plate may not be removed before its last specimen is measured and out of the capillary.
    let kept = |s: &Value| assert_eq!(s["plate"]["removable"], false, "{s}");
    for (well, specimen) in [("A01", Specimen::bead(BEAD_UM).unwrap()), ("A02", Specimen::larva(4, 1).unwrap())] {
        let status = daemon.wait("the loader to be asked", |s| {
            kept(s);
            s["plate"]["needs"].as_str().is_some_and(|n| n.contains(well)) && s["state"] == "Suspended"
        });
        assert_eq!(status["specimen"]["in_capillary"], false, "{status}");
        let former = well == "A02";
        assert_eq!(status["plate"]["needs"].as_str().unwrap().starts_with("the specimen of well A01 to be taken out"), former, "{status}");
        let exposures = instrument.rig.exposures().len();
        assert_eq!(daemon.put_loaded("r1", "B07"), 409, "another well than the one that is waited for");
        assert_eq!(instrument.rig.exposures().len(), exposures, "a look before the specimen is there");
        instrument.load("r1", well, specimen);
        daemon.wait("the well to be taken on", |s| {
            kept(s);
            s["state"] == "Execute" && s["plate"]["needs"].is_null()
        });
    }
    let status = daemon.wait("the run's end", |s| {
        kept(s);
        s["state"] == "Complete"
    });
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    assert_eq!(status["mode"], "hardware");
    let flags = |well: usize| &status["run"]["results"][well]["flags"];
    assert_eq!(flags(0), &json!([]), "{status}");
    assert_eq!(flags(1), &json!([]), "{status}");
    let diameter = status["run"]["results"][0]["diameter_um"].as_f64().unwrap();
    assert!((diameter / BEAD_UM - 1.0).abs() < 0.01, "bead: {diameter} um, truth {BEAD_UM} um");
    assert!(status["run"]["results"][1]["volume_um3"].as_f64().is_some(), "{status}");
    // The instrument does not see what the loader does: the last specimen counts as inside until the loader reports that it took it out.
    assert_eq!(status["plate"]["removable"], false, "{status}");
    assert_eq!(daemon.put_unloaded("r1", "A02"), 200);
    assert_eq!(daemon.status()["plate"]["removable"], true);
    let status = daemon.wait("the report on the receiver", |s| !s["notices"]["trouble"].is_null());
    assert!(status["faults"] == json!([]) && status["ready"] == true && !status.to_string().contains("T0SECRET"), "{status}");
    let (_, found) = daemon.send("POST", "/v1/preflight", &plan(&wells));
    let check = found["checks"].as_array().unwrap().iter().find(|check| check["code"] == "notices").unwrap();
    assert_eq!((&found["passed"], &check["passed"], &check["blocks"]), (&json!(true), &json!(false), &json!(false)), "{found}");
    let tried = receiver.received();
    assert!(tried.iter().all(|request| request.json()["event"] == "run.ended"), "only the end is worth a notice: {tried:?}");
    // Per well there are one judging frame, 21 views and the closure view. On a busy machine a late frame is triggered again.
    let exposures = instrument.rig.exposures().len();
    assert!((46..50).contains(&exposures), "{exposures}");
}

#[test]
fn an_abort_in_the_middle_of_a_move_leaves_the_shaft_standing_short_of_its_target() {
    let instrument = start(&SLOW, POLICY);
    let way = instrument.in_mid_move("r1");
    let status = instrument.aborted("r1");
    instrument.short_of(way);
    instrument.nothing_follows();
    assert_eq!(status["plate"]["removable"], false, "the specimen is still in the capillary: {status}");
    assert!(instrument.data.join("runs/r1/A01/SHA256SUMS").is_file(), "the recording is closed");
}

#[test]
fn nothing_moves_after_an_abort_that_comes_before_the_first_view() {
    let instrument = start(&SLOW_REFERENCE, POLICY);
    let daemon = &instrument.daemon;
    let at_start = instrument.angle();

    // Aborted while the loader is asked for a specimen. If the loader brings it nevertheless, the daemon knows that it is inside.
    instrument.awaited("load");
    let status = instrument.aborted("load");
    assert_eq!(status["plate"]["removable"], true, "nothing is in the capillary: {status}");
    assert_eq!((daemon.put_loaded("load", "A01"), daemon.put_loaded("load", "A02")), (200, 409));
    let status = daemon.status();
    assert_eq!((&status["plate"]["removable"], &status["ready"]), (&json!(false), &json!(false)), "{status}");
    assert_eq!((&status["specimen"]["well"], &status["specimen"]["in_capillary"]), (&json!("A01"), &json!(true)), "{status}");
    instrument.nothing_follows();
    assert_eq!(instrument.angle().to_bits(), at_start.to_bits(), "it never moved");
    assert_eq!(daemon.put_unloaded("load", "A01"), 200);

    // Aborted immediately after the loader's report: the reference is about to begin or has just begun.
    instrument.awaited("loaded");
    instrument.load("loaded", "A01", Specimen::larva(4, 1).unwrap());
    let status = instrument.aborted("loaded");
    instrument.nothing_follows();
    // On a slow disk the reference may have begun. It was not completed, which would have given angle 0.
    let begun = instrument.angle();
    assert!(begun.abs() > 10.0 * TAU / STEPS, "it stands at {begun} rad: the reference was found");
    assert_eq!(status["plate"]["removable"], false, "the specimen is in the capillary: {status}");
    let larva = json!({"well": "A01", "specimen": "larva", "dpf": 4});
    assert_eq!(daemon.put_run("homing", &plan(&[larva])), 409, "where would the next specimen go?");
    assert_eq!(daemon.put_unloaded("loaded", "A01"), 200);
    assert_eq!(daemon.status()["plate"]["removable"], true);

    // Aborted on the way to the reference.
    instrument.awaited("homing");
    instrument.load("homing", "A01", Specimen::larva(4, 1).unwrap());
    daemon.wait("the reference", |s| s["specimen"]["phase"] == "position");
    until("the shaft to turn", || (instrument.angle() - begun).abs() > 5.0 * TAU / STEPS);
    let status = instrument.aborted("homing");
    instrument.nothing_follows();
    assert!(instrument.angle().abs() > 10.0 * TAU / STEPS, "it stands at {} rad: the reference was found", instrument.angle());
    assert_eq!(status["hardware"]["rotation"]["referenced"], false, "{status}");
    assert_eq!(instrument.rig.exposures().len(), 0, "nothing was ever looked at");
}

#[test]
fn a_signal_in_the_middle_of_a_move_leaves_the_shaft_standing_short_of_its_target() {
    let instrument = start(&SLOW, POLICY);
    let way = instrument.in_mid_move("r1");
    instrument.daemon.signal("TERM");
    let Instrument { daemon, rig, scene, config, data, dir } = instrument;
    assert_eq!(daemon.ended(), Some(0));
    let angle = standing(&rig);
    assert!(angle > way.0 && angle < way.1 - 0.1 * (way.1 - way.0), "stands at {angle} rad on the way {way:?}");
    assert_eq!(json(&data.join("runs/r1/run.json"))["outcome"], "interrupted");
    assert!(data.join("runs/r1/A01/SHA256SUMS").is_file(), "the recording is closed");

    // The restarted daemon knows the run and the specimen that is still in the capillary.
    let daemon = Daemon::serve(&config, &data);
    let instrument = Instrument { daemon, rig, scene, config, data, dir };
    let status = started(&instrument.daemon);
    assert_eq!((&status["state"], &status["run"]["outcome"]), (&json!("Stopped"), &json!("interrupted")), "{status}");
    assert_eq!((&status["specimen"]["well"], &status["specimen"]["in_capillary"]), (&json!("A01"), &json!(true)), "{status}");
    assert_eq!((&status["ready"], &status["plate"]["removable"]), (&json!(false), &json!(false)), "{status}");
    assert_eq!(status["plate"]["needs"], "the specimen of well A01 to be taken out of the capillary", "{status}");
    assert_eq!(instrument.daemon.put_run("r2", &plan(&[json!({"well": "A01"})])), 409, "where would the next specimen go?");
    assert_eq!((instrument.daemon.put_unloaded("r1", "A01"), instrument.daemon.put_unloaded("r1", "A01")), (200, 200));
    let instrument = instrument.restarted("KILL");
    let status = started(&instrument.daemon);
    assert_eq!((&status["run"]["id"], &status["specimen"]), (&json!("r1"), &Value::Null), "{status}");
    assert_eq!((&status["ready"], &status["plate"]["removable"]), (&json!(true), &json!(true)), "{status}");
}

/// Reads what the daemon tells systemd until a message `is_meant`.
fn told(systemd: &UnixDatagram, what: &str, is_meant: impl Fn(&str) -> bool) -> String {
    let mut bytes = [0; 4096];
    loop {
        let length = systemd.recv(&mut bytes).unwrap_or_else(|why| panic!("systemd was not told {what}: {why}"));
        let message = String::from_utf8_lossy(&bytes[..length]).into_owned();
        if is_meant(&message) {
            return message;
        }
    }
}

/// The seconds that a write has taken, of a message that asks for more time.
fn write_takes_s(message: &str) -> Option<u64> {
    message.split_once("has taken ")?.1.split_once(" s ")?.0.parse().ok()
}

/// systemd kills a daemon that asks for no more time for ten seconds, and one that is not pinged. Three writes take long here: one of the
/// driver while the axis moves, one of the thread that closes the recording, and the one that closes the index.
#[test]
fn a_slow_disk_keeps_no_motor_turning_at_a_signal_and_the_daemon_ends_in_order_however_long_it_takes() {
    let (disk, dir) = (HeldDisk::new(), tempfile::tempdir().unwrap());
    let socket = dir.path().join("notify");
    let systemd = UnixDatagram::bind(&socket).unwrap();
    systemd.set_read_timeout(Some(PATIENCE)).unwrap();
    let Instrument { mut daemon, rig, scene, config, data, dir } = start(&SLOW, POLICY);
    daemon.kill();
    let [shim, held] = disk.paths();
    let environment = [("LD_PRELOAD", &*shim), ("SHIM_HELD", &held), ("NOTIFY_SOCKET", &socket), ("WATCHDOG_USEC", Path::new("5000000"))];
    let daemon = Daemon::serve_in(&config, &data, &environment);
    let instrument = Instrument { daemon, rig, scene, config, data, dir };
    instrument.awaited("r1");
    instrument.load("r1", "A01", Specimen::larva(4, 1).unwrap());
    disk.hold("events.jsonl");
    let way = instrument.moving();
    disk.wait_for("events.jsonl");
    disk.hold("SHA256SUMS.part");
    instrument.daemon.signal("TERM");
    told(&systemd, "the end", |message| message.contains("STOPPING=1"));
    // The driver still waits for its write.
    instrument.short_of(way);
    let waits_on = |name: &str| {
        disk.wait_for(name);
        systemd.set_nonblocking(true).unwrap();
        while systemd.recv(&mut [0; 4096]).is_ok() {}
        systemd.set_nonblocking(false).unwrap();
        // For longer than the 5 s after the end of an operation that count as work.
        let first = write_takes_s(&told(&systemd, name, |message| write_takes_s(message).is_some())).unwrap();
        let message = told(&systemd, name, |message| write_takes_s(message).is_some_and(|takes_s| takes_s >= first + 6));
        assert!(message.contains("EXTEND_TIMEOUT_USEC=10000000") && message.contains("The motors were stopped."), "{message}");
        told(&systemd, "that the driver lives", |message| message.contains("WATCHDOG=1"));
    };
    waits_on("events.jsonl");
    disk.let_go("events.jsonl");
    waits_on("SHA256SUMS.part");
    disk.hold("index.sqlite-wal");
    disk.let_go("SHA256SUMS.part");
    waits_on("index.sqlite-wal");
    disk.let_go("index.sqlite-wal");
    let Instrument { daemon, rig, scene, config, data, dir } = instrument;
    assert_eq!(daemon.ended(), Some(0));

    // Nothing is lost, and the next start finds an end in order.
    let a01 = data.join("runs/r1/A01");
    assert!(Command::new("sha256sum").args(["--check", "--strict", "--quiet", "SHA256SUMS"]).current_dir(&a01).status().unwrap().success());
    assert!(!json(&a01.join("recording.json"))["ledger"].as_array().unwrap().is_empty());
    let daemon = Daemon::serve(&config, &data);
    let instrument = Instrument { daemon, rig, scene, config, data, dir };
    let status = started(&instrument.daemon);
    assert_eq!((&status["state"], &status["run"]["outcome"]), (&json!("Stopped"), &json!("interrupted")), "{status}");
    assert_eq!((&status["faults"], &status["specimen"]["in_capillary"]), (&json!([]), &json!(true)), "{status}");
    let events = events(&instrument.data);
    assert!(events.iter().zip(1..).all(|(event, id)| event["id"] == id), "no event is lost");
    assert!(events.iter().any(|event| event["kind"] == "run.ended"));
}

/// The stop goes past the driver, which waits for the disk. That the disk was slow is a fault until writes have been fast for a minute.
#[test]
fn an_emergency_stop_while_the_disk_hangs_is_answered_and_the_slow_disk_becomes_a_fault_for_a_while() {
    let (disk, mut instrument) = (HeldDisk::new(), start(&SLOW, POLICY));
    instrument.daemon.kill();
    let [shim, held] = disk.paths();
    instrument.daemon = Daemon::serve_in(&instrument.config, &instrument.data, &[("LD_PRELOAD", &*shim), ("SHIM_HELD", &held)]);
    instrument.awaited("r1");
    instrument.load("r1", "A01", Specimen::larva(4, 1).unwrap());
    disk.hold("events.jsonl");
    let way = instrument.moving();
    disk.wait_for("events.jsonl");
    let daemon = &instrument.daemon;
    // Each is answered after a second at the latest, so the write takes longer than the two seconds from which a disk is slow.
    for _ in 0..3 {
        assert_eq!(daemon.post("/v1/emergency-stop?by=Kim"), 202, "stopped, and not in the record yet");
    }
    instrument.short_of(way);
    let status = daemon.wait("the words", |s| s["doing"].as_str().is_some_and(|doing| doing.contains("emergency stop was pressed")));
    assert_eq!((&status["ready"], &status["faults"]), (&json!(false), &json!([])), "{status}");
    disk.let_go("events.jsonl");
    let has = |status: &Value, code: &str| status["faults"].as_array().unwrap().iter().any(|fault| fault["code"] == code);
    let status = daemon.wait("the record", |s| has(s, "emergency_stop") && has(s, "disk_slow"));
    assert_eq!(status["run"]["outcome"], "aborted", "{status}");
    assert!(events(&instrument.data).iter().any(|e| e["kind"] == "run.abort_requested" && e["data"]["by"] == "Kim"));
    let status = daemon.wait("the disk to be fast", |s| !has(s, "disk_slow"));
    assert!(has(&status, "emergency_stop"), "{status}");
}

/// `systemctl reload` and an upgrade of the package: the next daemon continues the run by itself.
#[test]
fn a_daemon_that_leaves_for_a_restart_leaves_its_run_to_the_next_one() {
    let instrument = start(&SLOW, POLICY);
    let way = instrument.in_mid_move("r1");
    instrument.daemon.signal("USR1");
    let Instrument { daemon, rig, scene, config, data, dir } = instrument;
    assert_eq!(daemon.ended(), Some(75));
    let angle = standing(&rig);
    assert!(angle > way.0 && angle < way.1 - 0.1 * (way.1 - way.0), "stands at {angle} rad on the way {way:?}");
    assert_eq!(json(&data.join("runs/r1/run.json"))["outcome"], Value::Null);
    let daemon = Daemon::serve(&config, &data);
    let instrument = Instrument { daemon, rig, scene, config, data, dir };
    let status = instrument.daemon.wait("the run to go on", |s| s["state"] == "Suspended");
    assert_eq!((&status["run"]["id"], &status["run"]["outcome"]), (&json!("r1"), &Value::Null), "{status}");
    assert!(status["plate"]["needs"].as_str().unwrap().contains("A01"), "{status}");
    instrument.aborted("r1");
}

/// Whenever the stop comes after the signal, this daemon answers it and the next one knows it. A request that is half sent keeps this daemon
/// from its end.
#[test]
fn an_emergency_stop_at_a_daemon_that_leaves_for_a_restart_is_known_to_the_next_one() {
    let patient = ("[http]", "[http]\ndrain_ms = 600000\nhead_timeout_ms = 600000".to_owned());
    let mut instrument = Instrument::filled_by(None, &QUICK, POLICY, &[patient], |scene| scene);
    let stopped = |data: &std::path::Path| events(data).iter().filter(|e| e["kind"] == "daemon.stopped").count();
    for (run, moment) in [("r1", "at once"), ("r2", "while it ends"), ("r3", "when nothing is left to do")] {
        instrument.awaited(run);
        let daemon = &instrument.daemon;
        let host = daemon.url.strip_prefix("http://").unwrap();
        let mut half_sent = std::net::TcpStream::connect(host).unwrap();
        half_sent.write_all(format!("GET /v1/status HTTP/1.1\r\nHost: {host}\r\n").as_bytes()).unwrap();
        let before = stopped(&instrument.data);
        daemon.signal("USR1");
        match moment {
            "at once" => {}
            "while it ends" => drop(daemon.wait("the end", |s| s["not_ready_reason"] == "shutting down")),
            _ => {
                until("the last event", || stopped(&instrument.data) > before);
            }
        }
        assert_eq!(daemon.post("/v1/emergency-stop"), 200, "{moment}");
        half_sent.write_all(b"Connection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        half_sent.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("emergency_stop"), "{moment}: {answer}");
        let Instrument { daemon, rig, scene, config, data, dir } = instrument;
        assert_eq!(daemon.ended(), Some(75), "{moment}");
        let daemon = Daemon::serve(&config, &data);
        let status = started(&daemon);
        assert_eq!(status["faults"][0]["code"], "emergency_stop", "{moment}: {status}");
        assert_eq!((&status["state"], &status["run"]["outcome"]), (&json!("Aborted"), &json!("aborted")), "{moment}: {status}");
        assert_eq!(daemon.post(&format!("/v1/faults/{}/acknowledge", status["faults"][0]["seq"])), 200);
        instrument = Instrument { daemon, rig, scene, config, data, dir };
    }
}

/// The first status of a daemon that has read what earlier runs left.
fn started(daemon: &Daemon) -> Value {
    daemon.wait("the first word", |s| s["not_ready_reason"] != "starting")
}

/// The fault that says that a lost axis is back.
fn axis_is_back(daemon: &Daemon) -> Value {
    let is_back = |s: &Value| s["faults"].as_array().is_some_and(|f| f.len() == 1) && s["faults"][0]["code"] == "rotation_intervention";
    let status = daemon.wait("the axis to be back", is_back);
    assert!(status["faults"][0]["message"].as_str().unwrap().contains("was away and is back"), "{status}");
    assert_eq!((&status["hardware"]["rotation"]["connected"], &status["ready"]), (&json!(true), &json!(false)), "{status}");
    status["faults"][0].clone()
}

/// An operator's hold stays, whatever else holds the run before or after it and then clears.
#[test]
fn what_an_operator_holds_does_not_go_on_by_itself() {
    let instrument = start(&QUICK, ONCE);
    let daemon = &instrument.daemon;
    assert_eq!(daemon.put_run("r1", &plan(&[json!({"well": "A01", "specimen": "bead"})])), 201);
    let hold = || assert_eq!((daemon.post("/v1/runs/r1/hold"), daemon.post("/v1/runs/r1/hold")), (200, 200));
    for hold_comes_first in [true, false] {
        daemon.wait("the loader to be asked", |s| s["plate"]["needs"] == "the specimen of well A01 in the capillary");
        instrument.load("r1", "A01", Specimen::bead(BEAD_UM).unwrap());
        daemon.wait("the first views", |s| s["specimen"]["view"].as_u64() >= Some(2));
        if hold_comes_first {
            hold();
        }
        instrument.rig.faults().unplug_serial();
        let status = daemon.wait("the fault", |s| s["state"] == "Held");
        assert_eq!(status["run"]["held_by_operator"], hold_comes_first, "{status}");
        hold();
        instrument.rig.faults().replug_serial().unwrap();
        let seq = axis_is_back(daemon)["seq"].clone();
        assert_eq!(daemon.post(&format!("/v1/faults/{seq}/acknowledge")), 200);
        hold();
        let status = daemon.status();
        assert_eq!((&status["state"], &status["run"]["held_by_operator"]), (&json!("Held"), &json!(true)), "{status}");
        assert_eq!(daemon.post("/v1/runs/r1/unhold"), 200);
        daemon.wait("the loader to be asked to take it out", |s| s["state"] == "Suspended" && s["run"]["held_by_operator"] == false);
        assert_eq!(daemon.put_unloaded("r1", "A01"), 200);
    }
    let events = events(&instrument.data);
    let of = |kind: &str| events.iter().filter(|e| e["kind"] == kind).collect::<Vec<_>>();
    assert_eq!(of("run.hold_requested").len(), 2, "a repeat is the same hold");
    assert!(of("run.resumed").iter().all(|e| e["data"]["by"] == "operator") && of("run.resumed").len() == 2, "{events:?}");
}

#[test]
fn a_serial_cable_pulled_in_a_revolution_holds_the_run_and_names_the_axis() {
    let instrument = start(&SLOW, POLICY);
    instrument.in_mid_move("r1");
    instrument.rig.faults().unplug_serial();
    let status = instrument.daemon.wait("the fault", |s| s["state"] == "Held");
    assert_eq!(status["run"]["outcome"], Value::Null, "it is not over: {status}");
    assert_eq!((&status["run"]["wells"]["pending"], &status["run"]["results"][0]["outcome"]), (&json!(1), &Value::Null), "{status}");
    assert_eq!(status["faults"].as_array().unwrap().len(), 1, "{status}");
    assert_eq!(status["faults"][0]["code"], "rotation_lost", "{status}");
    assert_eq!(status["hardware"]["rotation"]["connected"], false, "{status}");
    assert_eq!(status["hardware"]["rotation"]["referenced"], false, "{status}");
    assert_eq!(status["ready"], false, "{status}");
    assert!(status["not_ready_reason"].as_str().unwrap().contains("rotation"), "{status}");
    assert_eq!(status["plate"]["removable"], false, "the specimen is still in the capillary: {status}");
    let (code, problem) = instrument.daemon.send("POST", "/v1/runs/r1/unhold", &Value::Null);
    assert_eq!((code, &problem["code"]), (503, &json!("device_lost")), "nothing goes on without the axis: {problem}");
    let events = events(&instrument.data);
    let raised = events.iter().find(|e| e["kind"] == "fault.raised").unwrap();
    assert_eq!((&raised["run"], &raised["data"]["code"]), (&json!("r1"), &json!("rotation_lost")));
    let recording = instrument.data.join("runs/r1/A01");
    assert!(recording.join("SHA256SUMS").is_file(), "the recording is closed");
    assert_eq!(json(&recording.join("recording.json"))["ledger"].as_array().unwrap().len(), 1, "the view that was taken is kept");
    // A held run can be ended.
    let status = instrument.aborted_with("r1", 1);
    assert_eq!(status["faults"][0]["code"], "rotation_lost", "{status}");
}

fn events(data: &std::path::Path) -> Vec<Value> {
    let text = std::fs::read_to_string(data.join("events.jsonl")).unwrap();
    text.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
}

/// The policy gives up the current specimen. The plate continues with the next well once the axis is back.
#[test]
fn an_interrupted_specimen_is_skipped_where_the_method_says_so() {
    let instrument = start(&QUICK, &format!("{ONCE}, interrupted = \"skip\""));
    let daemon = &instrument.daemon;
    let wells = [json!({"well": "A01", "specimen": "bead"}), json!({"well": "A02", "specimen": "bead"})];
    assert_eq!(daemon.put_run("r1", &plan(&wells)), 201);
    daemon.wait("the loader to be asked", |s| s["state"] == "Suspended");
    instrument.load("r1", "A01", Specimen::bead(BEAD_UM).unwrap());
    daemon.wait("the first views", |s| s["specimen"]["view"].as_u64() >= Some(2));
    instrument.rig.faults().unplug_serial();
    let status = daemon.wait("the fault", |s| s["state"] == "Held");
    assert_eq!(status["run"]["results"][0]["outcome"], "interrupted", "{status}");
    instrument.rig.faults().replug_serial().unwrap();
    daemon.go_on("r1", &axis_is_back(daemon));
    let out = |s: &Value, well: &str| s["plate"]["needs"].as_str().is_some_and(|n| n.contains(well) && n.contains("taken out"));
    daemon.wait("the loader to be asked to take it out", |s| s["state"] == "Suspended" && out(s, "A01"));
    assert_eq!(daemon.put_unloaded("r1", "A01"), 200);
    daemon.wait("the next well", |s| s["state"] == "Suspended" && s["plate"]["needs"].as_str().is_some_and(|n| n.contains("A02")));
    instrument.load("r1", "A02", Specimen::bead(BEAD_UM).unwrap());
    let status = daemon.wait_for_outcome();
    assert_eq!((&status["run"]["outcome"], &status["faults"]), (&json!("partial"), &json!([])), "{status}");
    assert_eq!((&status["run"]["wells"]["interrupted"], &status["run"]["wells"]["succeeded"]), (&json!(1), &json!(1)), "{status}");
    assert!(!instrument.data.join("runs/r1/A01.attempt-1").exists(), "what is skipped is not begun anew");
}

/// Opening the port of a controller may reset it during a move. A second daemon is therefore refused before it touches a device.
#[test]
fn a_second_daemon_on_the_same_data_leaves_the_run_of_the_first_alone() {
    let instrument = start(&SLOW, ONCE);
    let (from, to) = instrument.in_mid_move("r1");
    let second = run(&["serve", "--config", instrument.config.to_str().unwrap()]);
    assert!(!second.status.success());
    assert!(stderr(&second).contains("another carved uses this folder"), "{}", stderr(&second));
    let second_view = || instrument.rig.exposures().into_iter().map(|e| e.angle_rad).find(|at| *at > 0.5 * (from + to));
    until("the second view", || second_view().is_some());
    // Half a step: the view was taken at its planned angle.
    let at = second_view().unwrap();
    assert!((at - to).abs() < 0.5 * TAU / STEPS, "{at} rad instead of {to}");
    let status = instrument.daemon.status();
    assert_eq!((&status["faults"], &status["state"]), (&json!([]), &json!("Execute")), "{status}");
}

/// A specimen that the policy has given up stays so, also if the run is held and the daemon dies again.
#[test]
fn a_specimen_that_a_crash_has_cost_is_not_asked_for_again_where_the_method_says_so() {
    let mut instrument = start(&QUICK, &format!("{ONCE}, interrupted = \"skip\""));
    let wells = [json!({"well": "A01", "specimen": "bead"}), json!({"well": "A02", "specimen": "bead"})];
    assert_eq!(instrument.daemon.put_run("r1", &plan(&wells)), 201);
    instrument.daemon.wait("the loader to be asked", |s| s["state"] == "Suspended");
    instrument.load("r1", "A01", Specimen::bead(BEAD_UM).unwrap());
    instrument.daemon.wait("the first views", |s| s["specimen"]["view"].as_u64() >= Some(2));
    assert_eq!(instrument.daemon.post("/v1/runs/r1/hold"), 200);
    for _life in 0..2 {
        instrument.daemon.kill();
        instrument.daemon = Daemon::serve(&instrument.config, &instrument.data);
        let given_up = |s: &Value| s["state"] == "Held" && s["run"]["results"][0]["outcome"] == "interrupted";
        instrument.daemon.wait("the held run, its first well given up", given_up);
    }
    let daemon = &instrument.daemon;
    assert_eq!(daemon.post("/v1/runs/r1/unhold"), 200);
    let needs = |s: &Value, what: &str| s["state"] == "Suspended" && s["plate"]["needs"].as_str().is_some_and(|n| n.contains(what));
    daemon.wait("the loader to be asked to take it out", |s| needs(s, "A01 to be taken out"));
    assert_eq!(daemon.put_unloaded("r1", "A01"), 200);
    daemon.wait("the next well", |s| {
        assert!(!needs(s, "A01 in the capillary"), "it was given up: {s}");
        needs(s, "A02 in the capillary")
    });
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200);
    let status = daemon.wait_for_outcome();
    assert_eq!(status["run"]["results"][0]["outcome"], "interrupted", "{status}");
}

/// A preflight reports everything that fails, not only the first fault. A plate that does not fit on the disk is not started.
#[test]
fn a_preflight_names_everything_that_fails() {
    let instrument = start(&Rate { asd: 500, ..QUICK }, POLICY);
    let daemon = &instrument.daemon;
    daemon.wait("readiness", |s| s["ready"] == true);
    let one = plan(&[json!({"well": "A01", "specimen": "larva", "dpf": 4})]);
    let failed = |found: &Value| {
        let failed = found["checks"].as_array().unwrap().iter().filter(|c| c["passed"] == false);
        failed.map(|c| c["code"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let (code, found) = daemon.send("POST", "/v1/preflight", &one);
    assert_eq!((code, &found["passed"]), (200, &json!(true)), "{found}");
    assert_eq!(failed(&found), [""; 0], "{found}");

    let plate: Vec<Value> = ('A'..='P').flat_map(|row| (1..=24).map(move |n| json!({"well": format!("{row}{n:02}")}))).collect();
    let (_, found) = daemon.send("POST", "/v1/preflight", &plan(&plate));
    assert!(failed(&found).contains(&"disk_budget".to_owned()) && found["passed"] == false, "{found}");
    let (code, problem) = daemon.send("PUT", "/v1/runs/large", &plan(&plate));
    assert_eq!((code, &problem["code"]), (507, &json!("will_not_fit")), "{problem}");

    assert_eq!(daemon.send("PUT", "/v1/plate/handoff", &json!({"intent": "load", "barcode": "P-9"})).0, 200);
    assert_eq!(daemon.send("PUT", "/v1/plate/handoff/completed", &Value::Null).0, 200);
    instrument.rig.faults().unplug_serial();
    instrument.rig.faults().camera().steal_control(true);
    daemon.wait("both faults", |s| s["faults"].as_array().is_some_and(|f| f.len() == 2));
    let (code, found) = loop {
        let (code, found) = daemon.send("POST", "/v1/preflight", &one);
        // The daemon is looking for the devices at this moment.
        if found["code"] != "busy" {
            break (code, found);
        }
    };
    assert_eq!((code, &found["passed"]), (200, &json!(false)), "{found}");
    assert_eq!(failed(&found), ["rotation", "camera", "faults", "plate"], "{found}");
    assert!(found["checks"][0]["what_to_do"].as_str().unwrap().contains("cable"), "{found}");
}

/// The cable of the emulated rig is pulled and plugged in again under the configured name. An emergency stop that cuts the supply looks the
/// same, so a person decides when the axis turns again.
#[test]
fn an_axis_that_is_lost_between_runs_or_in_one_is_opened_again_and_waits_for_a_person() {
    let instrument = start(&QUICK, POLICY);
    let daemon = &instrument.daemon;
    daemon.wait("readiness", |s| s["ready"] == true);
    instrument.rig.faults().unplug_serial();
    let status = daemon.wait("the fault", |s| s["ready"] == false);
    assert_eq!(status["faults"][0]["code"], "rotation_lost", "{status}");
    assert_eq!(status["faults"][0]["scheduler_action"], "pause_instrument", "{status}");
    assert_eq!(status["hardware"]["rotation"]["connected"], false, "{status}");
    let plan = plan(&[json!({"well": "A01", "specimen": "bead"})]);
    assert_eq!(daemon.put_run("r1", &plan), 503, "nothing runs without the axis");
    instrument.rig.faults().replug_serial().unwrap();
    let seq = axis_is_back(daemon)["seq"].clone();
    assert_eq!(daemon.put_run("r1", &plan), 409, "a scheduler would turn the axis");
    assert_eq!(daemon.post(&format!("/v1/faults/{seq}/acknowledge")), 200);
    daemon.wait("readiness", |s| s["ready"] == true);

    // The same during a run: once it is continued, the specimen is taken out, loaded again and measured.
    assert_eq!(daemon.put_run("r1", &plan), 201);
    daemon.wait("the loader to be asked", |s| s["state"] == "Suspended");
    instrument.load("r1", "A01", Specimen::bead(BEAD_UM).unwrap());
    // A specimen that is loaded while the run is held is not taken out, and whichever comes first: the load, or the look at the axis.
    daemon.wait("the first views", |s| s["specimen"]["view"].as_u64() >= Some(2));
    instrument.rig.faults().unplug_serial();
    let status = daemon.wait("the fault", |s| s["state"] == "Held");
    assert_eq!(status["faults"][0]["code"], "rotation_lost", "{status}");
    assert_eq!(status["ready"], false, "{status}");
    assert_eq!(status["run"]["goes_on_by_itself"], false, "{status}");
    instrument.rig.faults().replug_serial().unwrap();
    let back = axis_is_back(daemon);
    let status = daemon.status();
    assert_eq!((&status["state"], &status["run"]["goes_on_by_itself"]), (&json!("Held"), &json!(false)), "{status}");
    daemon.go_on("r1", &back);
    let status = daemon.wait("the run to go on", |s| s["state"] == "Suspended");
    assert_eq!((&status["faults"], &status["run"]["outcome"]), (&json!([]), &Value::Null), "{status}");
    assert!(status["plate"]["needs"].as_str().unwrap().contains("taken out"), "{status}");
    assert_eq!(daemon.put_unloaded("r1", "A01"), 200);
    let asked = |s: &Value| s["state"] == "Suspended" && s["plate"]["needs"].as_str().is_some_and(|n| n.ends_with("in the capillary"));
    daemon.wait("the loader to be asked again", asked);
    instrument.load("r1", "A01", Specimen::bead(BEAD_UM).unwrap());
    assert_eq!(daemon.wait_for_outcome()["run"]["outcome"], "succeeded");
    let kinds: Vec<Value> = events(&instrument.data).iter().map(|e| e["kind"].clone()).collect();
    let count = |kind: &str| kinds.iter().filter(|k| *k == kind).count();
    assert_eq!((count("fault.cleared"), count("run.held"), count("run.resumed"), count("run.ended")), (2, 1, 1, 1), "{kinds:?}");

    // A run that was measured and pruned cannot be started again under its name.
    std::fs::remove_dir_all(instrument.data.join("runs/r1")).unwrap();
    let (code, problem) = daemon.send("PUT", "/v1/runs/r1", &plan);
    assert_eq!((code, &problem["code"]), (409, &json!("pruned")), "{problem}");
}

#[test]
fn steps_lost_in_a_revolution_hold_the_run_with_the_larva_inside() {
    let instrument = start(&QUICK, ONCE);
    instrument.awaited("r1");
    instrument.load("r1", "A01", Specimen::larva(4, 1).unwrap());
    until("the first views", || instrument.rig.exposures().len() >= 6);
    // 60 of 500 steps: the capillary stands for 43 deg while the controller counts on.
    instrument.rig.faults().lose_steps(60);
    let status = instrument.daemon.wait("the hold", |s| s["state"] == "Held" || !s["run"]["outcome"].is_null());
    let fault = &status["faults"][0];
    assert_eq!((&fault["code"], &fault["operator_required"]), (&json!("rotation_suspect"), &json!(true)), "{status}");
    assert_eq!((&status["specimen"]["well"], &status["specimen"]["in_capillary"]), (&json!("A01"), &json!(true)), "{status}");
    instrument.daemon.go_on("r1", fault);
    let status = instrument.daemon.wait_for_outcome();
    assert!(status["run"]["results"][0]["volume_um3"].as_f64().is_some(), "{status}");
}
