//! The driver of the relay against an emulated relay and its VAST.
#![cfg(feature = "aravis")]

use crate::motion::{SCALE, SPEED_DEG_PER_S, is_suspect, true_steps, turn, until, with_camera};
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Relay, RelaySettings};
use carved_devices::{Capabilities, DeviceError, Position, RotationAxis};
use carved_records::ViewOrder;
use hardware_sim::RigSettings;
use hardware_sim::relay::{self, Knobs};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

fn at(address: &str) -> RelaySettings {
    RelaySettings {
        address: address.to_owned(),
        boot: false,
        boot_timeout_ms: 5000,
        speed_deg_per_s: SPEED_DEG_PER_S,
        turn_margin_ms: 1000,
        answer_timeout_ms: 700,
    }
}

struct Bench {
    knobs: Knobs,
    speed_deg_per_s: f64,
    emulated: hardware_sim::Rig,
}

impl Bench {
    fn new() -> Self {
        Self::with(relay::Settings::default())
    }

    fn with(machine: relay::Settings) -> Self {
        let (knobs, speed_deg_per_s) = (machine.knobs.clone(), SCALE * machine.speed_deg_per_s);
        Self { knobs, speed_deg_per_s, emulated: crate::motion::rig(RigSettings { relay: Some(machine), ..RigSettings::default() }) }
    }

    fn settings(&self) -> RelaySettings {
        RelaySettings { speed_deg_per_s: self.speed_deg_per_s, ..at(&self.emulated.relay_address().unwrap().to_string()) }
    }

    fn open(&self) -> Relay {
        Relay::open(self.settings(), crate::motion::per_revolution()).unwrap()
    }

    /// A referenced axis, and the true position of its step 0.
    fn referenced(&self) -> (Relay, f64) {
        let mut axis = self.open();
        axis.reference(&CancelToken::new()).unwrap();
        (axis, true_steps(&self.emulated))
    }
}

#[test]
fn a_revolution_of_differences_shows_every_view_at_the_angle_of_its_ledger() {
    let bench = Bench::new();
    let axis = bench.open();
    let expected = Capabilities {
        has_position: false,
        has_encoder: false,
        has_stall: false,
        can_stop: false,
        absolute: false,
        trigger_only: false,
        outside: false,
    };
    assert_eq!(axis.capabilities(), expected);
    let mut devices = with_camera(&bench.emulated, Box::new(axis));
    for (epoch, order, splits) in [(1, ViewOrder::Sequential, false), (2, ViewOrder::CoarseToFine, true)] {
        bench.knobs.split_answers(splits);
        assert_eq!(devices.rotation.reference(&CancelToken::new()).unwrap().epoch, epoch);
        let ledger = turn(&bench.emulated, &mut devices, order);
        assert_eq!(ledger.closure().unwrap().achieved_steps, Steps(500));
    }
}

/// Sets a fault and makes a move. Checks that the move fails as expected, that at most one difference was turned, and that the axis can be
/// recovered.
fn fails(fault: impl FnOnce(&Bench), mend: impl FnOnce(&Bench), as_it_should: impl Fn(&DeviceError) -> bool) {
    let bench = Bench::new();
    let (mut axis, zero) = bench.referenced();
    fault(&bench);
    let error = axis.move_to(Steps(24)).unwrap_err();
    assert!(as_it_should(&error), "{error:?}");
    assert!(is_suspect(&axis), "{:?}", axis.position());
    assert!(matches!(axis.move_to(Steps(24)), Err(DeviceError::Suspect { .. })), "a suspect axis refuses to move");
    mend(&bench);
    let epoch = axis.reference(&CancelToken::new()).unwrap().epoch;
    assert_eq!(epoch, 3, "one for the first reference, one for the doubt, one for the new reference");
    let here = true_steps(&bench.emulated);
    assert!((here - zero).abs() < 1e-6 || (here - zero - 24.0).abs() < 1e-6, "from {zero} to {here}: a difference was turned twice");
    assert_eq!(axis.move_to(Steps(-24)).unwrap().steps, Steps(-24));
    assert!((true_steps(&bench.emulated) - here + 24.0).abs() < 1e-6);
}

fn unexpected(error: &DeviceError, words: [&str; 2]) -> bool {
    matches!(error, DeviceError::Unexpected { expected, found, .. } if expected.contains(words[0]) && found.contains(words[1]))
}

#[test]
fn a_relay_that_never_becomes_idle_ends_the_move_at_its_deadline() {
    fails(|b| b.knobs.never_idle_after_turns(true), |b| b.knobs.never_idle_after_turns(false), |e| matches!(e, DeviceError::Late { .. }));
}

#[test]
fn a_machine_that_somebody_else_moves_is_not_moved() {
    fails(|b| b.knobs.answer_next("1"), |_| {}, |e| matches!(e, DeviceError::Suspect { why } if why.contains("without a request")));
}

#[test]
fn idle_just_after_a_turn_was_asked_for_is_not_believed() {
    let bench = Bench::new();
    let (mut axis, zero) = bench.referenced();
    bench.knobs.say_idle_for(Duration::from_millis(100));
    axis.move_to(Steps(250)).unwrap();
    assert!((true_steps(&bench.emulated) - zero - 250.0).abs() < 1e-6, "it still turned when it was said to have arrived");
}

#[test]
fn a_connection_that_ends_within_a_turn_is_reported_and_made_anew() {
    fails(|b| b.knobs.hang_up_in_turns(1), |_| {}, |e| matches!(e, DeviceError::Gone { .. }));
}

/// The same fault at the question before the turn, and at the turn itself, which is then made without an acknowledgement.
fn fails_before_and_within(fault: impl Fn(&Knobs), as_it_should: impl Fn(&DeviceError) -> bool) {
    for only_turns in [false, true] {
        let turn_the_knob = |b: &Bench| {
            b.knobs.only_turns(only_turns);
            fault(&b.knobs);
        };
        fails(turn_the_knob, |_| {}, &as_it_should);
    }
}

#[test]
fn an_answer_that_is_missing_or_late_is_never_taken_for_another_ones() {
    let silent = |e: &DeviceError| matches!(e, DeviceError::Silent { .. });
    fails_before_and_within(|k| k.lose_answers(1), silent);
    fails_before_and_within(|k| k.delay_answers(1, Duration::from_millis(900)), silent);
    fails_before_and_within(|k| k.double_answers(1), |e| unexpected(e, ["silence", "nothing"]));
}

#[test]
fn an_answer_that_is_none_is_reported_with_what_came() {
    fails_before_and_within(|k| k.send_wrong_lengths(1), |e| unexpected(e, ["512", "4294967295"]));
    fails_before_and_within(|k| k.answer_next("\u{e9}t\u{e9}"), |e| unexpected(e, ["ASCII", "\\xc3\\xa9"]));
    fails(|b| b.knobs.answer_next("idle"), |_| {}, |e| unexpected(e, ["a number", "idle"]));
    let asks = |e: &DeviceError| matches!(e, DeviceError::VastProgram { what, .. } if what.contains("no pipe"));
    fails_before_and_within(|k| k.answer_next("error: no pipe"), asks);
}

#[test]
fn a_stop_ends_the_requests_and_vast_ends_its_turn() {
    // Half a turn takes a second.
    let bench = Bench::with(relay::Settings { speed_deg_per_s: 0.1 * SPEED_DEG_PER_S / SCALE, ..relay::Settings::default() });
    let (mut axis, zero) = bench.referenced();
    let stop = axis.stop_handle();
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(Steps(250)));
        until("the shaft turns", || true_steps(&bench.emulated) > zero + 1.0);
        stop.stop();
        let error = moving.join().unwrap().unwrap_err();
        assert!(matches!(error, DeviceError::Stopped), "{error}");
    });
    assert!(is_suspect(&axis));
    let cancelled = CancelToken::new();
    cancelled.cancel();
    assert!(matches!(axis.reference(&cancelled), Err(DeviceError::Stopped)), "who stops for good stays stopped");
    // The next reference waits until the turn has ended. A stop handle from before the reference still works.
    axis.reference(&CancelToken::new()).unwrap();
    assert!((true_steps(&bench.emulated) - zero - 250.0).abs() < 1e-6);
    stop.stop();
    assert!(matches!(axis.move_to(Steps(1)), Err(DeviceError::Stopped)));
    assert!((true_steps(&bench.emulated) - zero - 250.0).abs() < 1e-6);
}

#[test]
fn nobody_there_and_nobody_referenced_are_reported() {
    let bench = Bench::new();
    let mut axis = bench.open();
    assert_eq!(axis.position(), Position::Unknown);
    assert!(matches!(axis.move_to(Steps(24)), Err(DeviceError::NotReferenced)));
    let settings = bench.settings();
    drop(axis);
    drop(bench);
    let nobody = Relay::open(settings, crate::motion::per_revolution()).err().unwrap();
    assert!(matches!(nobody, DeviceError::Open { .. }), "{nobody}");
}

fn asks_for(result: Result<(), DeviceError>, word: &str) {
    match result {
        Err(DeviceError::VastProgram { what, way_out, .. }) => assert!(format!("{what}. {way_out}").contains(word), "{what}. {way_out}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_vast_that_is_not_started_is_left_to_a_person_or_started_where_the_configuration_says_so() {
    let stopped = || relay::Settings { started: false, boot_time: Duration::from_secs(1), ..relay::Settings::default() };
    let bench = Bench::with(stopped());
    let mut axis = bench.open();
    for _ in 0..2 {
        asks_for(axis.check(), "launch button");
    }
    asks_for(axis.reference(&CancelToken::new()).map(|_| ()), "launch button");

    let bench = Bench::with(stopped());
    let mut axis = Relay::open(RelaySettings { boot: true, ..bench.settings() }, crate::motion::per_revolution()).unwrap();
    axis.check().unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    // The empty answer to a turn says nothing. The next `busy` shows that VAST was not started any more.
    bench.knobs.restart_server();
    asks_for(axis.move_to(Steps(24)).map(|_| ()), "launch button");
    assert!(is_suspect(&axis));
    let here = true_steps(&bench.emulated);
    axis.reference(&CancelToken::new()).unwrap();
    axis.move_to(Steps(24)).unwrap();
    assert!((true_steps(&bench.emulated) - here - 24.0).abs() < 1e-6);

    let bench = Bench::with(relay::Settings { boot_time: Duration::from_secs(600), ..stopped() });
    let slow = RelaySettings { boot: true, boot_timeout_ms: 300, ..bench.settings() };
    let error = Relay::open(slow, crate::motion::per_revolution()).err().unwrap();
    assert!(matches!(error, DeviceError::Late { what, .. } if what.contains("boot")), "{error}");
}

/// The program that carved ships for VAST's computer, in front of the emulated server's pipe.
struct PipeRelay {
    program: Child,
    address: String,
}

impl PipeRelay {
    fn start(pipe: &Path) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/vast_pipe_relay.py");
        let mut command = Command::new("python3");
        let mut program = command.arg(script).args(["--listen", "127.0.0.1:0", "--pipe"]).arg(pipe).stdout(Stdio::piped()).spawn().unwrap();
        let mut out = BufReader::new(program.stdout.take().unwrap());
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        let address = line.strip_prefix("listening on ").and_then(|rest| rest.split(' ').next()).unwrap_or_else(|| panic!("{line}"));
        // Its messages are read for as long as it runs: a closed pipe would end it.
        std::thread::spawn(move || std::io::copy(&mut out, &mut std::io::sink()));
        Self { address: address.to_owned(), program }
    }
}

impl Drop for PipeRelay {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

/// The server has a pipe for one client after each press of its connect button.
#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn the_shipped_relay_program_keeps_the_servers_pipe_while_carved_comes_and_goes() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("VastServerPipe");
    let bench = Bench::with(relay::Settings { pipe: Some(pipe.clone()), ..relay::Settings::default() });
    let program = PipeRelay::start(&pipe);
    let open = || Relay::open(at(&program.address), crate::motion::per_revolution()).unwrap();
    let mut axis = open();
    asks_for(axis.check(), "press Connect");

    bench.knobs.press_connect();
    until("the pipe", || pipe.exists());
    axis.check().unwrap();
    let mut devices = with_camera(&bench.emulated, Box::new(axis));
    devices.rotation.reference(&CancelToken::new()).unwrap();
    turn(&bench.emulated, &mut devices, ViewOrder::Sequential);
    drop(devices);

    // carved is started again. Nobody presses anything.
    let mut axis = open();
    let zero = true_steps(&bench.emulated);
    axis.reference(&CancelToken::new()).unwrap();
    axis.move_to(Steps(24)).unwrap();

    // The server ends in mid-turn.
    bench.knobs.hang_up_in_turns(1);
    asks_for(axis.move_to(Steps(48)).map(|_| ()), "press Connect");
    assert!(is_suspect(&axis));
    asks_for(axis.check(), "press Connect");
    bench.knobs.press_connect();
    until("the pipe", || pipe.exists());
    axis.check().unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    assert!((true_steps(&bench.emulated) - zero - 48.0).abs() < 1e-6, "the turn was made once");
}

/// While the pipe hangs, carved connects again after each timeout.
#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn the_shipped_relay_program_drops_what_an_earlier_connection_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    let server = UnixListener::bind(&path).unwrap();
    let program = PipeRelay::start(&path);
    let ask = |request: &str| {
        let mut client = TcpStream::connect(&program.address).unwrap();
        client.write_all(&frame(request)).unwrap();
        client
    };
    let read = |from: &mut dyn Read| {
        let mut length = [0; 4];
        from.read_exact(&mut length).unwrap();
        let mut text = vec![0; u32::from_le_bytes(length) as usize];
        from.read_exact(&mut text).unwrap();
        String::from_utf8(text).unwrap()
    };
    let mut first = ask("first");
    let (mut pipe, _) = server.accept().unwrap();
    assert_eq!(read(&mut pipe), "first", "the pipe hangs from here on");
    let mut second = ask("second");
    let mut third = ask("third");
    assert_eq!(second.read(&mut [0]).unwrap(), 0, "closed without an answer");
    for (request, client) in [("first", &mut first), ("third", &mut third)] {
        pipe.write_all(&frame(&format!("{request} done"))).unwrap();
        assert_eq!(read(client), format!("{request} done"));
        if request == "first" {
            assert_eq!(read(&mut pipe), "third");
        }
    }
}

fn frame(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}
